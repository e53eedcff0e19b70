"""wonderland.proofs."""
