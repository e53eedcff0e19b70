"""The Gateways that a client may ask: peers of one organisation, in the order in which it prefers them.

A peer that cannot be reached is left aside, and the next one is asked. It is asked again when it can be reached, has
been so for a while, and has as many blocks as the others: a peer that has just come back is still behind. What the
peers *say* (a refusal, an orderer that is away) moves nobody aside: another peer would say the same.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import grpc

from wonderland_fabric_gateway.errors import LedgerError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable

RETURN_S: Final = 5.0
"""How long a peer must have been reachable before it is preferred again; doubled each time that it fails anew."""
RETURN_MAX_S: Final = 60.0
_SAME_FAILURE_S: Final = 1.0
"""Calls that were under way together fail together; that is one failure."""


@dataclass
class _Peer:
    address: str
    channel: grpc.aio.Channel
    failed_s: float | None = None
    reachable_s: float | None = None
    failures: int = 0
    turn: int = 0
    """Grows with each failure: whose is the lowest has waited longest."""


class Gateways:
    """Channels to one or more Gateways, the preferred first. ``async with`` closes them; `close` does, too.

    `tls_certificate_sha256` is the digest of the client's TLS certificate (DER), b"" without one: peers that demand
    such certificates find it in each request for blocks. `now_s` is a monotonic clock, seconds.
    """

    def __init__(
        self,
        channels: Iterable[tuple[str, grpc.aio.Channel]],
        *,
        tls_certificate_sha256: bytes = b"",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._peers: Final = tuple(_Peer(address, channel) for address, channel in channels)
        if not self._peers:
            raise ValueError("a client needs at least one Gateway")
        self._now_s = now_s
        self._turn = 0
        self._comparing: dict[int, asyncio.Task[None]] = {}
        self.is_level: Callable[[int, int], Awaitable[bool]] | None = None
        """Whether the first Gateway has as many blocks as the second, or LedgerError; set by somebody who may ask."""
        self.tls_certificate_sha256: Final = tls_certificate_sha256

    @classmethod
    def of(cls, channels: Gateways | grpc.aio.Channel) -> Gateways:
        """As they are, or one channel that the caller opened."""
        return channels if isinstance(channels, Gateways) else cls([("", channels)])

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close all channels; calls under way end with CANCELLED."""
        comparing = list(self._comparing.values())
        for task in comparing:
            task.cancel()
        await asyncio.gather(*comparing, return_exceptions=True)
        for peer in self._peers:
            await peer.channel.close()

    def __len__(self) -> int:
        return len(self._peers)

    def address(self, index: int) -> str:
        """Where a Gateway listens, ``host:port``; "" when the caller opened its channel."""
        return self._peers[index].address

    def channel(self, index: int) -> grpc.aio.Channel:
        """The channel to a Gateway."""
        return self._peers[index].channel

    @property
    def preferred(self) -> grpc.aio.Channel:
        """The channel to the Gateway that is asked first now, for calls that only one peer can answer."""
        return self._peers[self.order()[0]].channel

    def order(self) -> list[int]:
        """All Gateways, the one to ask first in front: those in good standing, then those that failed longest ago."""
        if len(self._peers) == 1:
            return [0]
        standing: list[int] = []
        away: list[int] = []
        for index, peer in enumerate(self._peers):
            (standing if self._is_standing(index, peer) else away).append(index)
        return standing + sorted(away, key=lambda index: self._peers[index].turn)

    def failed(self, index: int) -> None:
        """A Gateway could not be reached: ask others first."""
        peer, now_s = self._peers[index], self._now_s()
        if peer.failed_s is None or now_s - peer.failed_s > _SAME_FAILURE_S:
            peer.failures += 1
        peer.failed_s, peer.reachable_s = now_s, None
        self._turn += 1
        peer.turn = self._turn

    def behind(self, index: int) -> None:
        """A Gateway's chain is shorter than what was seen of it: ask others first, if there are any."""
        if any(self._is_standing(other, peer) for other, peer in enumerate(self._peers) if other != index):
            self.failed(index)

    def answered(self, index: int) -> None:
        """A Gateway answered, whatever it said."""
        peer = self._peers[index]
        if peer.failed_s is None:
            peer.failures = 0

    def _is_standing(self, index: int, peer: _Peer) -> bool:
        if peer.failed_s is None:
            return True
        # Asking for the state with True also has a channel that gave up try again.
        if peer.channel.get_state(try_to_connect=True) is not grpc.ChannelConnectivity.READY:
            peer.reachable_s = None
            return False
        now_s = self._now_s()
        if peer.reachable_s is None:
            peer.reachable_s = now_s
        if now_s - peer.reachable_s < min(RETURN_MAX_S, RETURN_S * 2 ** (peer.failures - 1)):
            return False
        other = next((number for number, each in enumerate(self._peers) if each.failed_s is None), None)
        if self.is_level is not None and other is not None:
            if index not in self._comparing:
                self._comparing[index] = asyncio.get_running_loop().create_task(self._compare(index, other))
            return False
        peer.failed_s = peer.reachable_s = None
        return True

    async def _compare(self, index: int, other: int) -> None:
        """Let a Gateway stand again when it has caught up with another one; else it has to wait anew."""
        assert self.is_level is not None
        peer = self._peers[index]
        try:
            level = await self.is_level(index, other)
        except LedgerError:
            level = False
        finally:
            del self._comparing[index]
        if level and peer.reachable_s is not None:
            peer.failed_s = peer.reachable_s = None
        else:
            peer.reachable_s = None
