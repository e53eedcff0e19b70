"""U-space: Network Remote ID (ASTM F3411-22a) with its tokens and DSS, and network identification by EU 2021/664.

What leaves here is what drones claimed. Verdicts are told by our own interface, beside the claim and never in its
place.
"""
