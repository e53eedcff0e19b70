"""A real embedded ledger with the contract, a commissioned pad, virtual nodes on pseudo-terminals, both agents."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
from dataclasses import dataclass, field
from pathlib import Path

from kit.contract import Scene
from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs import encoding
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import TICKS_PER_SECOND, Claim
from wonderland_chaincode.contract import CONTRACT
from wonderland_edge_agent.assembly import open_pad
from wonderland_edge_agent.geodesy import frame_at
from wonderland_edge_agent.session.timing import PadTiming
from wonderland_edge_agent.settings import parse
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_simulator.uci_node import (
    DWM3001CDK,
    SR150,
    Air,
    Measurement,
    NodeProfile,
    PtyPort,
    VirtualNode,
)
from wonderland_uav_agent.agent import UavAgent
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.radio import UavRadio
from wonderland_uav_agent.session.timing import UavTiming

FRAME = frame_at(604_518_000, 222_666_000, 30_000)
ANCHORS = {
    "A1": (2_000, 2_000, 200),
    "A2": (-2_000, 2_000, 1_200),
    "A3": (-2_000, -2_000, 200),
    "A4": (2_000, -2_000, 200),
}
MORE = {
    "A5": (0, 2_600, 1_200),
    "A6": (0, -2_600, 200),
    "A7": (2_600, 0, 1_200),
    "A8": (-2_600, 0, 200),
}
"""For pads that have more than four; ``World.extend``."""
STAND = ANCHORS | MORE
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


def commissioning(now_ms: int, *, timed: bool = False, anchors: dict | None = None) -> Commissioning:
    """``timed``: the nodes share a clock, good to 5 mm."""
    anchors = ANCHORS if anchors is None else anchors
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
                for index, (name, (east, north, up)) in enumerate(anchors.items())
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
    stamp_noise_mm: float = 30.0
    ranged: tuple[float, float, float] | None = None
    """Where the drone's radio makes the ranges say that it is, by lies about its own time stamps."""
    clock_ms: int = 0
    """How far the drone's clock is ahead."""

    def range_mm(self, anchor: str, rng: random.Random) -> float:
        return math.dist(STAND[anchor], self.ranged or self.truth) + rng.gauss(0, self.noise_mm)

    def stamp(self, place, sent_s: float, rng: random.Random) -> int:
        """Ticks of the pad's common clock when an anchor there hears what was sent then."""
        away_m = (math.dist(place, self.truth) + rng.gauss(0, self.stamp_noise_mm)) / 1000
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


def hang(port):
    """Its serial line stays, and it answers nothing any more; plugging it in anew cures it."""
    node = port.node
    node.power_off()
    node.receive = lambda _data: None
    node.transmit = lambda _data: None


def cured(port):
    del port.node.receive
    port.node.transmit = port._write


