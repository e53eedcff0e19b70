"""wonderland.remote_id."""
