"""Requests for a proof by somebody other than the drone: brought to the drone's agent, followed on the ledger."""
