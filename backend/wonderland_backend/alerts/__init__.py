"""What an officer must not miss: alerts from the ledger and from watching, what was done about each, who is told."""
