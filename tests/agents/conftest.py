"""A real embedded ledger with the contract, a commissioned pad, virtual nodes on pseudo-terminals, both agents."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import math
import random
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec

from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs import encoding, keys
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import TICKS_PER_SECOND, Claim, Evidence, Party, Session
from wonderland.proofs.statement import statement
from wonderland.proofs.transcript import transcript_of
from wonderland.proofs.verdict import decide
from wonderland_chaincode.contract import CONTRACT
from wonderland_edge_agent.assembly import open_pad
from wonderland_edge_agent.geodesy import frame_at
from wonderland_edge_agent.session import actions as pad_do
from wonderland_edge_agent.session import events as pad_on
from wonderland_edge_agent.session.machine import PadSession
from wonderland_edge_agent.session.timing import PadTiming
from wonderland_edge_agent.settings import parse
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.signing import der_from_raw, key_signer, raw_from_der, verify
from wonderland_simulator.uci_node import Air, Measurement, PtyPort, VirtualNode
from wonderland_uav_agent.agent import UavAgent
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.radio import UavRadio
from wonderland_uav_agent.session import actions as uav_do
from wonderland_uav_agent.session import events as uav_on
from wonderland_uav_agent.session.machine import UavSession
from wonderland_uav_agent.session.timing import UavTiming

FRAME = frame_at(604_518_000, 222_666_000, 30_000)
ANCHORS = {
    "A1": (2_000, 2_000, 200),
    "A2": (-2_000, 2_000, 1_200),
    "A3": (-2_000, -2_000, 200),
    "A4": (2_000, -2_000, 200),
}
HERE = (4_000.0, 3_000.0, 6_000.0)
"""Where the drone hovers, east, north, up in mm."""
FAST_PAD = PadTiming(
    open_ms=4_000,
    reply_ms=2_500,
    silence_ms=1_000,
    identity_ms=2_000,
    echo_ms=2_000,
    confirm_ms=2_000,
    submit_reserve_ms=1_500,
    completion_ms=1_500,
    lapse_margin_ms=300,
)
FAST_UAV = UavTiming(open_ms=4_000, pad_silence_ms=2_500, verdict_grace_ms=1_000)


def commissioning(now_ms: int, *, timed: bool = False) -> Commissioning:
    """``timed``: the nodes share a clock, good to 5 mm."""
    clock = {"clock_offset_mm": 0, "clock_sigma_mm": 5} if timed else {}
    return Commissioning.parse(
        ({"timestamp_sigma_mm": 30} if timed else {})
        | {
            "frame": FRAME.to_json(),
            "anchors": [
                {
                    "anchor_id": name,
                    "mac": 0xA000 + index,
                    "east_mm": east,
                    "north_mm": north,
                    "up_mm": up,
                    "survey_sigma_mm": 3,
                    "bias": [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 5}],
                    **clock,
                }
                for index, (name, (east, north, up)) in enumerate(ANCHORS.items())
            ],
            "range_sigma_mm": 25,
            "installation_sigma_mm": 5,
            "max_range_mm": 100_000,
            "valid_from_ms": now_ms - 3_600_000,
            "valid_until_ms": now_ms + 10**10,
            "method": "tape",
        }
    )


@dataclass
class Flight:
    """Where the drone is and where it says that it is."""

    truth: tuple[float, float, float] = HERE
    claimed: tuple[float, float, float] = HERE
    silent: set[str] = field(default_factory=set)
    noise_mm: float = 20.0
    ranged: tuple[float, float, float] | None = None
    """Where the drone's radio makes the ranges say that it is, by lies about its own time stamps."""
    clock_ms: int = 0
    """How far the drone's clock is ahead."""

    def range_mm(self, anchor: str, rng: random.Random) -> float:
        return math.dist(ANCHORS[anchor], self.ranged or self.truth) + rng.gauss(0, self.noise_mm)

    def stamp(self, place, sent_s: float, rng: random.Random) -> int:
        """Ticks of the pad's common clock when an anchor there hears what was sent then."""
        away_m = (math.dist(place, self.truth) + rng.gauss(0, 30.0)) / 1000
        return round((sent_s + away_m / 299_792_458) * TICKS_PER_SECOND) % 2**40

    def claim(self, now_ms: int) -> Claim | None:
        lat_e7, lon_e7, height_mm = to_wgs84(FRAME, *(round(value) for value in self.claimed))
        return Claim(
            lat_e7=lat_e7,
            lon_e7=lon_e7,
            height_mm=height_mm,
            accuracy_mm=500,
            height_accuracy_mm=500,
            t_ms=now_ms + self.clock_ms,
        )


