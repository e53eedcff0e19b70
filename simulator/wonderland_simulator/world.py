"""The world as a process: drones fly, broadcast and are ranged, by the clock on the wall.

Everything leaves it through what real parts have: UCI on pseudo-terminals (a pad's four nodes, a drone's one),
Remote ID on UDP to each pad within earshot, positions on UDP from each drone's autopilot to its agent. A plan (JSON)
says which ports and paths; ``wonderland_simulator.demo`` makes one.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.sessions import Claim
from wonderland_simulator.broadcaster import Fix, frame
from wonderland_simulator.mission import Mission, Mode
from wonderland_simulator.pads_air import PadsAir, node_name
from wonderland_simulator.scenario import Behaviour, DroneSpec, PadSite
from wonderland_simulator.uci_node import (
    PtyPort,
    VirtualNode,
)

TICK_S: Final = 0.05
POSITION_EVERY: Final = 2
BROADCAST_EVERY: Final = 10
IMPOSTOR_REACH_M: Final = 70.0
"""How near to its hover a drone is when its impostor sends."""
LOOPBACK: Final = "127.0.0.1"
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
        replaying = frozenset(drone.uav_id for drone in drones if drone.behaviour is Behaviour.REPLAY)
        self._air = PadsAir(pads, self._missions, seed=seed, replaying=replaying)
        self._impostors = {drone.uav_id: _Impostor(drone) for drone in drones if drone.impostor_m is not None}
        self._serial = []
        for pad in pads:
            for site in pad.anchors:
                node = VirtualNode(node_name(pad.pad_id, site.anchor_id), self._air.air, profile=pad.board)
                self._serial.append(PtyPort(node, anchor_path(directory, pad.pad_id, site.anchor_id)))
        for drone in drones:
            node = VirtualNode(drone.uav_id, self._air.air, profile=self._pads[drone.pad_id].board)
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
            self._air.air.close()
            for port in self._serial:
                port.close()

    def _tick(self, out: socket.socket, tick: int) -> None:
        t_s = time.monotonic() - self._start_s
        t_ms = time.time_ns() // 1_000_000
        for index, (uav_id, mission) in enumerate(self._missions.items()):
            mission.step(t_s, TICK_S)
            if tick % POSITION_EVERY == 0:
                fix = mission.fix(t_s, t_ms)
                send_position(out, self._ports.position[uav_id], claim_of(fix))
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
            if self._air.hears(pad_id, fix):
                send_bytes(out, (LOOPBACK, port), data)

    def _command(self, uav_id: str, command: str) -> None:
        mission = self._missions.get(uav_id)
        if mission is not None:
            mission.command(command, time.monotonic() - self._start_s)


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


def send_position(out: socket.socket, to: int | tuple[str, int], claim: Claim) -> None:
    """A position as an autopilot's bridge sends it to the drone's agent; to a port of this machine, or anywhere."""
    data = json.dumps(claim.to_json(), separators=(",", ":")).encode()
    send_bytes(out, (LOOPBACK, to) if isinstance(to, int) else to, data)


def claim_of(fix: Fix) -> Claim:
    """What a drone signs of what its receiver says."""
    return Claim(
        lat_e7=fix.lat_e7,
        lon_e7=fix.lon_e7,
        height_mm=fix.height_mm,
        accuracy_mm=fix.accuracy_mm,
        height_accuracy_mm=fix.height_accuracy_mm,
        t_ms=fix.t_ms,
    )


def _send(out: socket.socket, port: int, value: dict[str, Any]) -> None:
    send_bytes(out, (LOOPBACK, port), json.dumps(value, separators=(",", ":")).encode())


def send_bytes(out: socket.socket, to: tuple[str, int], data: bytes) -> None:
    """As radio would: nobody may listen yet, a buffer may be full, there may be no way there now."""
    with contextlib.suppress(OSError):
        out.sendto(data, to)
