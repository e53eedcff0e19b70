"""The backend: it mirrors the ledger into a database, takes in what agents report, and shows both, told apart.

Two rules hold everywhere: rows of the ledger's records are written by ``mirror`` alone, from the write sets of valid
transactions; and whatever did not come from the ledger says ``verified: false`` (tracks, estimates) or names the pad
as its source (steps).
"""
