"""Drones: the ledger's record, what they may do, where they say they are, what was decided last."""
