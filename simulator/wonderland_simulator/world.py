"""The world as a process: drones fly, broadcast and are ranged, by the clock on the wall.

Everything leaves it through what real parts have: UCI on pseudo-terminals (a pad's four nodes, a drone's one),
Remote ID on UDP to each pad within earshot, positions on UDP from each drone's autopilot to its agent. A plan (JSON)
says which ports and paths; ``wonderland_simulator.demo`` makes one.
"""

from __future__ import annotations

import asyncio
import json
import math
import random
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.sessions import TICKS_PER_SECOND, Claim
from wonderland_simulator.attackers.ranging import RANGE_ATTACKS, Situation
from wonderland_simulator.attackers.replay import ReplayAttack
from wonderland_simulator.broadcaster import Fix, frame
from wonderland_simulator.channel import Channel
from wonderland_simulator.flight import Vector
from wonderland_simulator.mission import Mission, Mode
from wonderland_simulator.scenario import STAMP_SIGMA_M, AnchorSite, Behaviour, DroneSpec, PadSite
from wonderland_simulator.uci_node import (
    Air,
    Measurement,
    PtyPort,
    VirtualNode,
)

TICK_S: Final = 0.05
POSITION_EVERY: Final = 2
BROADCAST_EVERY: Final = 10
IMPOSTOR_REACH_M: Final = 70.0
"""How near to its hover a drone is when its impostor sends."""
EARSHOT_M: Final = 1_500.0
BLINK_REACH_M: Final = 90.0
BLINK_LOSS: Final = 0.01
LIGHT_M_S: Final = 299_792_458.0
OPERATOR_ID: Final = "FIN87astrdge12k8"


def plug(ports: Sequence[PtyPort]) -> None:
    """Make the serial devices appear under their paths."""
    for port in ports:
        port.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        port.plug()


@dataclass(frozen=True)
class Ports:
    """Where the world's words go, all on loopback."""

    rid: dict[str, int]
    """Pad → UDP port of its Remote ID receiver."""
    position: dict[str, int]
    """Drone → UDP port on which its agent listens to the autopilot."""
    modes: int
    """UDP port of the fleet, which hears how each mission stands."""
    commands: int
    """UDP port on which the autopilots hear ``land`` and ``leave``."""

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Ports:
        """From a plan's ``ports``."""
        return cls(value["rid"], value["position"], value["modes"], value["commands"])


def anchor_path(directory: Path, pad_id: str, anchor_id: str) -> Path:
    """Serial device of a pad's node."""
    return directory / "serial" / pad_id / anchor_id


def drone_path(directory: Path, uav_id: str) -> Path:
    """Serial device of a drone's node."""
    return directory / "serial" / uav_id


