"""One UWB node on one serial port, asynchronous: ``UwbNode`` and its ``UwbSession``."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from wonderland.uwb.events import SessionEvent
from wonderland.uwb.uci.config import SessionConfig
from wonderland.uwb.uci.status import SessionState


def monotonic_ms() -> int:
    """Milliseconds of the monotonic clock."""
    return time.monotonic_ns() // 1_000_000


class UwbSession:
    """One ranging session on a node; made by ``UwbNode.open_session``. Survives unplugging of the node."""

    session_id: int
    mac_address: int
    state: SessionState
    """The node's last word; INIT while it is away."""
    events_dropped: int
    """Events lost because nobody read ``events`` (the queue holds 4096, the oldest go first)."""

    def events(self) -> AsyncIterator[SessionEvent]:
        """Every event in order; one reader. Ends after ``close`` or ``SessionFailed``."""
        raise NotImplementedError

    def events_nowait(self) -> list[SessionEvent]:
        """What is queued, without waiting."""
        raise NotImplementedError

    async def send(self, data: bytes, *, timeout_s: float = 2.0) -> None:
        """Hands one data unit to the node as soon as it gives credit; it goes on air in the next round.

        Only the session's initiator is heard (session A: the drone, B: the pad). No word on whether anybody heard it.
        Raises ``NodeUnavailableError`` when no credit comes in time or the node is away, ``NodeClosedError``.
        """
        raise NotImplementedError

    @property
    def credit(self) -> bool:
        """Whether ``send`` would go through at once."""
        raise NotImplementedError

    async def close(self) -> None:
        """STOP and DEINIT; returns when the node has confirmed, or cannot be reached. Never raises."""
        raise NotImplementedError


class UwbNode:
    """One node. Use as an asynchronous context manager; it connects, resets the node, and keeps doing so.

    ``port``: path of the serial device (or a stable symbolic link under /dev/serial/by-id).
    ``clock``: milliseconds for ``t_ms`` of all events.
    """

    def __init__(self, port: Path | str, *, name: str = "", clock: Callable[[], int] = monotonic_ms) -> None:
        raise NotImplementedError

    async def __aenter__(self) -> Self:
        raise NotImplementedError

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    @property
    def is_ready(self) -> bool:
        """Whether the node is there, was reset and answers."""
        raise NotImplementedError

    async def wait_ready(self, timeout_s: float = 5.0) -> None:
        """Until the node answers; raises ``NodeUnavailableError`` with the reason."""
        raise NotImplementedError

    async def open_session(self, config: SessionConfig, *, timeout_s: float = 5.0) -> UwbSession:
        """Until the session is ACTIVE. Several sessions may run at once.

        Raises ``NodeUnavailableError`` (node silent or away), ``UciConfigRejectedError`` and other ``UciError``
        (the node refuses; text and parameters say what), ``NodeClosedError``.
        """
        raise NotImplementedError

    async def close(self) -> None:
        """Closes all sessions, then the port. Never raises."""
        raise NotImplementedError
