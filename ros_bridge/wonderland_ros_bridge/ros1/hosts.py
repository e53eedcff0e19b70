"""With whom this node speaks: this machine alone, unless the settings name networks.

A master names the addresses of nodes, and anybody may register with a master: without this, a stranger could have the
bridge connect to any machine that it reaches.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Sequence

from wonderland_ros_bridge.errors import WireError

LOOPBACK = ("127.0.0.0/8", "::1/128")


class Hosts:
    """Networks that are spoken with."""

    def __init__(self, networks: Sequence[str] = LOOPBACK) -> None:
        self._networks = tuple(ipaddress.ip_network(each) for each in networks)

    def allows(self, address: str) -> bool:
        """Whether an address is within them."""
        try:
            found = ipaddress.ip_address(address.partition("%")[0])
        except ValueError:
            return False
        mapped = getattr(found, "ipv4_mapped", None)
        return any((mapped or found) in network for network in self._networks)

    async def connect(
        self, host: str, port: int, *, limit: int = 65_536
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A connection to a name's first address that is allowed. Raises WireError, OSError."""
        try:
            found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except ValueError as cause:  # a name that IDNA cannot encode, or that holds a NUL
            raise WireError(f"{host[:100]!r} is no name of a host: {cause}") from cause
        addresses = [str(each[4][0]) for each in found]
        allowed = next((each for each in addresses if self.allows(each)), None)
        if allowed is None:
            raise WireError(
                f"{host} is {', '.join(addresses)}, outside the networks that this bridge speaks with; "
                "add it to ros1.networks, or start the other side with ROS_IP=127.0.0.1"
            )
        return await asyncio.open_connection(allowed, port, limit=limit)
