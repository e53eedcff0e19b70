"""Operators' registration numbers: the ledger has commitments, this database what opens them (decision 0039)."""
