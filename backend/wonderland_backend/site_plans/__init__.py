"""Site plans: files that operators bring, checked, kept by hash; the ledger says which one holds."""
