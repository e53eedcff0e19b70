"""Authorisations: what a drone may do at which pad, and when, as the ledger has it."""
