"""TLS handshakes that are going on, bounded: what a stranger may cost before anything is known of them.

An event loop's own server begins a handshake with whoever connects, and has no say in how many there are.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from wonderland_backend.http_protocol import HEAD_S

logger = logging.getLogger(__name__)

MOST: Final = 2_000
"""In all: 45 kB each."""
MOST_EACH: Final = 256
"""Of one address, behind which there may be an office, or a network of agents that all come back at once."""
PAUSE_S: Final = 1.0
"""After a connection could not be accepted: this process or the machine has no file left."""


class Handshakes:
    """Where there is no room, the oldest gives way: an honest handshake takes milliseconds, one that waits has waited.

    Those of an address that has too many give way first, so that one machine does not push out the others'.
    """

    def __init__(self, most: int = MOST, most_each: int = MOST_EACH) -> None:
        self._most = most
        self._most_each = most_each
        self._tasks: dict[asyncio.Task[None], str] = {}  # in the order in which they came
        self._counts: Counter[str] = Counter()

    def begin(self, task: asyncio.Task[None], address: str) -> None:
        """Count one in; it is counted out when the task is done."""
        if self._counts[address] >= self._most_each:
            self._let_go(next(each for each, whose in self._tasks.items() if whose == address))
        elif len(self._tasks) >= self._most:
            self._let_go(next(iter(self._tasks)))
        self._tasks[task] = address
        self._counts[address] += 1
        task.add_done_callback(self._end)

    def end_all(self) -> None:
        """Let go of all."""
        for task in list(self._tasks):
            self._let_go(task)

    def _let_go(self, task: asyncio.Task[None]) -> None:
        self._end(task)
        task.cancel()

    def _end(self, task: asyncio.Task[None]) -> None:
        address = self._tasks.pop(task, None)
        if address is not None:
            self._counts[address] -= 1
            if not self._counts[address]:
                del self._counts[address]


class TlsServer:
    """What uvicorn asks of an `asyncio.Server`: accepts at a bound socket, and gives connections to protocols.

    Each when its handshake is done.
    """

    def __init__(
        self, bound: socket.socket, backlog: int, new_protocol: Callable[[], asyncio.BaseProtocol], tls: ssl.SSLContext
    ) -> None:
        """Listens at once, in the loop that runs."""
        self._bound = bound
        self._new_protocol = new_protocol
        self._tls = tls
        self._handshakes = Handshakes()
        self._loop = asyncio.get_running_loop()
        bound.setblocking(False)
        bound.listen(backlog)
        self._accepting = self._loop.create_task(self._accept(), name="accepting")

    @property
    def sockets(self) -> Sequence[socket.socket]:
        """The one that it listens at; none, once it is closed."""
        return () if self._accepting.done() else (self._bound,)

    def close(self) -> None:
        """Accept no more; connections whose handshake is done stay."""
        self._accepting.cancel()
        self._handshakes.end_all()

    async def wait_closed(self) -> None:
        """Until nothing is accepted any more."""
        await asyncio.wait([self._accepting])

    async def _accept(self) -> None:
        while True:
            try:
                accepted, peer = await self._loop.sock_accept(self._bound)
            except OSError as cause:
                logger.warning("a connection could not be accepted: %s", cause)
                await asyncio.sleep(PAUSE_S)
                continue
            task = self._loop.create_task(self._shake_hands(accepted))
            task.add_done_callback(functools.partial(_close_unbegun, accepted))
            self._handshakes.begin(task, peer[0])

    async def _shake_hands(self, accepted: socket.socket) -> None:
        with contextlib.suppress(OSError):  # what TLS refuses, too, time that ran out, and a peer that went away
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # small answers go at once
            await self._loop.connect_accepted_socket(
                self._new_protocol, accepted, ssl=self._tls, ssl_handshake_timeout=HEAD_S
            )


def _close_unbegun(accepted: socket.socket, task: asyncio.Task[None]) -> None:
    """A task that was let go before its first step has given its socket to nobody."""
    if task.cancelled():
        accepted.close()
