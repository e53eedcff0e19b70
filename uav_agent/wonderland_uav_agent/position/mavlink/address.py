"""Where an autopilot is reached: ``udp:HOST:PORT``, ``tcp:HOST:PORT`` or ``serial:DEVICE[:BAUD]``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland_uav_agent.position.source import PositionError

BAUD_RATE: Final = 921_600
"""What both projects' guides set on the line to a companion computer."""
FORMS: Final = "mavlink:udp:HOST:PORT, mavlink:tcp:HOST:PORT or mavlink:serial:DEVICE[:BAUD]"
_BAUD_RATES: Final = range(1_200, 12_000_001)


@dataclass(frozen=True, slots=True)
class UdpAddress:
    """Listened on."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"mavlink:udp:{_bracketed(self.host)}:{self.port}"


@dataclass(frozen=True, slots=True)
class TcpAddress:
    """Connected to."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"mavlink:tcp:{_bracketed(self.host)}:{self.port}"

    @property
    def url(self) -> str:
        """As a line over the network."""
        return f"socket://{_bracketed(self.host)}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """Opened."""

    device: str
    baud_rate: int = BAUD_RATE

    def __str__(self) -> str:
        return f"mavlink:serial:{self.device}:{self.baud_rate}"


Address = UdpAddress | TcpAddress | SerialAddress


def parse_address(text: str) -> Address:
    """What follows ``mavlink:``. Raises PositionError, which says how it is written."""
    kind, _, rest = text.partition(":")
    first, _, last = rest.rpartition(":")
    number = int(last) if last.isascii() and last.isdigit() and len(last) <= 8 else -1
    host = first[1:-1] if first.startswith("[") and first.endswith("]") else first
    if kind == "udp" and host and 0 <= number <= 0xFFFF:
        return UdpAddress(host, number)
    if kind == "tcp" and host and 0 < number <= 0xFFFF:
        return TcpAddress(host, number)
    # Names by path have colons of their own (…-usb-0:1:1.0), but end in no bare number that is a rate.
    if kind == "serial" and first and number in _BAUD_RATES:
        return SerialAddress(first, number)
    if kind == "serial" and rest.startswith("/"):
        return SerialAddress(rest)
    raise PositionError(f"mavlink:{text}: give {FORMS}")


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
