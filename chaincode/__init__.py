"""The proof-of-location contract and how a ledger runs it: ``stub`` is the seam, ``contract`` the contract."""
