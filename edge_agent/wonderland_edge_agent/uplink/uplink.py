"""The uplink's shell: keeps one connection to the server and moves the spool's records over it.

It never gives up: after any fault it connects again, later and later up to half a minute, with jitter so that a
server's restart is not answered by all pads at once. What is not acknowledged stays in the spool.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from wonderland.telemetry import Ack, Channel, Credentials, Refused, Rejected, Welcome
from wonderland_edge_agent.spool import SpoolClosedError, SpoolError
from wonderland_edge_agent.uplink.errors import (
    UplinkError,
    UplinkProtocolError,
    UplinkRefusedError,
    UplinkStalledError,
)
from wonderland_edge_agent.uplink.protocol import SendHello, UplinkProtocol

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from wonderland_edge_agent.spool import Spool
    from wonderland_edge_agent.uplink.transport import Transport

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class UplinkTimings:
    """Seconds, and how much may be under way unacknowledged."""

    backoff_s: float = 0.5
    backoff_max_s: float = 30.0
    greeting_timeout_s: float = 10.0
    stall_timeout_s: float = 30.0
    window_records: int = 1024
    batch_records: int = 256
    batch_bytes: int = 96 * 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class UplinkStatus:
    """How the uplink does; ``error`` is the last fault's text, "" while connected."""

    connected: bool = False
    acknowledged_seq: int = 0
    sent_records: int = 0
    rejected_records: int = 0
    connections: int = 0
    error: str = ""
    refusal: str = ""
    """Code of the server's refusal, "" when it did not refuse."""


DEFAULT_TIMINGS: Final = UplinkTimings()


