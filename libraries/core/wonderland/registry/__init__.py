"""The registry without a browser: what stands on the ledger, lists of it, and changes signed by any identity.

``lists`` reads and writes CSV and JSON, ``book`` is what the ledger's blocks say, ``changes`` compares the two and
submits, ``commands`` is ``wonderland registry``.
"""
