"""Many landings of a real ArduPilot in wind, its receiver as wrong as an ordinary one; one vehicle flies them all.

Whatever chance decides about a landing comes from its number, so both ways of landing meet the same winds and errors.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import math
import random
import time
from dataclasses import dataclass
from pathlib import Path

from kit.ground_station import dialect
from kit.sitl import HOME, METRES_PER_DEGREE
from wonderland_uav_agent.flight.approach import Phase

WAYS = ("ranges", "own")
"""Down by the ranges; by the autopilot's own position alone."""

CEP_M = 1.5
"""Half of its places are nearer than that: what makers of ordinary receivers state, under an open sky."""
SIGMA_M = CEP_M / math.sqrt(2 * math.log(2))
WANDERS_S = 120.0
"""What its error has in common with that of so long ago is 1/e."""
CATCH_UP_M_S = 0.5
"""How fast its error goes to that of the next landing; never while it lands."""
WIND_M_S = (2.0, 8.0)
GUSTS = 0.25
"""Deviation of the wind's speed, of its mean."""
GUSTS_S = 3.0
TURNS_DEG, TURNS_S = 10.0, 10.0
BIAS_MM = 5.0
"""What is left of each anchor's bias, as its commissioning states."""
BUFFER_MM = 5_000
"""A receiver of this kind is often farther from the truth than the usual buffer."""

HEIGHT_M = 8.0
STEP_S = 0.2
FORCED = 21_196
BEHIND_MS, BEHIND_BY_ITSELF_MS = -250, -220
"""How far an ArduPilot in simulation may be behind, and is by itself."""
DOWN_M = 0.15
"""Standing, it is 0.11 m above the pad, as the simulation has it."""
PARAMETERS = {
    "PLND_ENABLED": 1,
    "PLND_TYPE": 1,
    "SIM_GPS1_ACC": round(SIGMA_M, 2),
    "SIM_GPS1_VERR_X": 0.1,
    "SIM_GPS1_VERR_Y": 0.1,
    "SIM_GPS1_VERR_Z": 0.1,
    "SIM_WIND_T": 1,  # as strong at the ground as above it
    "SIM_WIND_TC": 0.1,  # gusts are led from here
    "WPNAV_SPEED_UP": 500,
}


class Wandering:
    """First-order Gauss–Markov: wanders about zero, forgets with its time constant."""

    def __init__(self, rng, sigma, forgets_s):
        self._rng, self._sigma, self._forgets_s = rng, sigma, forgets_s
        self.value = rng.gauss(0, sigma)

    def after(self, seconds):
        keeps = math.exp(-seconds / self._forgets_s)
        self.value = keeps * self.value + self._rng.gauss(0, self._sigma * math.sqrt(1 - keeps**2))
        return self.value


class Conditions:
    """Of one landing."""

    def __init__(self, number):
        rng = random.Random(f"landing {number}")
        self.wind_m_s, self.from_deg = rng.uniform(*WIND_M_S), rng.uniform(0, 360)
        self.gust = Wandering(rng, GUSTS * self.wind_m_s, GUSTS_S)
        self.turn = Wandering(rng, TURNS_DEG, TURNS_S)
        self.error = [Wandering(rng, SIGMA_M, WANDERS_S) for _ in range(2)]
        self.bias_mm = [rng.gauss(0, BIAS_MM) for _ in range(8)]


class Weather:
    """Leads the simulation's wind and receiver; `offset_m` (north, east) is what the latter is off."""

    def __init__(self, station):
        self._station = station
        self.offset_m = [0.0, 0.0]
        self.conditions = Conditions(0)
        self.caught_up = False

    def become(self, conditions):
        self.conditions, self.caught_up = conditions, False

    async def blow(self):
        east_m = METRES_PER_DEGREE * math.cos(math.radians(HOME.lat))
        before = time.monotonic()
        while True:
            await asyncio.sleep(STEP_S)
            before, passed_s = (now := time.monotonic()), now - before
            self._wander(passed_s)
            at = self.conditions
            self._station.set_quickly("SIM_GPS1_GLTCH_X", self.offset_m[0] / METRES_PER_DEGREE)
            self._station.set_quickly("SIM_GPS1_GLTCH_Y", self.offset_m[1] / east_m)
            self._station.set_quickly("SIM_WIND_SPD", max(0.0, at.wind_m_s + at.gust.after(passed_s)))
            self._station.set_quickly("SIM_WIND_DIR", (at.from_deg + at.turn.after(passed_s)) % 360)

    def _wander(self, passed_s):
        wanted = [axis.after(passed_s) for axis in self.conditions.error]
        away = math.dist(wanted, self.offset_m)
        if self.caught_up or away <= CATCH_UP_M_S * passed_s:
            self.offset_m, self.caught_up = wanted, True
            return
        share = CATCH_UP_M_S * passed_s / away
        self.offset_m = [here + share * (there - here) for here, there in zip(self.offset_m, wanted, strict=True)]


