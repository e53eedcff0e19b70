"""The ledger as it was mirrored: blocks, transactions, and how far behind the mirror is."""
