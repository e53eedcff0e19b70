"""A byte pipe to a serial device that may vanish and return."""
