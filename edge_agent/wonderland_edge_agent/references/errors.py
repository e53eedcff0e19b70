"""What is wrong with a reference; each text says what to do."""

from __future__ import annotations


class SourceError(Exception):
    """A reference from which nothing will come."""


class PositionError(Exception):
    """Something that came and is no position."""
