"""One message of each kind as pads, drones and the server say it, made by their own code; the same each time."""

from __future__ import annotations

import asyncio
import json
from types import SimpleNamespace
from typing import Any

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import Claim
from wonderland.telemetry import Credentials
from wonderland_edge_agent.drift import DriftState
from wonderland_edge_agent.health import health_record
from wonderland_edge_agent.radios import AnchorState
from wonderland_edge_agent.receiver import Assembler, ReceiverCounts
from wonderland_edge_agent.receiver.findings import FindingGate, Position, two_places
from wonderland_edge_agent.receiver.tracks import DroneTrack
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.session import actions as do
from wonderland_edge_agent.spool import Spool, SpoolStatus
from wonderland_edge_agent.uplink import UplinkProtocol
from wonderland_remote_id import (
    BasicId,
    CategoryEu,
    ClassEu,
    ClassificationType,
    DescriptionType,
    HorizontalAccuracy,
    Location,
    OperationalStatus,
    OperatorId,
    Pack,
    SelfId,
    System,
    UaType,
    encode,
)
from wonderland_remote_id.drip.observer import Observation
from wonderland_uav_agent.requests import Requests

T0 = 1_760_000_400_000
SERIAL = "1581F5FKD229400A1234"
SESSION = SimpleNamespace(session_id="5e" * 32, uav_id=SERIAL, requested_ms=T0)
NONCE = encoding.to_base64url(bytes(range(32)))
SIGNED = Observation(
    state="refused", format="wrapper", det="2001:30:280:1405:1:2:3:4", t_ms=T0 + 5, signer="HDA 20", reason="a replay"
)


def place(**changes: Any) -> Location:
    fields: dict[str, Any] = {
        "lat_e7": 604_518_000,
        "lon_e7": 222_666_000,
        "status": OperationalStatus.AIRBORNE,
        "altitude_mm": 42_000,
        "height_mm": 12_500,
        "pressure_altitude_mm": 40_500,
        "speed_mm_s": 5_000,
        "track_cdeg": 9_000,
        "vertical_mm_s": -500,
        "horizontal_accuracy": HorizontalAccuracy.M_3,
        "after_hour_ms": T0 % 3_600_000,
        "time_accuracy_ms": 100,
    }
    return Location(**fields | changes)


def tracks() -> list[Any]:
    """The bodies of tracks: the barest, and one with everything that there is."""
    assembler = Assembler(T0)
    bare = Location(lat_e7=-1, lon_e7=1)
    found = [assembler.feed(encode(Pack(messages=(BasicId(uas_id="x"), bare))), source="a", transport="udp", now_ms=T0)]
    everything = (
        BasicId(uas_id=SERIAL, ua_type=UaType.HELICOPTER_OR_MULTIROTOR),
        place(),
        OperatorId(operator_id="FIN87astrdge12k8-xyz"),
        SelfId(text="<b>Engine</b> fire é"[:19], description_type=DescriptionType.EMERGENCY),
        System(
            operator_lat_e7=604_518_100,
            operator_lon_e7=222_666_100,
            operator_altitude_mm=20_000,
            classification=ClassificationType.EU,
            category=CategoryEu.OPEN,
            uas_class=ClassEu(1),
            area_count=3,
            area_radius_mm=120_000,
            area_ceiling_mm=90_000,
            area_floor_mm=1_000,
        ),
    )
    for step, (source, transport, counter) in enumerate([("a", "wifi-nan", 1), ("b", "ble5", 9), ("a", "wifi-nan", 4)]):
        frame = encode(Pack(messages=(everything[0], place(lat_e7=604_518_000 + step), *everything[2:])))
        heard = assembler.feed(
            frame, source=source, transport=transport, now_ms=T0 + 200 * step, rssi_dbm=-61, counter=counter
        )
        if step:
            assembler.feed(frame, source="c", transport=transport, now_ms=T0 + 200 * step + 1)
        else:
            assembler._drones[SERIAL].take_signature(SIGNED)
        found.append(heard)
    return [each.track for each in found if each is not None]


def finding() -> Any:
    here = Position(604_518_000, 222_666_000, 3_000, T0, T0, "wifi-nan")
    there = Position(604_618_000, 222_666_000, None, T0 - 500, None, "ble4")
    gate = FindingGate()
    gate.put(two_places(SERIAL, here, there))
    (found,) = gate.take_findings()
    return found.body


def healths() -> list[Any]:
    spool = SpoolStatus(
        spool="ab" * 16, records=3, bytes=900, evidence_bytes=10, dropped=1, last_seq=12, acknowledged=9, reason=""
    )
    counts = ReceiverCounts(frames=10, bad=1, heard=7)
    anchors = [AnchorState("A0", "up", "fine", "1.0"), AnchorState("A1", "silent", "no report", None)]
    moved = DriftState("moved", T0, 7, anchor_id="A3", off_mm=114, sigma_mm=12, common_mm=-3, since_ms=T0 - 9)
    drifting = DriftState("drifting", T0, 7, common_mm=-180, since_ms=T0 - 9)
    return [
        health_record([], spool, counts, 0),
        health_record(anchors, spool, counts, 7, moved),
        health_record(anchors, spool, counts, 7, drifting),
        health_record(anchors, spool, counts, 7, DriftState("ok", T0, 7)),
    ]