class Uplink:
    """Sends what the spool holds over ``transport``.

    >>> uplink = Uplink(WebSocketTransport("wss://authority.example/ingest"), credentials, spool)
    >>> await uplink.start(); ...; await uplink.close()
    """

    def __init__(
        self,
        transport: Transport,
        credentials: Credentials,
        spool: Spool,
        *,
        timings: UplinkTimings = DEFAULT_TIMINGS,
        randomness: random.Random | None = None,
        on_status: Callable[[UplinkStatus], None] | None = None,
    ) -> None:
        self._transport = transport
        self._credentials = credentials
        self._spool = spool
        self._timings = timings
        self._random = randomness or random.SystemRandom()
        self._on_status = on_status
        self._status = UplinkStatus()
        self._task: asyncio.Task[None] | None = None

    @property
    def status(self) -> UplinkStatus:
        """Whether it is connected, what is acknowledged, and the last error."""
        return self._status

    async def start(self) -> None:
        """Begin to connect, in the background."""
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="uplink")

    async def close(self) -> None:
        """Close the connection; what is not acknowledged stays in the spool. Close the uplink before the spool."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            self._say(connected=False)

    async def _run(self) -> None:
        attempt = 0
        while True:
            acknowledged = self._status.acknowledged_seq
            refusal = ""
            try:
                await self._connect()
                error = "the connection ended"
            except UplinkRefusedError as refused:
                refusal, error = refused.code, f"the server refused this agent ({refused})"
            except SpoolClosedError:
                self._say(connected=False)
                return
            except (UplinkError, SpoolError) as cause:
                error = str(cause)
            except ConnectionError as cause:
                error = f"the connection ended ({cause})"
            except Exception as cause:  # noqa: BLE001 - see below
                # A mistake in here must not leave a pad silent for good: it is told with its origin, and tried again.
                _log.exception("uplink: unexpected error")
                error = f"unexpected error ({cause!r})"
            if error != self._status.error:
                _log.warning("uplink: %s; trying again", error)
            if self._status.acknowledged_seq > acknowledged:
                attempt = 0
            self._say(connected=False, error=error, refusal=refusal)
            await asyncio.sleep(self._delay_s(attempt))
            attempt += 1

    def _delay_s(self, attempt: int) -> float:
        longest = min(self._timings.backoff_max_s, self._timings.backoff_s * (1 << min(attempt, 16)))
        return longest * (0.5 + 0.5 * self._random.random())

    async def _connect(self) -> None:
        async with self._transport.connect() as connected:
            channel = connected.channel
            protocol = UplinkProtocol(self._credentials, self._spool.id, connected.end_point)
            if not await self._greet(channel, protocol):
                return
            acknowledgements = _Latest(protocol.acknowledged_seq)
            await _first_of(
                self._send(channel, protocol, acknowledgements),
                self._receive(channel, protocol, acknowledgements),
                self._forget(acknowledgements),
                self._watch(protocol, acknowledgements),
            )

    async def _greet(self, channel: Channel, protocol: UplinkProtocol) -> bool:
        """Authenticate and learn where to go on; False when the connection must be made anew."""
        try:
            async with asyncio.timeout(self._timings.greeting_timeout_s):
                hello = protocol.receive(await channel.receive())
                if isinstance(hello, SendHello):
                    await channel.send(hello.text)
                    welcome = protocol.receive(await channel.receive())
                else:
                    welcome = hello
        except TimeoutError:
            raise UplinkStalledError("the server did not finish the greeting in time") from None
        if isinstance(welcome, Refused):
            raise UplinkRefusedError(welcome.code, welcome.message)
        assert isinstance(welcome, Welcome)
        if welcome.acknowledged > self._spool.status.last_seq:
            # The spool's file is older than what it has sent: under its old name nothing new would be believed.
            await self._spool.renew()
            _log.warning("uplink: the server knows more than the spool, which was restored from a copy; renewed it")
            return False
        await self._spool.acknowledge(welcome.acknowledged)
        _log.info("uplink: connected to %s, going on after record %d", self._transport.address, welcome.acknowledged)
        self._say(
            connected=True,
            error="",
            refusal="",
            acknowledged_seq=welcome.acknowledged,
            connections=self._status.connections + 1,
        )
        return True

    async def _send(self, channel: Channel, protocol: UplinkProtocol, acknowledged: _Latest) -> None:
        timings = self._timings
        while True:
            room = timings.window_records - (protocol.sent_seq - protocol.acknowledged_seq)
            if room <= 0:
                await acknowledged.beyond(protocol.acknowledged_seq)
                continue
            records = await self._spool.pending(
                protocol.sent_seq, max_records=min(room, timings.batch_records), max_bytes=timings.batch_bytes
            )
            if records:
                await channel.send(protocol.records(records))
                self._say(sent_records=self._status.sent_records + len(records))
            else:
                await self._spool.wait_beyond(protocol.sent_seq)

    async def _watch(self, protocol: UplinkProtocol, acknowledged: _Latest) -> None:
        """End a connection whose server takes records and acknowledges none."""
        stall_s = self._timings.stall_timeout_s
        while True:
            if protocol.acknowledged_seq == protocol.sent_seq:
                await asyncio.sleep(stall_s / 4)
                continue
            try:
                async with asyncio.timeout(stall_s):
                    await acknowledged.beyond(protocol.acknowledged_seq)
            except TimeoutError:
                raise UplinkStalledError(
                    f"the server acknowledged nothing for {stall_s:g} s "
                    f"(records {protocol.acknowledged_seq + 1} to {protocol.sent_seq} are under way)"
                ) from None

    async def _receive(self, channel: Channel, protocol: UplinkProtocol, acknowledged: _Latest) -> None:
        while True:
            event = protocol.receive(await channel.receive())
            if isinstance(event, Ack):
                acknowledged.put(event.seq)
            elif isinstance(event, Rejected):
                _log.warning("uplink: record %d rejected (%s: %s)", event.seq, event.code, event.message)
                self._say(rejected_records=self._status.rejected_records + 1)
            elif isinstance(event, Refused):
                raise UplinkRefusedError(event.code, event.message)
            else:
                raise UplinkProtocolError(f"unexpected {type(event).__name__}")

    async def _forget(self, acknowledged: _Latest) -> None:
        """Let the spool forget: the newest number at a time, however many came meanwhile."""
        seq = acknowledged.value
        while True:
            seq = await acknowledged.beyond(seq)
            await self._spool.acknowledge(seq)
            self._say(acknowledged_seq=seq)

    def _say(self, **changes: object) -> None:
        self._status = replace(self._status, **changes)  # type: ignore[arg-type]
        if self._on_status is not None:
            self._on_status(self._status)


class _Latest:
    """The newest of a rising number, for several tasks to wait on."""

    def __init__(self, value: int) -> None:
        self.value = value
        self._changed = asyncio.Event()

    def put(self, value: int) -> None:
        self.value = value
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def beyond(self, value: int) -> int:
        while self.value <= value:
            await self._changed.wait()
        return self.value


async def _first_of(*works: Coroutine[None, None, None]) -> None:
    """Run all until one ends or fails, end the others, and raise what it raised."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()
