"""Sessions: the eight steps of each proof, those that the ledger tells and those that the pad reports."""
