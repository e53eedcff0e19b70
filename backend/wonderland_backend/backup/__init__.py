"""A backup of the backend's database, and of what else no block of the ledger gives back."""
