"""Endpoints of U-space: those of the standards, of tests of InterUSS, of the console."""
