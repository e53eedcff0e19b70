"""The proof-of-location contract and how a ledger runs it.

``stub`` is the seam, ``contract`` the contract, ``service`` what a Fabric peer dials. The embedded ledger runs it in
place.
"""
