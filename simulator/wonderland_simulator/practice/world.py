"""All of a scenario as it happens: vehicles fly, broadcast and are ranged, nodes break, by the clock on the wall.

Nothing of it knows a ledger, a backend or an agent: what those get is UCI on pseudo-terminals and datagrams.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final, TextIO

from wonderland.proofs.frame import to_wgs84
from wonderland.toml_settings import Address
from wonderland_simulator.broadcaster import Fix, frame
from wonderland_simulator.pads_air import PadsAir, node_name
from wonderland_simulator.practice.boards import Boards
from wonderland_simulator.practice.description import Fault
from wonderland_simulator.practice.piloted import Piloted
from wonderland_simulator.practice.reading import PadPlan, Scenario, VehiclePlan
from wonderland_simulator.practice.tour import Tour
from wonderland_simulator.uci_node import PtyPort, plugged
from wonderland_simulator.world import OPERATOR_ID, TICK_S, claim_of, send_bytes, send_position

POSITION_EVERY: Final = 2
BROADCAST_EVERY: Final = 10
Say = Callable[[float, str], None]
"""Seconds since the start, and what happened."""


class PracticeWorld:
    """``run`` until cancelled; what happens is said by ``say``."""

    def __init__(self, scenario: Scenario, say: Say) -> None:
        self.scenario = scenario
        self._say = say
        self._frames = {pad.told.pad_id: pad.site.frame for pad in scenario.pads}
        self.tours = {each.told.uav_id: self._flyer(number, each) for number, each in enumerate(scenario.vehicles)}
        replaying = frozenset(each.told.uav_id for each in scenario.vehicles if each.told.lies.replay)
        self._air = PadsAir([pad.site for pad in scenario.pads], self.tours, seed=scenario.seed, replaying=replaying)
        self.ports: dict[str, PtyPort] = {}
        """By the names of the nodes behind them."""
        boards = Boards(
            self._air, {each.told.uav_id: each.board for each in scenario.vehicles if each.board is not None}
        )
        for pad in scenario.pads:
            for anchor_id, path in pad.ports.items():
                name = node_name(pad.told.pad_id, anchor_id)
                self.ports[name] = PtyPort(boards.make(pad.told.node, name), path)
        for each in scenario.vehicles:
            self.ports[each.told.uav_id] = PtyPort(boards.make(each.node, each.told.uav_id), each.port)
        self._faults = list(scenario.faults)
        self._start_s = 0.0
        self._tracks: dict[str, TextIO] = {}

    def _flyer(self, number: int, plan: VehiclePlan) -> Tour | Piloted:
        frame = self._frames[plan.told.pad]
        if plan.told.autopilot is not None:
            return Piloted(plan, frame, number)
        return Tour(plan.told, frame, random.Random(f"{self.scenario.seed}/{plan.told.uav_id}"))

    @property
    def now_s(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start_s

    @property
    def to_come(self) -> Fault | None:
        """The next fault."""
        return self._faults[0] if self._faults else None

    async def run(self, ready: Callable[[], None]) -> None:
        """Until cancelled; calls ``ready`` once every port is there. Raises OSError."""
        async with contextlib.AsyncExitStack() as stack:
            out = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            out.setblocking(False)
            impostors = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            impostors.setblocking(False)
            for each in self.scenario.vehicles:
                if each.track is not None:
                    track = stack.enter_context(each.track.open("w", encoding="utf-8"))
                    track.write("t,x,y,z\n")
                    self._tracks[each.told.uav_id] = track
            stack.callback(self._air.air.close)
            stack.enter_context(plugged(list(self.ports.values())))
            for address in sorted(self._told()):
                stack.enter_context(_alone(address))
            for flyer in self.tours.values():
                if isinstance(flyer, Piloted):
                    await stack.enter_async_context(flyer)
            self._start_s = due_s = time.monotonic()
            ready()
            tick = 0
            while True:
                due_s += TICK_S
                await asyncio.sleep(max(0.0, due_s - time.monotonic()))
                if time.monotonic() - due_s > 1.0:
                    due_s = time.monotonic()  # the process was stopped for a while: the world stood still
                tick += 1
                self._break(self.now_s)
                self._fly(out, impostors, tick, self.now_s)

    def _told(self) -> set[Address]:
        """Where its datagrams go."""
        found = {
            each.position
            for each in self.scenario.vehicles
            if each.position is not None and each.told.autopilot is None
        }
        if any(not each.told.remote_id.silent or each.told.remote_id.impostor_m for each in self.scenario.vehicles):
            found |= {pad.remote_id for pad in self.scenario.pads}
        return found

    def _break(self, t_s: float) -> None:
        while self._faults and self._faults[0].at_s <= t_s:
            fault = self._faults.pop(0)
            port = self.ports[fault.node]
            if fault.by_m is not None:
                self._air.moved_m[fault.node] = fault.by_m
                text = f"stands {', '.join(f'{each:g}' for each in fault.by_m)} m from where it was surveyed"
            elif fault.what == "hang":
                port.hang()
                text = "hangs"
            else:
                port.unplug()
                text = "is unplugged"
                if fault.what == "return":
                    port.plug()
                    text = "is back"
            self._say(t_s, f"{fault.node} {text}")

    def _fly(self, out: socket.socket, impostors: socket.socket, tick: int, t_s: float) -> None:
        now_ms = time.time_ns() // 1_000_000
        for index, each in enumerate(self.scenario.vehicles):
            uav_id, tour = each.told.uav_id, self.tours[each.told.uav_id]
            said = tour.step(t_s, TICK_S)
            if said:
                self._say(t_s, f"{uav_id} {said}")
            if tick % POSITION_EVERY == 0 and (fix := tour.fix(t_s, now_ms)) is not None:
                if each.position is not None and each.told.autopilot is None:
                    send_position(out, each.position, claim_of(fix))
                if (tick + index * 2) % BROADCAST_EVERY == 0:
                    self._broadcast(out, impostors, each, fix)
            track = self._tracks.get(uav_id)
            if track is not None:
                east, north, up = tour.flight.position
                track.write(f"{now_ms / 1_000:.3f},{east:.4f},{north:.4f},{up:.4f}\n")
                track.flush()

    def _broadcast(self, out: socket.socket, impostors: socket.socket, each: VehiclePlan, fix: Fix) -> None:
        """Its own, and that of whoever pretends to be it."""
        said, tour = each.told.remote_id, self.tours[each.told.uav_id]
        pad = next(pad for pad in self.scenario.pads if pad.told.pad_id == each.told.pad)
        serial = said.serial or each.told.uav_id
        if not said.silent:
            data = _pack(serial, pad, tour.broadcast(fix))
            for address in (*self._in_earshot(fix), *map(Address, said.also_to)):
                send_bytes(out, address, data)
        if said.impostor_m is not None:
            lat_e7, lon_e7, height_mm = to_wgs84(tour.frame, *(round(value * 1000) for value in said.impostor_m))
            there = replace(fix, lat_e7=lat_e7, lon_e7=lon_e7, height_mm=height_mm, speed_mm_s=0, vertical_mm_s=0)
            for address in self._in_earshot(there):
                send_bytes(impostors, address, _pack(each.told.uav_id, pad, there))

    def _in_earshot(self, sender: Fix) -> list[Address]:
        return [pad.remote_id for pad in self.scenario.pads if self._air.hears(pad.told.pad_id, sender)]


def _alone(address: Address) -> socket.socket:
    """Held as long as a world tells this address where its drones are: two would mix theirs. Raises OSError."""
    host, port = address
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f"\0wonderland-world/{host}:{port}")  # the system lets go of it with the process
    except OSError as error:
        lock.close()
        raise OSError(
            error.errno,
            f"another world on this machine sends to {host}:{port}; end it, or give this scenario's pads and vehicles "
            "addresses of their own (remote_id, position)",
        ) from error
    return lock


def _pack(serial: str, pad: PadPlan, fix: Fix) -> bytes:
    return frame(serial, OPERATOR_ID, (pad.site.lat_e7, pad.site.lon_e7), fix)
