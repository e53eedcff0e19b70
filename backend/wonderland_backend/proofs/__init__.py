"""Proofs of location for other systems: what was decided about a drone's place, how surely, and where it stands."""
