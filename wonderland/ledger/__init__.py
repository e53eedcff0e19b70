"""wonderland.ledger."""
