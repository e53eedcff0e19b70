"""The pure core: records, their one encoding, the keys of a session, geometry and the verdict.

Nothing here performs I/O, reads a clock or draws a random number; every function gives the same bits on every
endorser. Where to look:

- ``encoding``   canonical JSON, the only form in which anything is hashed, signed, stored or sent to the contract
- ``records/``   what the contract accepts and stores, one definition each (type, check, JSON Schema)
- ``frame``      WGS-84 to a pad's own east, north, up, in integers
- ``transcript`` and ``keys``: what a session is bound to, and the keys that follow from it
- ``rounds`` → ``reduction`` → ``estimate`` → ``agreement`` → ``likelihood`` → ``judgement`` → ``verdict``: the numbered
  steps of the decision; ``stopping``: what holds however often a pad looks; ``prospects``: what it can settle at all
"""
