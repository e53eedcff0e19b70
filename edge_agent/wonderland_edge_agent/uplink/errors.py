"""What the uplink raises: one tree."""

from __future__ import annotations


class UplinkError(Exception):
    """Base of everything that the uplink raises on purpose."""


class UplinkConfigurationError(UplinkError):
    """An address or a credential with which no connection can ever be made."""


class UplinkConnectionError(UplinkError):
    """No connection came about; the text says why."""


class UplinkProtocolError(UplinkError):
    """The server said something that the protocol does not have, or not then."""


class UplinkRefusedError(UplinkError):
    """The server refused this agent; ``code`` is the server's, for example ``duplicate_agent``."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(f"{code}: {message}" if message else code)
        self.code = code


class UplinkStalledError(UplinkError):
    """The server took records but acknowledged none for too long."""
