"""wonderland.proofs.records."""
