"""What every source of the drone's own broadcasts offers."""

from __future__ import annotations

from typing import Protocol


class BroadcastError(Exception):
    """A source that cannot be opened."""


class BroadcastSource(Protocol):
    """The Remote ID positions that the drone has sent."""

    def sent(self, since_ms: int) -> tuple[bytes, ...]:
        """Digests (``wonderland.attested``) of the positions sent since a time, oldest first."""


class NoBroadcasts:
    """A drone whose agent does not know what its Remote ID module sends: it attests nothing."""

    def sent(self, since_ms: int) -> tuple[bytes, ...]:  # noqa: ARG002 - the port's
        """None."""
        return ()
