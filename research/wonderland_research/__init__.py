"""What judges the verdict: the attack lab, the paper's figures anew, and recorded ranges of whoever has some.

``attack_lab`` plays liars against the contract's own decision; ``reproduction`` repeats the paper and its successors;
``evaluate`` judges recordings.
"""