class World:
    """All drones and pads; ``run`` until cancelled."""

    def __init__(
        self, pads: tuple[PadSite, ...], drones: tuple[DroneSpec, ...], directory: Path, ports: Ports, *, seed: int
    ) -> None:
        self._ports = ports
        self._pads = {pad.pad_id: pad for pad in pads}
        self._frames = {pad.pad_id: pad.frame for pad in pads}
        self._start_s = time.monotonic()
        self._missions = {
            drone.uav_id: Mission(drone, self._frames[drone.pad_id], random.Random(f"{seed}/{drone.uav_id}"))
            for drone in drones
        }
        self._channels = {
            pad.pad_id: Channel(
                random.Random(f"{seed}/{pad.pad_id}"), anchor_bias_m={site.mac: site.bias_m for site in pad.anchors}
            )
            for pad in pads
        }
        self._sites = {f"{pad.pad_id}/{site.anchor_id}": (pad.pad_id, site) for pad in pads for site in pad.anchors}
        replaying = frozenset(drone.uav_id for drone in drones if drone.behaviour is Behaviour.REPLAY)
        attack = ReplayAttack(replaying, {drone.uav_id: drone.pad_id for drone in drones})
        self._attacks = {
            drone.uav_id: (RANGE_ATTACKS[drone.attack.ranges], random.Random(f"{seed}/{drone.uav_id}/attack"))
            for drone in drones
            if drone.attack is not None and drone.attack.ranges
        }
        self._drawn: dict[tuple[str, str], tuple[float, Measurement]] = {}
        self._stamp_rng = random.Random(f"{seed}/stamps")
        self._air = Air(
            self._measure,
            rng=random.Random(f"{seed}/air"),
            data_loss=0.02,
            intercept=attack.intercept,
            stamp=self._stamp,
            reach=self._reach,
        )
        self._impostors = {drone.uav_id: _Impostor(drone) for drone in drones if drone.impostor_m is not None}
        self._serial = []
        for name, (pad_id, site) in self._sites.items():
            node = VirtualNode(name, self._air, profile=self._pads[pad_id].board)
            self._serial.append(PtyPort(node, anchor_path(directory, pad_id, site.anchor_id)))
        for drone in drones:
            node = VirtualNode(drone.uav_id, self._air, profile=self._pads[drone.pad_id].board)
            self._serial.append(PtyPort(node, drone_path(directory, drone.uav_id)))

    async def run(self, ready: Callable[[], None]) -> None:
        """Until cancelled; calls ``ready`` once every serial device is there."""
        plug(self._serial)
        out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        out.setblocking(False)
        loop = asyncio.get_running_loop()
        ear, _ = await loop.create_datagram_endpoint(
            lambda: _Commands(self._command), local_addr=("127.0.0.1", self._ports.commands)
        )
        ready()
        self._start_s = time.monotonic()
        due = self._start_s
        tick = 0
        try:
            while True:
                due += TICK_S
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                if time.monotonic() - due > 1.0:
                    due = time.monotonic()  # the process was stopped for a while: the world stood still
                tick += 1
                self._tick(out, tick)
        finally:
            ear.close()
            out.close()
            for impostor in self._impostors.values():
                impostor.out.close()
            self._air.close()
            for port in self._serial:
                port.close()

    def _tick(self, out: socket.socket, tick: int) -> None:
        t_s = time.monotonic() - self._start_s
        t_ms = time.time_ns() // 1_000_000
        for index, (uav_id, mission) in enumerate(self._missions.items()):
            mission.step(t_s, TICK_S)
            if tick % POSITION_EVERY == 0:
                fix = mission.fix(t_s, t_ms)
                send_position(out, self._ports.position[uav_id], _claim(fix))
                _send(out, self._ports.modes, {"uav_id": uav_id, "mode": mission.mode.value, "proofs": mission.proofs})
                if (tick + index * 2) % BROADCAST_EVERY == 0 and mission.mode is not Mode.WAITING:
                    self._broadcast(out, uav_id, mission, mission.broadcast(fix), fix)
                impostor = self._impostors.get(uav_id)
                if (
                    impostor is not None
                    and tick % BROADCAST_EVERY == BROADCAST_EVERY // 2 - 1
                    and impostor.wakes(mission)
                ):
                    said = impostor.says(mission, fix)
                    self._broadcast(impostor.out, uav_id, mission, said, said)

    def _broadcast(self, out: socket.socket, uav_id: str, mission: Mission, said: Fix, fix: Fix) -> None:
        """``said`` is what a transmitter says that is at ``fix``."""
        home = self._pads[mission.spec.pad_id]
        data = frame(uav_id, OPERATOR_ID, (home.lat_e7, home.lon_e7), said)
        for pad_id, port in self._ports.rid.items():
            try:
                east, north, _ = to_local(self._frames[pad_id], fix.lat_e7, fix.lon_e7, fix.height_mm)
            except GeometryError:
                continue
            if math.hypot(east, north) < EARSHOT_M * 1000:
                _send_bytes(out, port, data)

    def _command(self, uav_id: str, command: str) -> None:
        mission = self._missions.get(uav_id)
        if mission is not None:
            mission.command(command, time.monotonic() - self._start_s)

    def _measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        """Both ends of a pair report the same draw of a round."""
        pair = (observer, peer) if observer in self._sites else (peer, observer)
        drawn = self._drawn.get(pair)
        if drawn is not None and drawn[0] == t_s:
            return drawn[1]
        pad_id, site = self._sites[pair[0]]
        if pair[1] in self._sites:
            return self._between(pad_id, site, *self._sites[pair[1]])
        mission = self._missions.get(pair[1])
        if mission is None or mission.spec.pad_id != pad_id:
            return Measurement(None)
        here = _radio_at(mission)
        distance = math.dist(here, (site.east_m, site.north_m, site.up_m))
        result = self._channels[pad_id].measure(distance, site.mac)
        range_m = result.range_m
        if range_m is not None and pair[1] in self._attacks and mission.claimed_m is not None:
            range_error, rng = self._attacks[pair[1]]
            anchors = [(each.east_m, each.north_m, each.up_m) for each in self._pads[pad_id].anchors]
            index = self._pads[pad_id].anchors.index(site)
            situation = Situation(here, mission.claimed_m, anchors, index, t_s)
            added = range_error(situation, rng)
            range_m = None if added is None else max(0.0, range_m + added)
        measured = Measurement(None if range_m is None else round(range_m * 1000), result.obstructed, result.power_dbm)
        self._drawn[pair] = (t_s, measured)
        return measured

    def _between(self, pad_id: str, site: AnchorSite, other_pad_id: str, other: AnchorSite) -> Measurement:
        """Two anchors of a pad range each other; those of another pad are not in its session."""
        if pad_id != other_pad_id:
            return Measurement(None)
        distance = math.dist((site.east_m, site.north_m, site.up_m), (other.east_m, other.north_m, other.up_m))
        result = self._channels[pad_id].measure(distance, site.mac)
        range_m = None if result.range_m is None else result.range_m + other.bias_m
        return Measurement(None if range_m is None else round(range_m * 1000), result.obstructed, result.power_dbm)

    def _stamp(self, anchor: str, tag: str, t_s: float) -> int | None:
        """What the pad's clock shows when the anchor hears a blink: where the drone *is*, whatever its radio says."""
        pad_id, site = self._sites[anchor]
        mission = self._missions.get(tag)
        if mission is None or self._pads[pad_id].clock_sigma_mm is None:
            return None
        here = self._seen_from(pad_id, mission)
        if here is None:
            return None
        away_m = math.dist(here, (site.east_m, site.north_m, site.up_m))
        if away_m > BLINK_REACH_M or self._stamp_rng.random() < BLINK_LOSS:
            return None
        away_m += site.clock_error_m + self._stamp_rng.gauss(0.0, STAMP_SIGMA_M)
        return round(t_s * TICKS_PER_SECOND) + round(away_m / LIGHT_M_S * TICKS_PER_SECOND)

    def _reach(self, receiver: str, sender: str) -> int | None:
        """How far apart two radios are, of whatever pads, as far as they hear each other."""
        pad_id = self._sites[receiver][0] if receiver in self._sites else self._missions[receiver].spec.pad_id
        places = self._place(pad_id, receiver), self._place(pad_id, sender)
        if places[0] is None or places[1] is None:
            return None
        away_m = math.dist(places[0], places[1])
        return None if away_m > BLINK_REACH_M else round(away_m * 1000)

    def _place(self, pad_id: str, name: str) -> Vector | None:
        """Where a node is, in the frame of any pad; None where that is too far away."""
        if name not in self._sites:
            return self._seen_from(pad_id, self._missions[name])
        home_id, site = self._sites[name]
        place = (site.east_m, site.north_m, site.up_m)
        return place if home_id == pad_id else self._moved(home_id, place, pad_id)

    def _seen_from(self, pad_id: str, mission: Mission) -> Vector | None:
        """Where the drone's radio is, in the frame of any pad."""
        if mission.spec.pad_id == pad_id:
            return _radio_at(mission)
        return self._moved(mission.spec.pad_id, _radio_at(mission), pad_id)

    def _moved(self, from_pad: str, place: Vector, to_pad: str) -> Vector | None:
        """From one pad's frame into another's."""
        try:
            east, north, up = to_local(
                self._frames[to_pad], *to_wgs84(self._frames[from_pad], *(round(value * 1000) for value in place))
            )
        except GeometryError:
            return None
        return (east / 1000, north / 1000, up / 1000)


