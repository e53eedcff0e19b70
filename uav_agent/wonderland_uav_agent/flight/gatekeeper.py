"""Holds a vehicle above its pad until a committed verdict permits the landing. Pure: looks in, orders out.

* WATCHING: nothing is asked of the vehicle; what begins to land near a pad is held.
* TO_GATE: it was told to wait above the pad, and is on its way there.
* PROVING: it waits there, and a proof is under way.
* TO_PAD: a verdict permits the landing, and it goes above the pad first.
* LANDING: the ledger holds a verdict that permits it; the autopilot lands. What the wind takes aside goes around: above
  the pad once more, and down from there.
* REFUSED: no proof permitted it; it holds, or does what its settings say.
* OVERRIDDEN: somebody else flies, a pilot or a fail-safe. That always wins: nothing more is ordered in this flight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.flight.approach import Gate, GoTo, Land, Order, Phase, Prove, Report, Return, Tell
from wonderland_uav_agent.flight.settings import FlightSettings
from wonderland_uav_agent.flight.touchdown import TouchDown
from wonderland_uav_agent.flight.vehicle import Mode, Vehicle

DESCENT_MM_S: Final = 300
"""Who sinks faster than this below twice the gate's height is about to land, whatever his mode is called."""
AT_GATE_MM: Final = 2_000
STILL_MM_S: Final = 500
GATE_PATIENCE_MS: Final = 30_000
"""Wind may keep it from coming to rest; then the proof begins where it is."""
AGAIN_MS: Final = 3_000
"""Between two proofs, and before an order that showed no effect is given again."""
OBEYED_MS: Final = 4_000
"""So long a change of mode may take to be seen; until then the old one is nobody's will."""