@dataclass(frozen=True)
class Landing:
    """`north_m`, `east_m` from the pad's middle, when it touches the ground, as the simulation has it."""

    number: int
    way: str
    wind_m_s: float
    from_deg: float
    off_at_verdict_m: float
    receiver_north_m: float
    receiver_east_m: float
    north_m: float
    east_m: float
    verdict_s: float
    """Since the order to land."""
    down_s: float

    @property
    def aside_m(self):
        return math.hypot(self.north_m, self.east_m)


def read(path):
    lines = Path(path).read_text(encoding="utf-8").splitlines() if Path(path).exists() else []
    return [Landing(**json.loads(line)) for line in lines]


class Series:
    """Flies what `path` does not have yet, and adds a line to it for each landing. `async with` it."""

    def __init__(self, scene, path):
        self._scene, self._path = scene, Path(path)
        self._weather = Weather(scene.station)
        self._precision = scene.pilot._precision

    async def __aenter__(self):
        await self._scene.world.policy(buffer_mm=BUFFER_MM)
        self._blowing = asyncio.create_task(self._weather.blow())
        return self

    async def __aexit__(self, *_):
        self._blowing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._blowing

    async def fly(self, count):
        """That many of each way, one after the other."""
        flown = {(landing.number, landing.way) for landing in read(self._path)}
        for number in range(count):
            for way in WAYS:
                if (number, way) not in flown:
                    landing = await self._land(number, way)
                    with self._path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(dataclasses.asdict(landing)) + "\n")
                    print(f"{number} {way}: {landing.aside_m:.2f} m, down after {landing.down_s:.0f} s", flush=True)
        return read(self._path)

    async def _keep_time(self):
        """On a crowded machine the simulation falls behind, and what it claims is too old to be proved."""
        navigator = self._scene.link.navigator
        if navigator.skew_ms is not None and navigator.skew_ms < BEHIND_MS:
            await self._scene.station.set("SIM_SPEEDUP", 1.2)
            await self._scene.until(lambda: navigator.skew_ms > BEHIND_BY_ITSELF_MS, "it catches up")
            await self._scene.station.set("SIM_SPEEDUP", 1)

    async def _land(self, number, way):
        scene, weather, conditions = self._scene, self._weather, Conditions(number)
        station, gatekeeper = scene.station, scene.pilot.gatekeeper
        scene.world.delay_mm = dict(zip(scene.world.anchors, conditions.bias_mm, strict=False))
        weather.become(conditions)
        await self._keep_time()
        await station.set("SIM_WIND_TURB", 0.1 * conditions.wind_m_s)
        await station.set("PLND_ENABLED", 1 if way == "ranges" else 0)
        scene.pilot._precision = self._precision if way == "ranges" else None
        await scene.take_off(HEIGHT_M)
        await scene.until(lambda: weather.caught_up, "the receiver's error is that of this landing")
        await self._keep_time()
        began = time.monotonic()
        await station.done(dialect.MAV_CMD_NAV_LAND)
        await scene.until(lambda: gatekeeper.phase in {Phase.LANDING, Phase.REFUSED}, "a verdict")
        assert gatekeeper.phase is Phase.LANDING, f"{number}: {gatekeeper.why}; {scene.link.navigator.skew_ms} ms"
        verdict_s, off_m = time.monotonic() - began, scene.off_m()
        await scene.until(lambda: scene.world.flight.truth[2] < 1e3 * DOWN_M or scene.seen.on_ground, "it lands")
        down_s, (east_mm, north_mm, _) = time.monotonic() - began, scene.world.flight.truth
        receiver_north_m, receiver_east_m = weather.offset_m
        # Its pilot does that: one whose receiver wanders leans against it on the ground, and notices no landing for long.
        await station.done(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCED)
        await scene.until(lambda: not scene.seen.armed and gatekeeper.phase is Phase.WATCHING, "it disarms")
        seen = (receiver_north_m, receiver_east_m, north_mm / 1e3, east_mm / 1e3, verdict_s, down_s)
        rounded = [round(value, 3) for value in (conditions.wind_m_s, conditions.from_deg, off_m, *seen)]
        return Landing(number, way, *rounded)
