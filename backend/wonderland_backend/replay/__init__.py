"""The past: what the live map showed at a moment, from what was known by then."""
