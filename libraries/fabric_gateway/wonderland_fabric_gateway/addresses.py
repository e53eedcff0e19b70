"""``host:port`` as it is written, IPv6 included."""

from __future__ import annotations

import ipaddress

from wonderland_fabric_gateway.errors import AddressError


def split_address(address: str) -> tuple[str, int]:
    """Host and port of ``host:port`` or ``[v6]:port``. Raises `AddressError`."""
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise AddressError(f"{address[:200]!r} is no HOST:PORT (port 0 to 65535; 0 takes a free one)")
    return host, int(port)


def bracketed(host: str) -> str:
    """The host as it stands in an address: IPv6 in brackets."""
    try:
        return f"[{host}]" if ipaddress.ip_address(host).version == 6 else host
    except ValueError:
        return host


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach what listens there."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
