"""What every source of positions offers."""

from __future__ import annotations

from typing import Protocol

from wonderland.proofs.records.sessions import Claim


class PositionError(Exception):
    """A source that cannot be opened or read, or a position that no claim may hold."""


class PositionSource(Protocol):
    """Where the drone thinks it is."""

    def claim(self, now_ms: int) -> Claim | None:
        """The position now, by the source's own word; None while it has none that is fresh."""


class TellingPosition(PositionSource, Protocol):
    """A source that knows what it lacks."""

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
