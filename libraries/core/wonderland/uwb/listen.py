"""What a board measures, for people at a bench: reports of either kind of board as plain documents, and their sum."""

from __future__ import annotations

import math
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, field, fields
from enum import IntFlag
from typing import Any, Final

from wonderland.uwb.blinks import blinks_beside
from wonderland.uwb.reach import reach
from wonderland_fira_uci.dwm1001 import BoardPosition, Dwm1001Node, HeardPosition, LocationReport, Mode
from wonderland_fira_uci.errors import NodeError, UwbError
from wonderland_fira_uci.events import RangeMeasurement, RangingSilent, SessionFailed, SessionInterrupted
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import Opener
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.config import (
    AppConfig,
    DeviceRole,
    DeviceType,
    MultiNodeMode,
    ParameterId,
    SessionConfig,
    StsConfig,
    least_slots,
)
from wonderland_fira_uci.uci.status import SessionType, Status, status_name

READY_S: Final = 10.0
SLOT_US: Final = 2_000
_PUBLIC_STS: Final = ((ParameterId.VENDOR_ID, b"\x08\x07"), (ParameterId.STATIC_STS_IV, bytes(range(1, 7))))
"""The static sequence that every evaluation kit comes with. Good for a bench, worthless as evidence."""

Document = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class UciBench:
    """One session of a UCI node for trying it out. ``key``: provisioned STS; without it the public static one."""

    mac: int
    peers: tuple[int, ...]
    leads: bool
    session_id: int = 1
    channel: int = 9
    interval_ms: int = 200
    key: bytes | None = field(default=None, repr=False)
    slot_us: int = SLOT_US
    blink: bool = False
    """Blink as well, for nodes that time-stamp (a calibration run)."""
    responders: int = 0
    """How many nodes answer in a round; 0: as many as there are peers. One that follows has to be told."""

    def config(self) -> SessionConfig:
        """The session that the node is told. Raises NodeError where a round takes too long, UciEncodeError."""
        responders = self.responders or len(self.peers)
        slots = least_slots(responders)
        round_ms = -(-slots * self.slot_us // 1_000)
        if round_ms > self.interval_ms:
            raise NodeError(
                f"a round of {responders} nodes takes {round_ms} ms, and the interval is {self.interval_ms} ms: "
                "lengthen it"
            )
        app = AppConfig(
            device_type=DeviceType.CONTROLLER if self.leads else DeviceType.CONTROLEE,
            device_role=DeviceRole.INITIATOR if self.leads else DeviceRole.RESPONDER,
            multi_node_mode=MultiNodeMode.ONE_TO_MANY if responders > 1 else MultiNodeMode.UNICAST,
            mac_address=self.mac,
            destination_macs=self.peers,
            interval_ms=self.interval_ms,
            slots_per_round=slots,
            slot_duration_rstu=self.slot_us * RSTU_PER_MS // 1_000,
            channel=self.channel,
            rssi_reporting=1,
            sts_config=StsConfig.STATIC if self.key is None else StsConfig.PROVISIONED,
            session_key=self.key,
            extra=_PUBLIC_STS if self.key is None else (),
        )
        return SessionConfig(session_id=self.session_id, app=app, session_type=SessionType.RANGING)


async def dwm1001(port: str, opener: Opener, mode: Mode, clock: Callable[[], int]) -> AsyncGenerator[Document, None]:
    """A DWM1001's reports, for ever. Raises NodeError where the board does not report within ten seconds."""
    async with Dwm1001Node(opener, name=port, mode=mode, clock=clock) as node:
        await node.wait_ready(READY_S)
        yield {"kind": "ready", "t_ms": clock(), "board": "dwm1001", "firmware": node.firmware or "not told"}
        async for timed in node.reports():
            report = timed.report
            if isinstance(report, HeardPosition):
                document: Document = {"kind": "heard", "t_ms": timed.t_ms, "address": f"{report.address:04x}"}
            else:
                document = _location(report, timed.t_ms)
            if report.position is not None:
                document["position"] = _place(report.position)
            yield document


async def uci(port: str, opener: Opener, bench: UciBench, clock: Callable[[], int]) -> AsyncGenerator[Document, None]:
    """A UCI node's reports in one session, until that fails. Raises UwbError where the node does not take it."""
    async with UwbNode(opener, name=port, clock=clock) as node:
        await node.wait_ready(READY_S)
        session = await node.open_session(bench.config())
        if bench.blink and bench.key is not None:
            try:
                plan = blinks_beside(
                    bench.session_id,
                    bench.peers,
                    bench.mac,
                    bench.key,
                    bench.interval_ms,
                    channel=bench.channel,
                    slot_us=bench.slot_us,
                )
                await node.open_session(plan.uav_tag())
            except UwbError as error:
                text = f"{port}: the board refuses to blink ({error})"
                raise NodeError(f"{text}; without --blink it ranges, and no clock is calibrated") from error
        info = node.info
        firmware = "not told" if info is None else f"UCI 0x{info.uci_version:04x}"
        yield {"kind": "ready", "t_ms": clock(), "board": "uci", "firmware": firmware}
        async for event in session.events():
            match event:
                case RangeMeasurement():
                    yield _measurement(event)
                case RangingSilent():
                    yield {"kind": "ranges", "t_ms": event.t_ms, "sequence": event.sequence, "ranges": []}
                case SessionInterrupted():
                    yield {"kind": "lost", "t_ms": event.t_ms, "detail": event.detail}
                case SessionFailed():
                    raise event.error
                case _:
                    pass


async def capabilities_of(port: str, opener: Opener) -> Document | None:
    """What a UCI node says that it can do, and what that bears on a pad and on a drone; None where it does not say.

    Raises UwbError where no node answers within ten seconds.
    """
    async with UwbNode(opener, name=port) as node:
        await node.wait_ready(READY_S)
        said = node.capabilities
    if said is None:
        return None
    # One node alone: as the pad's one that speaks, and as each of the others (hence twice); as the drone's.
    places = {"pad": reach({"this node, first": said, "this node, after it": said}), "drone": reach({}, said)}
    document: Document = {"capabilities": {each.name: _plain(getattr(said, each.name)) for each in fields(said)}}
    for place, found in places.items():
        document[place] = {"assurance": found.level, "missing": [str(each) for each in found.missing]}
    return document


def _plain(value: object) -> object:
    """A field of a node's capabilities as JSON has it; masks by the names of their bits."""
    if isinstance(value, IntFlag):
        known = [str(each.name).lower() for each in type(value) if each in value]
        rest = int(value) & ~sum(type(value))
        return known + ([f"0x{rest:x}"] if rest else [])
    if isinstance(value, tuple):
        return [f"0x{each[0]:02x}={each[1].hex()}" if isinstance(each, tuple) else each for each in value]
    return value


@dataclass(slots=True)
class Tally:
    """Count, mean and spread of one peer's ranges (Welford's recurrence)."""

    count: int = 0
    missing: int = 0
    first_ms: int = 0
    last_ms: int = 0
    mean_mm: float = 0.0
    _squares: float = 0.0

    def add(self, t_ms: int, range_mm: int | None) -> None:
        """One range; None where the board had none."""
        if range_mm is None:
            self.missing += 1
            return
        self.first_ms = self.first_ms or t_ms
        self.last_ms = t_ms
        self.count += 1
        delta = range_mm - self.mean_mm
        self.mean_mm += delta / self.count
        self._squares += delta * (range_mm - self.mean_mm)

    @property
    def sigma_mm(self) -> float:
        """Sample standard deviation; 0 below two ranges."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else 0.0

    @property
    def rate_hz(self) -> float:
        """Ranges in a second; 0 below two."""
        span_ms = self.last_ms - self.first_ms
        return (self.count - 1) * 1000 / span_ms if span_ms > 0 else 0.0


class Summary:
    """Everything that was measured, by peer."""

    def __init__(self) -> None:
        self.ready = False
        """Whether the board reported at all."""
        self.rounds = 0
        self.damaged = 0
        self.peers: dict[str, Tally] = {}

    def add(self, document: Document) -> None:
        """Take a document of ``dwm1001`` or ``uci``."""
        self.ready = True
        if document["kind"] != "ranges":
            return
        self.rounds += 1
        if document.get("damaged"):
            self.damaged += 1
            return
        for row in document["ranges"]:
            self.peers.setdefault(row["address"], Tally()).add(document["t_ms"], row.get("range_mm"))

    def document(self) -> Document:
        """JSON values, as `--json` prints them."""
        return {
            "kind": "summary",
            "rounds": self.rounds,
            "damaged": self.damaged,
            "peers": {
                address: {
                    "ranges": tally.count,
                    "missing": tally.missing,
                    "rate_hz": round(tally.rate_hz, 2),
                    "mean_mm": round(tally.mean_mm, 1) if tally.count else None,
                    "sigma_mm": round(tally.sigma_mm, 1) if tally.count > 1 else None,
                }
                for address, tally in sorted(self.peers.items())
            },
        }


def _location(report: LocationReport, t_ms: int) -> Document:
    ranges: list[Document] = []
    for row in report.distances:
        entry: Document = {"address": f"{row.address:04x}"}
        if row.range_mm is not None:
            entry["range_mm"] = row.range_mm
        if row.quality_percent is not None:
            entry["quality_percent"] = row.quality_percent
        ranges.append(entry)
    document: Document = {"kind": "ranges", "t_ms": t_ms, "ranges": ranges}
    if report.damaged:
        document["damaged"] = True
    if report.device_us is not None:
        document["device_us"] = report.device_us
    return document


def _measurement(event: RangeMeasurement) -> Document:
    row: Document = {"address": f"{event.peer_mac:04x}"}
    if event.range_mm is not None:
        row["range_mm"] = event.range_mm
    if event.status != Status.OK:
        row["status"] = status_name(event.status)
    if event.nlos is not None:
        row["obstructed"] = event.nlos
    if event.rssi_dbm is not None:
        row["rssi_dbm"] = event.rssi_dbm
    return {"kind": "ranges", "t_ms": event.t_ms, "sequence": event.sequence, "ranges": [row]}


def _place(position: BoardPosition) -> Document:
    place: Document = {"x_mm": position.x_mm, "y_mm": position.y_mm, "z_mm": position.z_mm}
    if position.quality_percent is not None:
        place["quality_percent"] = position.quality_percent
    return place
