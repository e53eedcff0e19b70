"""What ``wonderland-ingest/1`` runs over: texts both ways, in order, until the channel ends. A WebSocket is one."""

from __future__ import annotations

from typing import Protocol


class Channel(Protocol):
    """One connection of an agent with a backend. Once it has ended, `receive` and `send` raise `ConnectionError`."""

    async def receive(self) -> str | bytes:
        """The next text; bytes are none, and whoever is sent some says so."""

    async def send(self, text: str) -> None:
        """Send a text; it waits while the other side takes nothing."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """End it, with a code of WebSockets'."""