class FakeSpool(Spool):
    """Keeps the encoded records that it is given."""

    def __init__(self) -> None:
        self.kept: list[tuple[str, int, str]] = []

    def offer(self, *arguments: Any) -> None:
        self._keep(*arguments)

    async def append(self, *arguments: Any, evidence: bool, ends_session: str | None = None) -> int:
        self._keep(*arguments)
        return 1

    def _keep(self, kind: str, t_ms: int, body: Any) -> None:
        self.kept.append((kind, t_ms, encoding.encode(dict(body)).decode()))


async def by_the_reporter() -> list[tuple[str, int, str]]:
    """(kind, t_ms, body) of what a session's reporter writes, and of other telemetry that goes through it."""
    spool = FakeSpool()
    drone = DroneTrack(None, None, 4)
    for observation in (SIGNED, SIGNED):
        drone.take_signature(observation)
    reporter = SpoolReporter(spool, lambda uav_id, since_ms: drone.signature(since_ms))
    reporter.step(SESSION, do.ReportStep("poll", T0 + 1))
    reporter.step(SESSION, do.ReportStep("range", T0 + 2, ok=False, detail='anchors silent: “A1” \\ "A2" ' + "x" * 400))
    verdict = SimpleNamespace(
        estimate=SimpleNamespace(lat_e7=604_518_900, lon_e7=222_666_000, east_mm=10, north_mm=-1_000),
        covariance=SimpleNamespace(ee_mm2=100, en_mm2=-5, nn_mm2=90),
        rounds=12,
        signed=SimpleNamespace(likelihood_ppm=900_000),
        estimate_ms=None,
    )
    reporter.estimate(SESSION, do.ReportEstimate(verdict, {"A1": -1, "A0": 4_000}, T0 + 3))
    steps = {"poll": T0 + 1, "range": T0 + 2}
    reporter.finish(SESSION, do.Finish("cancelled", "timeout", T0 + 4, tx_id="0f" * 32), steps, settled=True)
    reporter.ended("6e" * 32, "decided", "", T0 + 5)
    await reporter.drain()
    return spool.kept


def by_the_uplink() -> str:
    """A pad's hello."""
    credentials = Credentials(
        agent="pad", id="pad-1", msp_id="PadMSP", certificate_pem="-----BEGIN\nö-----\n", sign=lambda text: text[:70]
    )
    protocol = UplinkProtocol(credentials, "ab" * 16)
    challenge = {"type": "challenge", "nonce": NONCE, "server": "wonderland", "t_ms": T0}
    return protocol.receive(json.dumps(challenge)).text


class FakeSocket:
    """A server that says what it is told to, and hears."""

    def __init__(self, *says: dict[str, Any]) -> None:
        self.says = [json.dumps(each) for each in says]
        self.heard: list[str] = []

    async def recv(self) -> str:
        return self.says.pop(0)

    async def send(self, text: str | bytes) -> None:
        self.heard.append(text if isinstance(text, str) else text.decode())

    def __aiter__(self):
        return self

    transport = SimpleNamespace(get_extra_info=lambda _name: None)

    async def __anext__(self) -> str:
        if not self.says:
            raise StopAsyncIteration
        return self.says.pop(0)


async def by_the_drone() -> list[str]:
    """A drone's hello, its position, and two answers."""
    who = Credentials(
        agent="uav", id="uav-1", msp_id="FleetMSP", certificate_pem="-----BEGIN-----\n", sign=lambda text: text[:70]
    )
    claim = Claim(
        lat_e7=604_518_000, lon_e7=-222_666_000, height_mm=42_000, accuracy_mm=1_500, height_accuracy_mm=2_500, t_ms=T0
    )

    async def decide(wish: Any) -> str:
        return "" if wish.action == "land" else "the wind is “strong”"

    requests = Requests("ws://x", who, decide, lambda: claim)
    requests._spool = "cd" * 16
    wish = {"type": "please_prove", "request_id": "0" * 32, "pad_id": "pad-1", "action": "land", "expires_ms": T0}
    socket = FakeSocket(
        {"type": "challenge", "nonce": NONCE, "server": "wonderland", "t_ms": T0},
        {"type": "welcome", "acknowledged": 0},
        {"type": "something later", "x": None},
        wish,
        wish | {"request_id": "1" * 32, "action": "dock"},
    )
    await requests._greet(socket)
    telling = asyncio.create_task(requests._tell(socket))
    while len(socket.heard) < 2:
        await asyncio.sleep(0)
    telling.cancel()
    await requests._listen(socket)
    return socket.heard


async def everything(canonical: Any) -> dict[str, list[Any]]:
    """All that agents say. ``canonical``: the canonical text of a body, as the spool keeps it."""
    reported = await by_the_reporter()
    said: dict[str, list[Any]] = {
        "track": [canonical(each) for each in tracks()],
        "finding": [canonical(finding())],
        "health": [canonical(each) for each in healths()],
    }
    for kind, t_ms, body in reported:
        said.setdefault(kind, []).append([t_ms, body])
    said["pad hello"] = [by_the_uplink()]
    said["drone"] = await by_the_drone()
    return said
