"""Tells the autopilot where the pad is while it lands: LANDING_TARGET from the ranges of the drone's own node. Pure.

Each autopilot has a way of its own. ArduPilot takes the pad as seen from the vehicle, forward, right and down
(MAV_FRAME_BODY_FRD), and turns it by its attitude. PX4 takes places of its own filter alone (MAV_FRAME_LOCAL_NED): the
vehicle's place there and the way from it to the pad, so that an error of that place cancels.
"""

from __future__ import annotations

import math
from typing import Final

from wonderland.proofs.frame import to_local
from wonderland.proofs.records.pads import Commissioning, Frame
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.flight.guidance import Fix, Guidance
from wonderland_uav_agent.flight.vehicle import PX4
from wonderland_uav_agent.position.mavlink.attitude import Vector, times, transposed, turn
from wonderland_uav_agent.position.mavlink.messages import Attitude, LandingTarget, LocalPosition, Message

LOCAL_NED: Final = 1
BODY_FRD: Final = 12
MAX_AGE_MS: Final = 500
"""Of the attitude and of the autopilot's own place; at a few metres a second, some decimetres."""
EVERY_MS: Final = 39
"""25 Hz, as often as a look is taken."""
LEAST_M: Final = 0.05
"""ArduPilot takes no target at no distance."""


class PrecisionLanding:
    """``antenna_m``: of the node, from the autopilot's reference, forward, right and down."""

    def __init__(self, antenna_m: Vector = (0.0, 0.0, 0.0)) -> None:
        self._antenna_m = antenna_m
        self._guidance: Guidance | None = None
        self._surveyed: Commissioning | None = None
        self._attitude: Attitude | None = None
        self._attitude_ms = 0
        self._local: LocalPosition | None = None
        self._local_ms = 0
        self._believed_ms = self._said_ms = 0

    def take(self, message: Message, now_ms: int) -> None:
        """A message of the autopilot's."""
        match message:
            case Attitude(roll, pitch, yaw) if all(map(math.isfinite, (roll, pitch, yaw))):
                self._attitude, self._attitude_ms = message, now_ms
            case LocalPosition(north_m, east_m, down_m) if all(map(math.isfinite, (north_m, east_m, down_m))):
                self._local, self._local_ms = message, now_ms

    def believe(self, claim: Claim, now_ms: int) -> None:
        """Where the antenna is by the autopilot: the filter's beginning, and its height."""
        if self._guidance is not None and self._surveyed is not None and claim.t_ms != self._believed_ms:
            self._believed_ms = claim.t_ms
            place = to_local(self._surveyed.frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
            self._guidance.seed((place[0] / 1e3, place[1] / 1e3, place[2] / 1e3), now_ms)

    def range(self, commissioning: Commissioning, mac: int, t_ms: int, range_mm: int) -> None:
        """A range of the drone's node in a session at the pad of that survey."""
        if self._guidance is None or self._surveyed is not commissioning:
            self._guidance, self._surveyed = Guidance(commissioning), commissioning
        self._guidance.range(mac, t_ms, range_mm)

    def fix(self, frame: Frame, now_ms: int) -> Fix | None:
        """Where the node is above that pad; None while the ranges do not say it well enough."""
        if self._guidance is None or self._surveyed is None or self._surveyed.frame != frame:
            return None
        return self._guidance.fix(now_ms)

    def target(self, frame: Frame, stack: int, system: int, now_ms: int) -> LandingTarget | None:
        """What to tell the autopilot of ``system`` now; None where it was just told, or there is nothing to tell."""
        if now_ms - self._said_ms < EVERY_MS:
            return None
        fix = self.fix(frame, now_ms)
        if fix is None or self._attitude is None or now_ms - self._attitude_ms > MAX_AGE_MS:
            return None
        turned = turn(self._attitude)
        east_m, north_m, up_m = fix.place_m
        arm_m = times(turned, self._antenna_m)
        # From the autopilot's reference to the pad: up the arm to the node, and from there.
        way_m = (arm_m[0] - north_m, arm_m[1] - east_m, arm_m[2] + up_m)
        distance_m = max(math.hypot(*way_m), LEAST_M)
        if stack == PX4:
            if self._local is None or now_ms - self._local_ms > MAX_AGE_MS:
                return None
            here_m = (self._local.north_m, self._local.east_m, self._local.down_m)
            place_m = (here_m[0] + way_m[0], here_m[1] + way_m[1], here_m[2] + way_m[2])
            target = LandingTarget(system, 1_000 * now_ms, LOCAL_NED, place_m, distance_m)
        else:
            place_m = times(transposed(turned), way_m)
            target = LandingTarget(system, 1_000 * now_ms, BODY_FRD, place_m, distance_m)
        self._said_ms = now_ms
        return target
