"""Pads of DWM1001 boards, whose words go by UDP (``dwm1001.carrier``): the drone measures, or the pad's tags do.

* ``ReportedRadios``: the pad has anchors. They answer the drone's tag and tell the pad nothing; they need power only,
  and rounds come from the drone with its words.
* ``TagRadios``: the network turned round. The drone carries an anchor, and each of the pad's tags measures its own
  range on its own serial port. Nothing on the air ties these ranges to the session: any board with that address would
  do.

What the pad makes of the rounds is the same as with nodes that speak UCI; the evidence says how they came about. Both
have assurance 0.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Final, Self, cast

from wonderland.clock import Clock
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.radios.anchors import MIN_ANCHORS, AnchorPort, AnchorState, RadiosError, Sink
from wonderland_edge_agent.session.events import AnchorRange, DataHeard
from wonderland_fira_uci.dwm1001 import Dwm1001Node, LocationReport, Timings
from wonderland_fira_uci.dwm1001.carrier import Carrier, Content, Hello, Ranges, Words
from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError
from wonderland_fira_uci.errors import NodeError

_log = logging.getLogger(__name__)

SILENT_MS: Final = 1_000
FIRMWARE: Final = "drone-reported (DWM1001)"
FIRMWARE_TAG: Final = "tag (DWM1001)"
Address = tuple[str, int]


class WordsByUdp(asyncio.DatagramProtocol):
    """Use as an asynchronous context manager; the port is bound as long as it is open. Port 0: see ``address``."""

    interval_ms: Final = 100
    """Such boards range ten times a second at most."""
    highest: Final = 0
    """Nothing binds their ranges to a session."""

    def __init__(self, listen: Address, clock: Clock) -> None:
        self._listen = listen
        self._clock = clock
        self._transport: asyncio.DatagramTransport | None = None
        self._carrier: Carrier | None = None
        self._peer: Address | None = None
        self._anchors: dict[int, str] = {}
        self._heard_ms: dict[str, int] = {}
        self._sink: Sink | None = None
        self._gone = asyncio.Event()
        self.datagrams_bad = 0
        """Datagrams that belonged to no session under way, or were forged or repeated."""

    async def __aenter__(self) -> Self:
        """Bind. Raises RadiosError."""
        try:
            await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, local_addr=self._listen)
        except OSError as error:
            host, port = self._listen
            raise RadiosError(f"uwb.listen: {host}:{port} cannot be bound ({error.strerror or error})") from error
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close_session()
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await self._gone.wait()

    @property
    def address(self) -> Address:
        """Where drones reach this pad."""
        if self._transport is None:
            raise NodeError("the pad's port for drones is not open")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    async def open_session(self, plan: RangingPlan, anchor_ids: Sequence[str], sink: Sink) -> str | None:
        """Listen for this session's drone; its reports go to ``sink``. Raises RadiosError."""
        await self.close_session()
        if len(anchor_ids) < MIN_ANCHORS:
            raise RadiosError(f"{len(anchor_ids)} anchors; a position needs {MIN_ANCHORS}")
        self._anchors = dict(zip(plan.pad_macs, anchor_ids, strict=True))
        self._heard_ms.clear()
        self._carrier = Carrier(plan.sts_key, plan.session_a_id, is_pad=True)
        self._sink = sink
        return FIRMWARE

    async def listen(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        """These anchors time-stamp nothing for the pad: always raises RadiosError."""
        del plan, anchor_ids, sink
        raise RadiosError("DWM1001 anchors tell the pad no time stamps, so that it cannot be a witness")

    roll_wanted: Final = False

    async def call_roll(self, macs: Mapping[str, int], channel: int, *, expected: bool = False) -> None:
        """These anchors say nothing to the pad: nothing to do."""

    async def send(self, frame: bytes) -> None:
        """Send a frame to the drone. Raises NodeError while nobody knows where it is."""
        if self._carrier is None or self._transport is None:
            raise NodeError("no session is open")
        if self._peer is None:
            raise NodeError("the drone has not been heard yet")
        self._transport.sendto(self._carrier.words(frame), self._peer)

    async def close_session(self) -> None:
        """Hear nobody. Never raises."""
        self._carrier = self._peer = self._sink = None

    # asyncio.DatagramProtocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The port is bound."""
        # Older Python versions do not derive their transports from the class that they implement.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """The port is free again."""
        del exc
        self._gone.set()

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Something came from somewhere; only this session's drone is heard."""
        if self._carrier is None or self._sink is None:
            self.datagrams_bad += 1
            return
        try:
            content = self._carrier.open(data)
        except Dwm1001DecodeError as error:
            self.datagrams_bad += 1
            _log.debug("from %s: %s", addr, error)
            return
        self._peer = addr
        self._take(content, self._sink)

    def error_received(self, exc: Exception) -> None:
        """A datagram came back: the link repeats it."""
        _log.debug("the drone's address: %s", exc)

    def _take(self, content: Content, sink: Sink) -> None:
        """What this session's drone sent."""
        raise NotImplementedError


class ReportedRadios(WordsByUdp):
    """A pad of anchors: the drone reports what its tag measured."""

    measured_by: Final = "uav"
    sts: Final = "static"

    def states(self) -> list[AnchorState]:
        """The anchors of the last session: up while the drone reports ranges to them. No pad hears them itself."""
        now_ms = self._clock()
        return [
            AnchorState(
                anchor_id,
                "up" if now_ms - self._heard_ms.get(anchor_id, -SILENT_MS) < SILENT_MS else "silent",
                "seen only in what drones report",
                FIRMWARE,
            )
            for anchor_id in self._anchors.values()
        ]

    def _take(self, content: Content, sink: Sink) -> None:
        if isinstance(content, Words):
            sink(DataHeard(content.frame))
        elif isinstance(content, Ranges):
            t_ms = self._clock()
            for address, range_mm in content.rows:
                with contextlib.suppress(KeyError):  # another pad's anchor in reach
                    anchor_id = self._anchors[address]
                    self._heard_ms[anchor_id] = t_ms
                    sink(AnchorRange(anchor_id, t_ms, range_mm))


class TagRadios(WordsByUdp):
    """A pad of tags, each on its serial port: each measures its own range to the anchor that the drone carries."""

    measured_by: Final = "pad"
    sts: Final = "unbound"

    def __init__(
        self, ports: Sequence[AnchorPort], listen: Address, clock: Clock, *, timings: Timings | None = None
    ) -> None:
        super().__init__(listen, clock)
        self._nodes = {
            each.anchor_id: Dwm1001Node(each.port, name=f"anchor {each.anchor_id}", clock=clock, timings=timings)
            for each in ports
        }
        self._readers: list[asyncio.Task[None]] = []
        self._board: int | None = None
        """Which board the session's drone carries, by its own word."""

    async def __aenter__(self) -> Self:
        """Bind, and connect the tags. Raises RadiosError."""
        await super().__aenter__()
        for anchor_id, node in self._nodes.items():
            await node.__aenter__()
            self._readers.append(asyncio.create_task(self._read(anchor_id, node)))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await super().__aexit__(kind, error, trace)
        for node in self._nodes.values():
            node.close()
        await asyncio.gather(*self._readers, return_exceptions=True)

    def states(self) -> list[AnchorState]:
        """Each tag as it is now: it measures nothing while no drone's board is in reach."""
        return [
            AnchorState(anchor_id, "up" if node.is_ready else "down", node.detail, FIRMWARE_TAG)
            for anchor_id, node in self._nodes.items()
        ]

    async def close_session(self) -> None:
        """Hear nobody. Never raises."""
        await super().close_session()
        self._board = None

    def _take(self, content: Content, sink: Sink) -> None:
        if isinstance(content, Words):
            sink(DataHeard(content.frame))
        elif isinstance(content, Hello):
            self._board = content.board

    async def _read(self, anchor_id: str, node: Dwm1001Node) -> None:
        async for timed in node.reports():
            report = timed.report
            if self._sink is None or self._board is None or not isinstance(report, LocationReport) or report.damaged:
                continue
            for row in report.distances:
                if row.address == self._board and row.usable_mm is not None:
                    self._sink(AnchorRange(anchor_id, timed.t_ms, row.usable_mm))