class World:
    """The ledger, the air, one pad and one drone."""

    fast_pad = FAST_PAD

    def __init__(self, directory: Path, ledger: EmbeddedLedger, channel) -> None:
        self.directory = directory
        self.ledger = ledger
        self.channel = channel
        self.clock = SteadyClock()
        self.anchors = dict(ANCHORS)
        self.flight = Flight()
        self.stand = dict(ANCHORS)
        """Where the anchors really stand, mm."""
        self.rng = random.Random(5)
        self.drawn: dict[tuple[str, float], Measurement] = {}
        self.air = Air(self.measure, rng=random.Random(7), stamp=self.stamp)
        self.ports: dict[str, PtyPort] = {}
        self.acted: list = []
        self.all_identities = None

    def add_node(self, name: str) -> None:
        self.ports[name] = PtyPort(VirtualNode(name, self.air), self.directory / f"tty-{name}")
        self.ports[name].plug()

    @property
    def connection(self):
        return self.all_identities or self.ledger.connection

    def contract(self, name: str) -> ProofContract:
        gateway = Gateway(self.channel, self.connection.identity(name), self.connection.signer(name))
        return ProofContract(gateway.network(self.connection.channel), self.connection.chaincode)

    async def call(self, name: str, function: str, /, **argument) -> dict:
        gateway = Gateway(self.channel, self.connection.identity(name), self.connection.signer(name))
        contract = gateway.network(self.connection.channel).contract(self.connection.chaincode)
        return json.loads((await contract.submit_with_retry(function, encoding.encode(argument))).payload)

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        anchor = observer if observer in ANCHORS else peer
        if observer in ANCHORS and peer in ANCHORS:
            between = math.dist(self.stand[observer], self.stand[peer]) + self.rng.gauss(0, 20.0)
            return Measurement(round(between), nlos=False, rssi_dbm=-60.0)
        if anchor in self.flight.silent:
            return Measurement(None, status=0x21)
        key = (anchor, t_s)
        if key not in self.drawn:
            if len(self.drawn) > 64:
                self.drawn.clear()
            distance = self.flight.range_mm(anchor, self.rng)
            self.drawn[key] = Measurement(round(distance), nlos=False, rssi_dbm=-80.0)
        return self.drawn[key]

    def stamp(self, anchor: str, tag: str, t_s: float) -> int | None:
        return None if anchor in self.flight.silent else self.flight.stamp(self.anchors[anchor], t_s, self.rng)

    def commissioning(self, *, timed: bool = False) -> Commissioning:
        return commissioning(self.clock(), timed=timed)

    async def share_a_clock(self) -> None:
        """Commission the pad anew, for time stamps."""
        new = self.commissioning(timed=True)
        await self.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=new.to_json())

    async def set_up(self) -> None:
        now_ms = self.clock()
        await self.call(
            "pad_operator",
            "RegisterPad",
            pad_id="pad-1",
            name="Roof",
            operator_id="harbour",
            lat_e7=FRAME.lat_e7,
            lon_e7=FRAME.lon_e7,
            height_mm=FRAME.height_mm,
        )
        await self.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=commissioning(now_ms).to_json())
        await self.call(
            "fleet_operator",
            "RegisterUav",
            uav_id="uav-1",
            operator_id="fleet",
            registration="FIN87astrdge12k8",
            model="Quad",
        )
        await self.call(
            "fleet_operator",
            "RecordMaintenance",
            uav_id="uav-1",
            performed_ms=now_ms - 1_000,
            valid_until_ms=now_ms + 10**9,
            work="propellers",
        )
        await self.call(
            "admin",
            "GrantAuthorisation",
            authorisation_id="a1",
            uav_id="uav-1",
            pad_id="*",
            actions=["land", "takeoff"],
            valid_from_ms=now_ms - 1_000,
            valid_until_ms=now_ms + 10**9,
        )

    async def second_uav(self) -> None:
        """Another drone with its own identity and node."""
        DirectoryAdministration(self.ledger.directory).enrol("uav-2", role="uav", pol_id="uav-2")
        self.all_identities = Connection.load(self.directory / "ledger")
        self.add_node("uav-2")
        now_ms = self.clock()
        await self.call(
            "fleet_operator",
            "RegisterUav",
            uav_id="uav-2",
            operator_id="fleet",
            registration="FIN87astrdge12k8",
            model="Quad",
        )
        await self.call(
            "fleet_operator",
            "RecordMaintenance",
            uav_id="uav-2",
            performed_ms=now_ms - 1_000,
            valid_until_ms=now_ms + 10**9,
            work="propellers",
        )
        await self.call(
            "admin",
            "GrantAuthorisation",
            authorisation_id="a1",
            uav_id="uav-2",
            pad_id="pad-1",
            actions=["land"],
            valid_from_ms=now_ms - 1_000,
            valid_until_ms=now_ms + 10**9,
        )

    async def policy(self, **fields) -> None:
        await self.call("admin", "SetPolicy", pad_id="pad-1", action="*", policy=Policy.parse(fields).to_json())

    def settings(self, **more):
        document = {
            "pad_id": "pad-1",
            "connection": str(self.directory / "ledger" / "connection.json"),
            "identity": "pad",
            "spool": "spool",
            "anchors": [{"anchor_id": name, "port": str(self.directory / f"tty-{name}")} for name in ANCHORS],
            "remote_id": {"listen": "127.0.0.1:0"},
            "prekeys": 6,
        } | more
        return parse(document, self.directory / "pad.toml")

    @contextlib.asynccontextmanager
    async def pad(self, *, timing: PadTiming = FAST_PAD, ready: bool = True, **more):
        """The pad's agent at work."""
        async with open_pad(self.settings(**more), timing=timing) as agent:
            working = asyncio.create_task(agent.run())
            try:
                if ready:
                    async with asyncio.timeout(10):
                        await agent.wait_ready()
                yield agent
            finally:
                working.cancel()
                await asyncio.gather(working, return_exceptions=True)

    @contextlib.asynccontextmanager
    async def uav(self, *, name="uav", act=None, ledger=None, **more):
        """The drone's agent."""
        contract = ledger or self.contract(name)

        async def land(verdict) -> str:
            self.acted.append(verdict)
            return "done"

        async with (
            LedgerEvents(self.contract(name)) as events,
            UavRadio(self.directory / f"tty-{name}", self.clock) as radio,
        ):
            arguments = {
                "uav_id": self.connection.identity(name).pol_id,
                "ledger": contract,
                "events": events,
                "identity": self.connection.identity(name),
                "signer": self.connection.signer(name),
                "radio": radio,
                "position": self.flight,
                "act": act or land,
                "clock": self.clock,
                "timing": FAST_UAV,
            }
            yield UavAgent(**(arguments | more))

    async def restart_ledger(self, pause_s: float) -> None:
        """Gone for a while, then there again at the same address."""
        address = self.connection.gateway.address
        await self.ledger.stop()
        await asyncio.sleep(pause_s)
        self.ledger = open_ledger(self.directory, listen=address)
        await self.ledger.start()

    def close(self) -> None:
        for port in self.ports.values():
            port.close()
        self.air.close()


