"""What the uplink runs over: a way to the server, by which it connects again and again."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Protocol

from wonderland.telemetry import NO_END_POINT, Channel


@dataclass(frozen=True, slots=True)
class Connected:
    """One connection that stands."""

    channel: Channel
    end_point: str = NO_END_POINT
    """Of the server's certificate (`telemetry.end_point_seen`)."""


class Transport(Protocol):
    """A way to the server."""

    @property
    def address(self) -> str:
        """Where it leads, for people."""

    def connect(self) -> AbstractAsyncContextManager[Connected]:
        """One connection. Raises `UplinkConnectionError`."""
