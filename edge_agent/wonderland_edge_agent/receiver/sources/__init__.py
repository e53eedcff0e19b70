"""Where a pad hears Remote ID: one module for each kind of receiver, imported only where it is configured.

A source is started with a sink and gives it what it hears; it reconnects by itself and never raises after its start.
"""

from __future__ import annotations

from typing import Protocol

from wonderland_remote_id.framings.framed import Framed


class Sink(Protocol):
    """Who takes what was heard (`wonderland_edge_agent.receiver.RemoteIdReceiver`)."""

    def take_frame(self, frame: bytes, *, source: str, transport: str, rssi_dbm: int | None = None) -> None:
        """Take a bare frame."""

    def take_framed(self, framed: Framed, source: str) -> None:
        """Take a frame out of its wrapping; ``source`` is the receiver that heard it."""

    def take_bad(self) -> None:
        """Count what should have held a frame and does not."""


class Source(Protocol):
    """One configured receiver."""

    async def start(self, sink: Sink) -> None:
        """Begin to hear. Raises `ReceiverError` for what waiting will not cure."""

    async def close(self) -> None:
        """Stop hearing, and give device or port free."""