class _Impostor:
    """Somebody on the ground with a transmitter of his own, who sends a drone's serial number from where he stands."""

    def __init__(self, drone: DroneSpec) -> None:
        east_m, north_m = drone.impostor_m or (0.0, 0.0)
        self._place_m = (drone.hover_m[0] + east_m, drone.hover_m[1] + north_m, drone.hover_m[2])
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        """Its own socket: receivers tell transmitters apart by their addresses."""
        self.out.setblocking(False)

    def wakes(self, mission: Mission) -> bool:
        """Whether he sends now: while the drone is near, as somebody would who sees it."""
        near = math.dist(mission.flight.position, mission.spec.hover_m) < IMPOSTOR_REACH_M
        return near and mission.mode is not Mode.WAITING

    def says(self, mission: Mission, fix: Fix) -> Fix:
        """That the drone hovers there, as well known as the drone's own fix."""
        lat_e7, lon_e7, height_mm = to_wgs84(mission.frame, *(round(value * 1000) for value in self._place_m))
        return replace(fix, lat_e7=lat_e7, lon_e7=lon_e7, height_mm=height_mm, speed_mm_s=0, vertical_mm_s=0)


def _radio_at(mission: Mission) -> Vector:
    """Where the radio with the drone's keys is, in the frame of its pad."""
    attack = mission.spec.attack
    if attack is not None and attack.accomplice and mission.claimed_m is not None:
        return mission.claimed_m
    return mission.flight.position


class _Commands(asyncio.DatagramProtocol):
    """The autopilots' ear."""

    def __init__(self, heard: Any) -> None:
        self._heard = heard

    def datagram_received(self, data: bytes, addr: Any) -> None:
        del addr
        try:
            value = json.loads(data[:1024])
            self._heard(str(value["uav_id"]), str(value["command"]))
        except (ValueError, KeyError, TypeError):
            return


def send_position(out: socket.socket, port: int, claim: Claim) -> None:
    """A position as an autopilot's bridge would send it to the drone's agent."""
    _send(out, port, claim.to_json())


def _claim(fix: Fix) -> Claim:
    return Claim(
        lat_e7=fix.lat_e7,
        lon_e7=fix.lon_e7,
        height_mm=fix.height_mm,
        accuracy_mm=fix.accuracy_mm,
        height_accuracy_mm=fix.height_accuracy_mm,
        t_ms=fix.t_ms,
    )


def _send(out: socket.socket, port: int, value: dict[str, Any]) -> None:
    _send_bytes(out, port, json.dumps(value, separators=(",", ":")).encode())


def _send_bytes(out: socket.socket, port: int, data: bytes) -> None:
    try:
        out.sendto(data, ("127.0.0.1", port))
    except (BlockingIOError, ConnectionRefusedError):  # nobody listens yet, or its buffer is full: radio is like that
        return