def open_ledger(directory: Path, **where) -> EmbeddedLedger:
    settings = LedgerSettings(limits=BatchLimits(time_ms=1), **where)
    return EmbeddedLedger(directory / "ledger", {"pol": CONTRACT}, settings)


@pytest.fixture(scope="session")
def prepared_ledger(tmp_path_factory):
    """A stopped ledger with the pad and the drone on it: making keys and certificates anew costs most of a second."""
    directory = tmp_path_factory.mktemp("prepared")

    async def prepare() -> None:
        ledger = open_ledger(directory)
        await ledger.start()
        async with ledger.connection.open_channel() as channel:
            await World(directory, ledger, channel).set_up()
        await ledger.stop()

    asyncio.run(prepare())
    return directory / "ledger"


@pytest.fixture
async def world(tmp_path, prepared_ledger):
    shutil.copytree(prepared_ledger, tmp_path / "ledger")
    ledger = open_ledger(tmp_path)
    await ledger.start()
    async with ledger.connection.open_channel() as channel:
        made = World(tmp_path, ledger, channel)
        for name in (*ANCHORS, "uav"):
            made.add_node(name)
        yield made
        made.close()
    await made.ledger.stop()


# --- both machines in virtual time, without any I/O ---------------------------------------------------------------


def private_key(number: int) -> ec.EllipticCurvePrivateKey:
    return ec.derive_private_key(number, ec.SECP256R1())