class Gatekeeper:
    """Of one drone; ``know`` tells it the pads."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._approach_mm = 1_000 * settings.approach_m
        self._gate_mm = round(1_000 * settings.gate_m)
        self._gates: dict[str, Gate] = {}
        self._gate: Gate | None = None
        self.phase = Phase.WATCHING
        self.why = ""
        """Why it is refused or overridden."""
        self._cause = "not_held"
        self._permitted = False
        """Whether a committed verdict permits this approach its landing, whoever flies it."""
        self._revoked = ""
        """Why the permission is gone, where nobody knew then where the vehicle was."""
        self._standing: GoTo | Land | Return | None = None
        """What the vehicle was told last; None where somebody else flies it."""
        self._ordered_ms = self._since_ms = self._proved_ms = 0
        self._from_mode = 0
        """The flight mode in which that order found it."""
        self._before: GoTo | Land | Return | None = None
        """The order that it followed on; the vehicle may have yet to show that it obeyed that one."""
        self._obeyed = False
        self._attempts = 0
        self._went_around = 0
        self._proving = False
        self._resume: str | None = None
        self._touch_down = TouchDown()
        self._stands = False
        """Whether it is down, and its autopilot has not noticed."""

    @property
    def landing(self) -> bool:
        """Whether a landing that is permitted goes on."""
        return self.phase in {Phase.TO_PAD, Phase.LANDING} and not self._stands

    @property
    def held_at(self) -> str | None:
        """The pad at which it is held or lands now."""
        flown = self.phase not in {Phase.WATCHING, Phase.OVERRIDDEN} and self._standing is not None
        return self._gate.pad_id if flown and self._gate is not None else self._resume

    @property
    def landing_at(self) -> Gate | None:
        """The pad at which it lands now, by a committed verdict, whoever flies it."""
        return self._gate if self.phase is Phase.LANDING else None

    def resume(self, pad_id: str) -> None:
        """It was held at that pad before this agent started: hold it on, if it still waits there."""
        self._resume = pad_id

    def know(self, gates: Sequence[Gate]) -> None:
        """The pads at which it proves itself; an approach that is under way keeps its own."""
        self._gates = {gate.pad_id: gate for gate in gates}

    @property
    def gates(self) -> tuple[Gate, ...]:
        """The pads that it knows."""
        return tuple(self._gates.values())

    def near(self, vehicle: Vehicle) -> Gate | None:
        """The nearest of its pads whose approach it is in."""
        within = [gate for gate in self._gates.values() if self._in_approach(gate, vehicle)]
        return min(within, key=lambda gate: _aside_mm(gate, vehicle)) if within else None

    # --- what happens ------------------------------------------------------------------------------------------

    def look(self, vehicle: Vehicle, now_ms: int) -> list[Order]:
        """To be called several times a second."""
        if vehicle.on_ground or not vehicle.armed:
            return self._on_ground(vehicle)
        if self._stands:
            if vehicle.mode is Mode.LANDING:
                return []
            self._forget()  # somebody takes off again
        if self._revoked:
            return self.revoke(self._revoked, vehicle, now_ms)
        if self.phase is Phase.OVERRIDDEN:
            return []
        if self.phase is Phase.WATCHING:
            return self._watch(vehicle, now_ms)
        assert self._gate is not None
        if self._taken_over(vehicle, now_ms):
            return self._override(vehicle, now_ms)
        if self._standing is not None and vehicle.mode is not _WANTED[type(self._standing)]:
            return self._insist(now_ms)
        match self.phase:
            case Phase.TO_GATE:
                return self._to_gate(self._gate, vehicle, now_ms)
            case Phase.PROVING if not self._proving and now_ms - self._proved_ms >= AGAIN_MS:
                return self._prove(self._gate)
            case Phase.TO_PAD if self._there(self._gate, vehicle) or now_ms - self._since_ms > GATE_PATIENCE_MS:
                return [self._turn(Phase.LANDING, Land(), vehicle, now_ms)]
            case Phase.LANDING if isinstance(self._standing, Land):
                self._stands = self._touch_down.look(vehicle, _above_mm(self._gate, vehicle), now_ms)
                if self._stands:
                    return [Tell(f"it stands at {self._gate.pad_id}; its autopilot has not noticed yet")]
            case Phase.REFUSED:
                return self._returning(self._gate, vehicle, now_ms)
        return []

    def permit(self, pad_id: str, vehicle: Vehicle | None, now_ms: int) -> tuple[str, list[Order]]:
        """A committed verdict permits the landing. The text says why it cannot be made use of; empty where it is."""
        gate = self._gates.get(pad_id)
        if vehicle is None:
            return "the autopilot does not say where it is", []
        if self.phase is Phase.OVERRIDDEN:
            return f"overridden: {self.why}", []
        if vehicle.on_ground or not vehicle.armed:
            return "", []
        if gate is None or not self._in_approach(gate, vehicle):
            return f"the drone is not above pad {pad_id}", []
        if self.phase is not Phase.WATCHING and self._gate != gate:
            return f"the drone waits above another pad than {pad_id}", []
        watched = self.phase is Phase.WATCHING
        self._gate, self._proving, self._permitted, self._went_around = gate, False, True, 0
        if watched and vehicle.mode is Mode.OTHER:
            self.phase, self._standing = Phase.LANDING, None
            return "", [Tell(f"the ledger permits the landing at {pad_id}; the pilot flies")]
        told = Tell(f"the ledger permits the landing at {pad_id}: landing")
        if _aside_mm(gate, vehicle) > AT_GATE_MM:
            return "", [told, self._turn(Phase.TO_PAD, self._place_of(gate), vehicle, now_ms)]
        return "", [told, self._turn(Phase.LANDING, Land(), vehicle, now_ms)]

    def strayed(self, place_m: tuple[float, float, float], vehicle: Vehicle, now_ms: int) -> list[Order]:
        """On its way down the ranges have it there, so far aside that it would come down beside its pad.

        The place above the pad is reckoned from where they have it: a receiver may be far off, and be the reason.
        """
        if self.phase is not Phase.LANDING or not isinstance(self._standing, Land) or self._gate is None:
            return []
        if self._stands or vehicle.on_ground or vehicle.mode is not Mode.LANDING:
            return []
        where = f"{math.hypot(*place_m[:2]):.1f} m beside {self._gate.pad_id} by the ranges"
        if self._went_around >= self._settings.go_arounds:
            return self.revoke(f"{where}, after {self._went_around} go-arounds", vehicle, now_ms)
        self._went_around += 1
        east_mm, north_mm, up_mm = (
            there - round(1e3 * here) for there, here in zip(_local(self._gate, vehicle.claim), place_m, strict=True)
        )
        above = GoTo(*to_wgs84(self._gate.frame, east_mm, north_mm, up_mm + self._gate_mm))
        told = Tell(f"{where}: going around ({self._went_around} of {self._settings.go_arounds})")
        return [told, self._turn(Phase.TO_PAD, above, vehicle, now_ms)]

    def revoke(self, reason: str, vehicle: Vehicle | None, now_ms: int) -> list[Order]:
        """The permission is gone before the drone was down."""
        if not self._permitted or self._stands or (vehicle is not None and vehicle.on_ground):
            return []
        if vehicle is None:
            self._revoked = reason
            return []
        self._permitted, self._revoked = False, ""
        if self.phase is Phase.OVERRIDDEN:
            return []
        assert self._gate is not None
        self.why = reason
        if self._standing is None:
            return self._override(vehicle, now_ms)
        back = self._turn(Phase.REFUSED, self._place_of(self._gate), vehicle, now_ms)
        return [Tell(f"the permission is gone ({reason}): holding"), back]

    def proof_ended(self, why_not: str, vehicle: Vehicle | None, now_ms: int) -> list[Order]:
        """The proof brought no permission; or one that was made use of, when the phase is another by now."""
        self._proving = False
        if self.phase is not Phase.PROVING or vehicle is None or self._gate is None:
            return []
        self._proved_ms = now_ms
        self.why = why_not
        pad_id, most, refused = self._gate.pad_id, self._settings.attempts, self._settings.refused
        if self._attempts < most:
            return [Tell(f"attempt {self._attempts} of {most} at {pad_id}: {why_not}")]
        told = Tell(f"no permission to land at {pad_id}: {why_not}; {_WHAT[refused]}")
        alternate = self._settings.alternate
        order: GoTo | Return = self._place_of(self._gate)
        if refused == "return":
            order = Return()
        elif alternate is not None:
            order = GoTo(round(alternate.lat * 1e7), round(alternate.lon * 1e7), round(alternate.height_m * 1_000))
        return [told, self._turn(Phase.REFUSED, order, vehicle, now_ms)]

    # --- phases ------------------------------------------------------------------------------------------------

    def _on_ground(self, vehicle: Vehicle) -> list[Order]:
        phase, gate = self.phase, self._gate
        self._resume = None
        if phase is Phase.WATCHING:
            return []
        permitted, self._permitted, self._revoked = self._permitted and not self._revoked, False, ""
        said: list[Order] = []
        if not permitted and gate is not None and self._in_approach(gate, vehicle):
            cause = self._cause if phase is Phase.OVERRIDDEN else "not_held"
            text = f"on the ground at {gate.pad_id} without a permission: {self.why or phase.value}"
            said = [Report(gate.pad_id, cause, text)]
        self._forget()
        return said

    def _forget(self) -> None:
        """What comes is another flight."""
        self.phase, self._gate, self._standing, self.why = Phase.WATCHING, None, None, ""
        self._permitted = self._stands = False

    def _watch(self, vehicle: Vehicle, now_ms: int) -> list[Order]:
        gate = self.near(vehicle)
        waits = self._waits(gate, vehicle)
        if gate is None or not (waits or self._lands(gate, vehicle)):
            return []
        self._gate, self._attempts, self._proving, self._permitted, self.why = gate, 0, False, False, ""
        if vehicle.failsafe:
            return self._override(vehicle, now_ms)
        told = Tell(f"about to land at {gate.pad_id}: held until a verdict permits it")
        return [told, self._turn(Phase.TO_GATE, self._place_of(gate), vehicle, now_ms)]

    def _waits(self, gate: Gate | None, vehicle: Vehicle) -> bool:
        """Whether it still waits where it was held before a restart; asked until the pad's place is known."""
        if self._resume is None or (self._resume not in self._gates and vehicle.mode is Mode.HELD):
            return False
        pad_id, self._resume = self._resume, None
        return gate is not None and gate.pad_id == pad_id and vehicle.mode is Mode.HELD

    def _to_gate(self, gate: Gate, vehicle: Vehicle, now_ms: int) -> list[Order]:
        there = self._there(gate, vehicle) and vehicle.speed_mm_s <= STILL_MM_S
        if not there and now_ms - self._since_ms < GATE_PATIENCE_MS:
            return []
        self.phase = Phase.PROVING
        return self._prove(gate)

    def _prove(self, gate: Gate) -> list[Order]:
        self._proving = True
        self._attempts += 1
        return [Prove(gate.pad_id)]

    def _returning(self, gate: Gate, vehicle: Vehicle, now_ms: int) -> list[Order]:
        if not isinstance(self._standing, Return):
            return []
        if not self._in_approach(gate, vehicle):
            self.phase, self._gate, self._standing = Phase.WATCHING, None, None
            return []
        if not self._lands(gate, vehicle):
            return []
        # Launch is this very pad: what was refused is not landed by another name.
        told = Tell(f"returning would land at {gate.pad_id}: holding")
        return [told, self._turn(Phase.REFUSED, self._place_of(gate), vehicle, now_ms)]

    # --- parts -------------------------------------------------------------------------------------------------

    def _in_approach(self, gate: Gate, vehicle: Vehicle) -> bool:
        return _aside_mm(gate, vehicle) <= self._approach_mm

    def _lands(self, gate: Gate, vehicle: Vehicle) -> bool:
        if vehicle.mode is Mode.LANDING or vehicle.landing:
            return True
        low = _above_mm(gate, vehicle) < 2 * self._gate_mm
        return vehicle.mode in {Mode.RETURNING, Mode.MISSION} and low and vehicle.down_mm_s > DESCENT_MM_S

    def _place_of(self, gate: Gate) -> GoTo:
        return GoTo(*to_wgs84(gate.frame, 0, 0, self._gate_mm))

    def _there(self, gate: Gate, vehicle: Vehicle) -> bool:
        """Whether it is where it was told to go."""
        assert isinstance(self._standing, GoTo)
        return math.dist(_local(gate, vehicle.claim), _local(gate, self._standing)) <= AT_GATE_MM

    def _turn(self, phase: Phase, order: GoTo | Land | Return, vehicle: Vehicle, now_ms: int) -> Order:
        self.phase, self._since_ms = phase, now_ms
        self._before, self._standing, self._ordered_ms = self._standing, order, now_ms
        self._from_mode, self._obeyed = vehicle.custom_mode, False
        if phase is Phase.LANDING and self._gate is not None:
            self._touch_down.begin(_above_mm(self._gate, vehicle), self._gate_mm)
        return order

    def _insist(self, now_ms: int) -> list[Order]:
        """The same again where it showed no effect."""
        if self._standing is None or now_ms - self._ordered_ms < AGAIN_MS:
            return []
        self._ordered_ms = now_ms
        return [self._standing]

    def _taken_over(self, vehicle: Vehicle, now_ms: int) -> bool:
        """Whether somebody else flies: in a mode that is neither the ordered one nor that in which the order came."""
        if self._standing is None:
            return False
        if vehicle.mode is _WANTED[type(self._standing)]:
            changed = vehicle.custom_mode != self._from_mode
            self._obeyed = self._obeyed or changed or now_ms - self._since_ms > OBEYED_MS
            return False
        if self._obeyed:
            return True
        recent = now_ms - self._since_ms <= OBEYED_MS
        if self._before is None and recent and vehicle.mode is Mode.LANDING:
            # That it lands is told several times a second, its mode once: the news of what it was stopped for.
            self._from_mode = vehicle.custom_mode
        if self._before is not None and recent:
            return vehicle.mode is not _WANTED[type(self._before)] and vehicle.custom_mode != self._from_mode
        return vehicle.custom_mode != self._from_mode

    def _override(self, vehicle: Vehicle, now_ms: int) -> list[Order]:
        self._cause = "failsafe" if vehicle.failsafe else "pilot"
        who = _WHO[self._cause]
        self.phase, self._since_ms, self._standing, self.why = Phase.OVERRIDDEN, now_ms, None, who
        pad_id = self._gate.pad_id if self._gate is not None else ""
        return [Tell(f"{who} at {pad_id}: nothing more is ordered until it is on the ground")]


_WANTED: Final = {GoTo: Mode.HELD, Land: Mode.LANDING, Return: Mode.RETURNING}
_WHO: Final = {"failsafe": "a fail-safe of the autopilot flies", "pilot": "the pilot flies"}
_WHAT: Final = {"hold": "holding", "return": "returning to launch", "alternate": "going to the alternate"}


def _local(gate: Gate, place: Claim | GoTo) -> tuple[int, int, int]:
    return to_local(gate.frame, place.lat_e7, place.lon_e7, place.height_mm)


def _aside_mm(gate: Gate, vehicle: Vehicle) -> float:
    return math.hypot(*_local(gate, vehicle.claim)[:2])


def _above_mm(gate: Gate, vehicle: Vehicle) -> int:
    return _local(gate, vehicle.claim)[2]
