"""What the contract decided; only the mirror of the ledger brings verdicts."""
