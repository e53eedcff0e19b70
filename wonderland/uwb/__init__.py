"""wonderland.uwb."""
