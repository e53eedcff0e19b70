"""Where a webhook may go: by https, to addresses of the Internet; anywhere else only to hosts that are allowed by name.

The name is resolved here and the connection made to the address that was checked, so that a name which changes its
mind between the two (DNS rebinding) gains nothing.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import SplitResult, urlsplit

from wonderland.problems import SaidError, said

MAX_URL: Final = 500
RESOLVE_S: Final = 5.0
_NAT64: Final = ipaddress.ip_network("64:ff9b::/96")

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolve = Callable[[str, int], Awaitable[list[str]]]


class TargetRefused(SaidError):  # noqa: N818 - becomes a problem, or stands beside the delivery
    """A webhook is not sent there."""


@dataclass(frozen=True, slots=True)
class Target:
    """An address that was checked. `url` has it in place of the name, `host` is the name."""

    url: str
    host: str
    host_header: str


async def resolve(host: str, port: int) -> list[str]:
    """The addresses of a host. Raises OSError."""
    found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return [str(each[4][0]).partition("%")[0] for each in found]


@dataclass(frozen=True, slots=True)
class Destinations:
    """Where requests to addresses that others named may go."""

    inside: frozenset[str] = frozenset()
    """Hosts that may be at other than Internet addresses, or be asked by http."""
    only: tuple[str, ...] = ()
    """Where there are any: no other hosts than these and those inside. One that begins with a dot: what is below it."""

    def has(self, host: str) -> bool:
        """Whether it is one of those named; yes where none are."""
        if not self.only or host in self.inside:
            return True
        return any(host.endswith(each) if each.startswith(".") else host == each for each in self.only)


def check_url(url: str, destinations: Destinations) -> SplitResult:
    """The parts of a URL that a webhook may have, before its name is resolved. Raises `TargetRefused`."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        raise TargetRefused(said("target_no_url")) from None
    host = (parts.hostname or "").rstrip(".")
    if len(url) > MAX_URL or not host or not url.isascii() or not url.isprintable() or " " in url or port == 0:
        raise TargetRefused(said("target_form", most=MAX_URL))
    if parts.username is not None or parts.fragment:
        raise TargetRefused(said("target_with_user"))
    if not destinations.has(host):
        raise TargetRefused(said("target_not_listed", host=host))
    allowed = destinations.inside
    if parts.scheme != "https" and not (parts.scheme == "http" and host in allowed):
        raise TargetRefused(said("target_no_https"))
    literal = _literal(host)
    if literal is not None and host not in allowed and not is_public(literal):
        raise TargetRefused(said("target_private", host=host))
    return parts


async def resolved(url: str, destinations: Destinations, lookup: Resolve = resolve) -> Target:
    """The target with its name resolved. Every address of the name has to be allowed. Raises `TargetRefused`."""
    parts = check_url(url, destinations)
    host = (parts.hostname or "").rstrip(".")
    port = parts.port or (443 if parts.scheme == "https" else 80)
    try:
        async with asyncio.timeout(RESOLVE_S):
            addresses = [ipaddress.ip_address(each) for each in await lookup(host, port)]
    except (OSError, ValueError) as error:
        raise TargetRefused(said("target_unresolved", host=host, why=str(error) or said("no_answer_in_time"))) from None
    if not addresses:
        raise TargetRefused(said("target_no_address", host=host))
    if host not in destinations.inside:
        private = next((each for each in addresses if not is_public(each)), None)
        if private is not None:
            raise TargetRefused(said("target_at_private", host=host, address=str(private)))
    shown = f"[{addresses[0]}]" if addresses[0].version == 6 else str(addresses[0])
    pinned = parts._replace(netloc=f"{shown}:{port}").geturl()
    return Target(pinned, host, parts.netloc)


def is_public(address: Address) -> bool:
    """Whether an address is one of the Internet: neither this machine's, nor a private network's, nor for groups."""
    if isinstance(address, ipaddress.IPv6Address):
        inner = address.ipv4_mapped or address.sixtofour or (address.teredo or (None, None))[1]
        if address in _NAT64:
            inner = ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
        if inner is not None:
            return is_public(inner)
    return address.is_global and not address.is_multicast and not address.is_reserved


def _literal(host: str) -> Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None
