"""What goes wrong on the bus or on the way to it; each text says what to do about it."""

from __future__ import annotations


class BusError(Exception):
    """Base of all below."""


class BusSettingsError(BusError):
    """Settings with which no session is opened."""


class BusUnreachableError(BusError):
    """No router could be reached, or none let this peer in."""


class ChannelClosedError(BusError, ConnectionError):
    """A channel that stands no longer; ``code`` is the other side's (as of WebSockets), 1006 where it said none."""

    def __init__(self, reason: str, code: int = 1006) -> None:
        super().__init__(reason or f"closed with {code}")
        self.code = code
        self.reason = reason
