"""A DWM1001 tag on the drone: it measures its ranges to a pad's anchors, and the agent reports them by UDP.

The pad has to take the drone's word for them (assurance 0). A policy that demands more never verifies such a proof.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from pathlib import Path
from types import TracebackType
from typing import Final, Self, cast

from wonderland.clock import Clock
from wonderland.proofs.records.radios import NodeAbility
from wonderland.uwb.layout import RangingPlan
from wonderland_fira_uci.dwm1001 import Dwm1001Node, LocationReport, Mode, Timings
from wonderland_fira_uci.dwm1001.carrier import Carrier, Words
from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError
from wonderland_fira_uci.errors import NodeError
from wonderland_fira_uci.serial_port import Opener
from wonderland_uav_agent.session.events import DataHeard, OwnRange
from wonderland_uav_agent.session.ports import Sink

_log = logging.getLogger(__name__)

READY_GRACE_S: Final = 3.0
HELLO_S: Final = 0.2
"""Datagrams get lost, and addresses behind a translator are forgotten."""
Address = tuple[str, int]


class TagRadio(asyncio.DatagramProtocol):
    """Use as an asynchronous context manager; the board is connected as long as it is open. ``pad``: host and port.

    ``board``: its short address, where it is an anchor that the pad's tags measure; None where it is a tag itself.
    """

    @property
    def measures(self) -> bool:
        """A tag does; an anchor does not."""
        return self._board is None

    def __init__(
        self,
        port: Path | str | Opener,
        pad: Address,
        clock: Clock,
        *,
        mode: Mode = Mode.TLV,
        name: str = "",
        timings: Timings | None = None,
        board: int | None = None,
    ) -> None:
        name = name or ("drone's tag" if board is None else "drone's anchor")
        self._node = Dwm1001Node(port, mode=mode, name=name, clock=clock, timings=timings, as_anchor=board is not None)
        self._pad = pad
        self._board = board
        self._transport: asyncio.DatagramTransport | None = None
        self._gone = asyncio.Event()
        self._carrier: Carrier | None = None
        self._macs: frozenset[int] = frozenset()
        self._sink: Sink | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        await self._node.__aenter__()
        self._tasks.append(asyncio.create_task(self._measure()))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close_session()
        self._node.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def trouble(self) -> str:
        """Why the board is not ready; empty where it is."""
        return self._node.detail

    async def wait_ready(self) -> None:
        """Until the board answers. Raises NodeError, with the reason, where it does not."""
        await self._node.wait_ready(READY_GRACE_S)

    async def ability(self) -> NodeAbility | None:
        """This board says nothing about itself; its words go by UDP."""
        return None

    async def open_session(self, plan: RangingPlan, sink: Sink) -> None:
        """Report to the pad from now on. Raises UwbError where the board is away or the pad's address is none."""
        await self.close_session()
        await self._node.wait_ready(READY_GRACE_S)
        try:
            await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, remote_addr=self._pad)
        except OSError as error:
            raise NodeError(f"pad {self._pad[0]}:{self._pad[1]}: {error.strerror or error}") from error
        self._macs = frozenset(plan.pad_macs)
        self._carrier = Carrier(plan.sts_key, plan.session_a_id, is_pad=False)
        self._sink = sink
        self._tasks.append(asyncio.create_task(self._greet()))

    async def send(self, frame: bytes) -> None:
        """Send a frame to the pad. Raises NodeError without a session; whether it is heard nobody knows."""
        if self._carrier is None:
            raise NodeError("no session is open")
        self._out(self._carrier.words(frame))

    async def answer_in_blinks(self, answer: bytes) -> None:
        """This board does not blink; nothing to do."""

    async def close_session(self) -> None:
        """Report nothing more. Never raises."""
        self._carrier = self._sink = None
        measuring, greeting = self._tasks[:1], self._tasks[1:]
        self._tasks = measuring
        for task in greeting:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await self._gone.wait()

    # asyncio.DatagramProtocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is there."""
        # Older Python versions do not derive their transports from the class that they implement.
        self._transport = cast("asyncio.DatagramTransport", transport)
        self._gone.clear()

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket is closed."""
        del exc
        self._gone.set()

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Something came; only this session's pad is heard."""
        del addr  # authenticated by its tag, not by where it came from
        if self._carrier is None or self._sink is None:
            return
        try:
            content = self._carrier.open(data)
        except Dwm1001DecodeError as error:
            _log.debug("datagram: %s", error)
            return
        if isinstance(content, Words):
            self._sink(DataHeard(content.frame))

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet, or any more."""
        _log.debug("the pad's address: %s", exc)

    def _out(self, datagram: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(datagram)

    async def _greet(self) -> None:
        while self._carrier is not None:
            self._out(self._carrier.hello(self._board))
            await asyncio.sleep(HELLO_S)

    async def _measure(self) -> None:
        async for timed in self._node.reports():
            report = timed.report
            if self._carrier is None or self._sink is None or self._board is not None:
                continue
            if not isinstance(report, LocationReport) or report.damaged:
                continue  # rounds are plenty; one in doubt is not worth having
            rows = [(row.address, row.usable_mm) for row in report.distances if row.usable_mm is not None]
            rows = [row for row in rows if row[0] in self._macs]
            if not rows:
                continue
            self._out(self._carrier.ranges(rows))
            for mac, range_mm in rows:
                self._sink(OwnRange(mac, timed.t_ms, range_mm))
