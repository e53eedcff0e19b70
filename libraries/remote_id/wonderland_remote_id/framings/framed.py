"""What every framing hands over: a bare frame, and what the transport said beside it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Framed:
    """One frame (25 bytes, or a pack) out of its wrapping.

    ``transport`` is one of ``ble4`` (legacy advertising), ``ble5`` (extended advertising, also Long Range),
    ``wifi-nan``, ``wifi-beacon``, ``mavlink``, ``json``. ``counter`` is the message counter of the wrapping (0–255,
    one series for each message type), ``address`` the transmitter's (``aa:bb:cc:dd:ee:ff``), ``t_ms`` when the
    receiver or the capture says that it was heard (Unix time).
    """

    frame: bytes
    transport: str
    counter: int | None = None
    address: str | None = None
    rssi_dbm: int | None = None
    t_ms: int | None = None


def format_address(octets: bytes) -> str:
    """Six bytes in the order of transmission → ``aa:bb:cc:dd:ee:ff``."""
    return ":".join(f"{octet:02x}" for octet in octets)


def parse_address(text: str) -> bytes:
    """``aa:bb:cc:dd:ee:ff`` → six bytes. Raises ValueError for anything else."""
    octets = bytes.fromhex(text.replace(":", ""))
    if len(octets) != 6:
        raise ValueError(text)
    return octets