class World:
    """The ledger, the air, one pad and one drone."""

    fast_pad = FAST_PAD
    profile = DWM3001CDK
    """Of every node; ``share_a_clock`` swaps them for such that time-stamp."""

    def __init__(self, directory: Path, ledger: EmbeddedLedger, channel) -> None:
        self.directory = directory
        self.ledger = ledger
        self.channel = channel
        self.clock = SteadyClock()
        self.anchors = dict(ANCHORS)
        self.flight = Flight()
        self.stand = dict(STAND)
        """Where the anchors really stand, mm."""
        self.delay_mm: dict[str, float] = {}
        """What nodes range too long, wherever and whomever they range."""
        self.mute: set[str] = set()
        """Anchors that answer commands and measure nothing."""
        self.rng = random.Random(5)
        self.drawn: dict[tuple[str, float], Measurement] = {}
        self.air = Air(self.measure, rng=random.Random(7), stamp=self.stamp, reach=self.reach)
        self.ports: dict[str, PtyPort] = {}
        self.acted: list = []
        self.all_identities = None

    def add_node(self, name: str) -> None:
        self.ports[name] = PtyPort(VirtualNode(name, self.air, profile=self.profile), self.directory / f"tty-{name}")
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
        anchor = observer if observer in STAND else peer
        if self.mute & {observer, peer}:
            return Measurement(None, status=0x21)
        if observer in STAND and peer in STAND:
            between = math.dist(self.stand[observer], self.stand[peer]) + self.rng.gauss(0, 20.0)
            between += self.delay_mm.get(observer, 0.0) + self.delay_mm.get(peer, 0.0)
            return Measurement(round(between), nlos=False, rssi_dbm=-60.0)
        if anchor in self.flight.silent:
            return Measurement(None, status=0x21)
        key = (anchor, t_s)
        if key not in self.drawn:
            if len(self.drawn) > 64:
                self.drawn.clear()
            distance = self.flight.range_mm(anchor, self.rng)
            distance += self.delay_mm.get(anchor, 0.0) + self.delay_mm.get("uav", 0.0)
            self.drawn[key] = Measurement(round(distance), nlos=False, rssi_dbm=-80.0)
        return self.drawn[key]

    def stamp(self, anchor: str, tag: str, t_s: float) -> int | None:
        return None if anchor in self.flight.silent else self.flight.stamp(self.anchors[anchor], t_s, self.rng)

    def reach(self, receiver: str, sender: str) -> int | None:
        """Between any two nodes: what frames of foreign groups meet. A second drone waits 30 m above the first."""
        east, north, up = self.flight.truth
        drones = {"uav-2": (east, north, up + 30_000.0)}
        return round(math.dist(*((self.stand | drones).get(n, self.flight.truth) for n in (receiver, sender))))

    def use_nodes(self, profile: NodeProfile) -> None:
        """Swap the chips behind all ports, before anybody opens these."""
        self.profile = profile
        for port in self.ports.values():
            assert isinstance(port.node, VirtualNode)
            port.node.become(profile)

    def commissioning(self, *, timed: bool = False) -> Commissioning:
        return commissioning(self.clock(), timed=timed, anchors=self.own)

    @property
    def own(self) -> dict:
        """The first pad's anchors; a test may put another pad's beside them."""
        return {name: place for name, place in self.anchors.items() if name in STAND}

    async def extend(self, count: int) -> None:
        """Make it a pad of so many anchors."""
        for name, place in list(MORE.items())[: count - len(self.anchors)]:
            self.anchors[name] = place
            self.add_node(name)
        record = self.commissioning().to_json()
        await self.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=record)

    async def share_a_clock(self) -> None:
        """Put nodes there that time-stamp one way, and commission the pad anew."""
        self.use_nodes(SR150)
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

    async def policy(self, action="*", **fields) -> None:
        policy = Policy.parse(fields).to_json()
        proposed = await self.call("admin", "ProposePolicy", pad_id="pad-1", action=action, policy=policy)
        await self.call("inspector", "ApproveChange", **Scene.approval(proposed))

    def settings(self, **more):
        document = {
            "pad_id": "pad-1",
            "connection": str(self.directory / "ledger" / "connection.json"),
            "identity": "pad",
            "spool": "spool",
            "anchors": [{"anchor_id": name, "port": str(self.directory / f"tty-{name}")} for name in self.own],
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
    async def uav(self, *, name="uav", act=None, ledger=None, port="", words="both_ways", **more):
        """The drone's agent."""
        contract = ledger or self.contract(name)

        async def land(verdict) -> str:
            self.acted.append(verdict)
            return "done"

        async with (
            LedgerEvents(self.contract(name)) as events,
            UavRadio(port or self.directory / f"tty-{name}", self.clock, words=words) as radio,
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


async def decided(uav, pad_id="pad-1", action="land", *, tries=3):
    """An honest drone's proof. One that is left open is asked for again, as a pilot does on a crowded machine too."""
    for left in reversed(range(tries)):
        result = await uav.prove(pad_id, action)
        if left == 0 or (result.verdict is not None and result.verdict.outcome != "inconclusive"):
            return result
    raise AssertionError
