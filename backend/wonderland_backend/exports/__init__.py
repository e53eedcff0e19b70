"""A window of the past as files: what drones claimed, what pads estimated, what the ledger decided, each apart."""