class Duo:
    """A pad's and a drone's machine, a perfect radio between them, and a clock that jumps from event to event.

    Each side can be silenced (``dead``) from any step on. ``pad_actions`` and ``uav_actions`` log what each wanted.
    """

    START_MS = 1_800_000_000_000

    def __init__(self, *, flight: Flight | None = None, policy: Policy | None = None, **more) -> None:
        self.now_ms = self.START_MS
        self.flight = flight or Flight()
        self.rng = random.Random(3)
        self.commissioning = commissioning(self.now_ms, timed=more.get("timed", False))
        self.blink_payload = b""
        self.blinks = 0
        self.uav_key = private_key(77)
        pad_secret, uav_secret = private_key(5), private_key(6)
        blank = Session(
            session_id="a" * 64,
            state="requested",
            pad_id="pad-1",
            uav_id="uav-1",
            action="land",
            claim=self.flight.claim(self.now_ms),
            prekey_id="k1",
            pad_key=encoding.to_base64url(keys.public_bytes(pad_secret)),
            uav_key=encoding.to_base64url(keys.public_bytes(uav_secret)),
            pad=Party(msp_id="PadMSP", certificate_sha256=hashlib.sha256(b"pad certificate").hexdigest()),
            uav=Party(
                msp_id="FleetMSP",
                certificate_sha256=hashlib.sha256(b"uav certificate").hexdigest(),
                public_key=encoding.to_base64url(keys.public_bytes(self.uav_key)),
            ),
            commissioning_sha256=encoding.digest(self.commissioning.to_json()).hex(),
            contract_version="1",
            transcript_sha256="",
            policy=policy or Policy(),
            requested_ms=self.now_ms,
            expires_ms=self.now_ms + (policy or Policy()).session_ttl_ms,
        )
        digest = transcript_of(blank, "wonderland").digest()
        self.session = replace(blank, transcript_sha256=digest.hex())
        secret = keys.shared_secret(pad_secret, encoding.from_base64url(blank.uav_key))
        derived = keys.derive(secret, digest)
        self.pad = PadSession(
            self.session,
            self.commissioning,
            more.get("pad_keys") or derived,
            certificate=more.get("pad_certificate", b"pad certificate"),
            broadcasts=more.get("heard", lambda since_ms: ()),
            random_octets=lambda count: bytes(range(1, count + 1)),
            now_ms=self.now_ms,
            drift_sigma_mm=more.get("drift_sigma_mm"),
            whole_certificate=more.get("whole_certificate", False),
        )
        self.uav = UavSession(
            self.session,
            self.commissioning,
            more.get("uav_keys") or derived,
            certificate=more.get("uav_certificate", b"uav certificate"),
            claims=self.flight.claim,
            now_ms=self.now_ms,
            whole_certificate=more.get("whole_certificate", False),
            **({"broadcasts": more["sent"]} if "sent" in more else {}),
        )
        self.keys = derived
        self.pad_actions: list = []
        self.uav_actions: list = []
        self.dead: set[str] = set()
        self.mute: set[str] = set()
        """Who is not heard, although alive."""
        self.ledger_state = "requested"
        self.ledger_end = ""
        self.evidence = None
        self.verdict = None
        self.ledger_away = False
        self.when: list = []
        """(condition, consequence): each is tried after every event until it fires."""
        self._round_ms = self.now_ms
        self._b_ms = self.now_ms
        self._ranging = {"pad": False, "uav": False}
        self._a_frames: list[bytes] = []
        self._b_frames: list[bytes] = []

    def on(self, condition, consequence) -> None:
        self.when.append((condition, consequence))

    def tell_pad(self, event) -> None:
        if "pad" not in self.dead:
            self._pad(self.pad.handle(event, self.now_ms))

    def tell_uav(self, event) -> None:
        if "uav" not in self.dead:
            self._uav(self.uav.handle(event, self.now_ms))

    def run(self, limit_ms: int = 200_000) -> None:
        """Until both have ended or are dead."""
        self._pad(self.pad.start(self.now_ms))
        self._uav(self.uav.start(self.now_ms))
        end_ms = self.now_ms + limit_ms
        while self.now_ms < end_ms and not (self._over("pad", self.pad) and self._over("uav", self.uav)):
            self.now_ms += 5
            self._radio()
            if "pad" not in self.dead:
                self._a_or_b()
            self.tell_pad(pad_on.Tick()) if self._due(self.pad) else None
            self.tell_uav(uav_on.Tick()) if self._due(self.uav) else None
            for entry in list(self.when):
                if entry[0](self):
                    self.when.remove(entry)
                    entry[1](self)

    def _over(self, who, machine) -> bool:
        return who in self.dead or machine.phase.value == "ended"

    def _due(self, machine) -> bool:
        tick_ms = machine.next_tick_ms()
        return tick_ms is not None and self.now_ms >= tick_ms

    def _a_or_b(self) -> None:
        frames_ms = self.pad.next_frames_ms()
        if frames_ms is not None and self.now_ms >= frames_ms:
            self._b_frames.extend(self.pad.frames_to_send(self.now_ms, 4))
            self.tell_pad(pad_on.Tick())

    def _radio(self) -> None:
        if "uav" not in self.dead:
            frames_ms = self.uav.next_frames_ms()
            if frames_ms is not None and self.now_ms >= frames_ms:
                self._a_frames.extend(self.uav.frames_to_send(self.now_ms, 4))
        both = all(self._ranging.values()) and not self.dead
        if self.now_ms >= self._b_ms + 100:
            self._b_ms = self.now_ms
            frames, self._b_frames = self._b_frames, []
            if both and "pad" not in self.mute:
                for frame in frames:
                    self.tell_uav(uav_on.DataHeard(frame))
        if self.now_ms >= self._round_ms + 50:
            self._round_ms = self.now_ms
            frames, self._a_frames = self._a_frames, []
            if not both or "uav" in self.mute:
                return
            self.blinks += 1
            for name, place in ANCHORS.items():
                if name in self.flight.silent:
                    continue
                range_mm = round(self.flight.range_mm(name, self.rng) / 10) * 10
                self.tell_pad(pad_on.AnchorRange(name, self.now_ms, range_mm))
                if self.pad.plan.blinks is not None:
                    # The counter's end lies within the session.
                    ticks = self.flight.stamp(place, 17.0 + (self.now_ms - self.START_MS) / 1000, self.rng)
                    self.tell_pad(pad_on.FrameHeard(name, self.now_ms, self.blinks, ticks, self.blink_payload))
                self.tell_uav(uav_on.OwnRange(0xA000 + list(ANCHORS).index(name), self.now_ms, range_mm))
            for frame in frames:
                self.tell_pad(pad_on.DataHeard(frame))

    def _pad(self, actions) -> None:
        for action in actions:
            self.pad_actions.append(action)
            match action:
                case pad_do.OpenRadios() if "pad radios" not in self.dead:
                    self._ranging["pad"] = True
                    self.tell_pad(pad_on.RadiosOpened("UCI 2"))
                case pad_do.CloseRadios():
                    self._ranging["pad"] = False
                case pad_do.Submit():
                    self.evidence = action.evidence
                    if not self.ledger_away and self.ledger_state == "requested":
                        self._decide(action.evidence)
                case pad_do.Permit():
                    self.when.insert(0, (lambda duo: True, lambda duo: duo.tell_pad(pad_on.Permitted())))
                case pad_do.Cancel():
                    self._cancel("pad", action.reason)

    def _uav(self, actions) -> None:
        for action in actions:
            self.uav_actions.append(action)
            match action:
                case uav_do.OpenRadios() if "uav radios" not in self.dead:
                    self._ranging["uav"] = True
                    self.tell_uav(uav_on.RadiosOpened())
                case uav_do.CloseRadios():
                    self._ranging["uav"] = False
                case uav_do.AnswerInBlinks():
                    self.blink_payload = action.answer
                case uav_do.Sign():
                    self.tell_uav(uav_on.Signed(raw_from_der(key_signer(self.uav_key)(action.statement))))
                case uav_do.Act():
                    self.when.append((lambda duo: True, lambda duo: duo.tell_uav(uav_on.Acted("done"))))
                case uav_do.Complete():
                    self.ledger_state, self.ledger_end = "completed", action.result
                    self.tell_pad(pad_on.InteractionCompleted(action.result))
                case uav_do.Cancel():
                    self._cancel("uav", action.reason)

    def _cancel(self, who, reason) -> None:
        granted = self.verdict is not None and self.verdict.permission == "granted"
        if self.ledger_state == "requested" or (self.ledger_state == "decided" and not granted):
            self.ledger_state, self.ledger_end = "cancelled", reason
            event = (who, reason)
            self.tell_uav(uav_on.SessionCancelled(*event)) if who == "pad" else self.tell_pad(
                pad_on.SessionCancelled(*event)
            )
        elif granted and self.now_ms >= self.session.expires_ms:
            self.ledger_state, self.ledger_end = "cancelled", reason

    def _decide(self, evidence: Evidence) -> None:
        message = statement(
            self.session.session_id,
            self.session.transcript_sha256,
            evidence.ranges,
            evidence.claims,
            evidence.attested,
        )
        valid = None
        if evidence.uav_signature is not None:
            try:
                verify(
                    self.uav_key.public_key(),
                    message,
                    der_from_raw(encoding.from_base64url(evidence.uav_signature)),
                )
                valid = True
            except SignatureError:
                valid = False
        self.verdict = decide(
            self.session,
            self.commissioning,
            Evidence.parse(evidence.to_json()),
            confirmed=evidence.matched == "both",
            signature_valid=valid,
            authorisation=(),
            now_ms=self.now_ms,
            evidence_sha256=encoding.digest(evidence.to_json()).hex(),
        )
        self.ledger_state = "decided"
        self.tell_uav(uav_on.VerdictCommitted(self.verdict, "b" * 64))
        self.tell_pad(pad_on.VerdictCommitted(self.verdict, "b" * 64))

    # what a test asks

    def of(self, actions, kind) -> list:
        return [action for action in actions if isinstance(action, kind)]

    @property
    def pad_end(self):
        return self.of(self.pad_actions, pad_do.Finish)[0] if self.of(self.pad_actions, pad_do.Finish) else None

    @property
    def uav_end(self):
        return self.of(self.uav_actions, uav_do.Finish)[0] if self.of(self.uav_actions, uav_do.Finish) else None

    def failures(self) -> list[str]:
        return [action.detail for action in self.pad_actions if isinstance(action, pad_do.ReportStep) and not action.ok]


@pytest.fixture
def make_duo():
    return Duo


@pytest.fixture
def make_flight():
    return Flight
