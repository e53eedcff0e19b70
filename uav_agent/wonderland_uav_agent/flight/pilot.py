"""Joins a gatekeeper to an autopilot's link and to the drone's agent: looks, orders, proofs, arming."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import Final

from wonderland.clock import Clock
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.verdicts import Verdict
from wonderland_uav_agent.flight.approach import GoTo, Land, Order, Phase, Prove, Report, Return, Tell
from wonderland_uav_agent.flight.arming import Arming
from wonderland_uav_agent.flight.gatekeeper import Gatekeeper
from wonderland_uav_agent.flight.memory import HeldMemory
from wonderland_uav_agent.flight.orders import Orders
from wonderland_uav_agent.flight.precision import PrecisionLanding
from wonderland_uav_agent.flight.settings import FlightSettings
from wonderland_uav_agent.flight.vehicle import Vehicle, VehicleState
from wonderland_uav_agent.position.mavlink import MavlinkPosition
from wonderland_uav_agent.position.mavlink.messages import Acknowledged, ArmingAsked, LandingTarget, Message, Outgoing
from wonderland_uav_agent.session.events import OwnRange
from wonderland_uav_agent.session.runner import RangeListener

_log = logging.getLogger(__name__)

TAKE_OFF_S: Final = 120.0
"""So long a permission to take off waits for somebody who arms."""

STRAYS_MS: Final = 300
"""A filter that has to turn with its drone may be beside it for a moment."""

Begin = Callable[[str, str, Callable[[str], None]], str]
"""Begin a proof (pad, action, what is called at its end with why there is no permission); why not, or empty."""


class Pilot:
    """The crew of a MAVLink link, and the ``act`` of the drone's agent.

    The only ways to a landing or to arming are ``act``, which is called with a committed verdict, and whoever else
    flies the drone.
    """

    def __init__(
        self, settings: FlightSettings, *, clock: Clock, antenna_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        self.gatekeeper = Gatekeeper(settings)
        self.arming = Arming(settings)
        self._precision = PrecisionLanding(antenna_m) if settings.precision else None
        self._state = VehicleState()
        self._orders = Orders()
        self._link: MavlinkPosition | None = None
        self._memory = HeldMemory(settings.memory)
        held_at = self._memory.held_at(clock())
        if held_at is not None:
            _log.warning("it was held at %s when this agent ended; if it still waits there it is held on", held_at)
            self.gatekeeper.resume(held_at)
        self._clock = clock
        self._begin: Begin | None = None
        self._report: Callable[[tx.ReportLanding], None] | None = None
        self._strays_since_ms: int | None = None
        self._looked = asyncio.Event()

    def board(self, link: MavlinkPosition) -> None:
        """Hear and speak there; before it is opened."""
        self._link = link
        link.board(self)

    def prove_with(self, begin: Begin) -> None:
        """What begins a proof."""
        self._begin = begin

    def report_with(self, report: Callable[[tx.ReportLanding], None]) -> None:
        """What says on the ledger that it came down without a permission."""
        self._report = report

    # --- the link's crew ---------------------------------------------------------------------------------------

    def take(self, message: Message, now_ms: int) -> None:
        """A message of the autopilot's."""
        self._state.take(message, now_ms)
        self.arming.take(message)
        if self._precision is not None:
            self._precision.take(message, now_ms)
        if isinstance(message, Acknowledged):
            problem = self._orders.answered(message, now_ms)
            if problem:
                _log.warning("%s", problem)
        elif isinstance(message, ArmingAsked):
            self._arming_asked(now_ms)

    def outgoing(self, now_ms: int) -> list[Outgoing]:
        """Looks at the vehicle, and says what to send."""
        vehicle = self.vehicle(now_ms)
        if vehicle is not None:
            self._do(self.gatekeeper.look(vehicle, now_ms), vehicle, now_ms)
            self._keep_above_the_pad(vehicle, now_ms)
            self._memory.note(self.gatekeeper.held_at, now_ms)
        self._looked.set()
        commands, problem = self._orders.due(now_ms)
        if problem:
            _log.warning("%s", problem)
        return [*commands, *self.arming.due(self._system, now_ms), *self._targets(vehicle, now_ms)]

    @property
    def on_range(self) -> RangeListener | None:
        """Who wants the ranges of the drone's node; None where the way down is not found by them."""
        return None if self._precision is None else self._ranged

    def _ranged(self, commissioning: Commissioning, event: OwnRange) -> None:
        if self._precision is not None:
            self._precision.range(commissioning, event.mac, event.t_ms, event.range_mm)

    def _targets(self, vehicle: Vehicle | None, now_ms: int) -> list[LandingTarget]:
        """Where the pad is, by the ranges, while a verdict permits to land there."""
        if self._precision is None or vehicle is None:
            return []
        self._precision.believe(vehicle.claim, now_ms)
        gate = self.gatekeeper.landing_at
        if gate is None:
            return []
        target = self._precision.target(gate.frame, vehicle.stack, self._system, now_ms)
        return [] if target is None else [target]

    def _keep_above_the_pad(self, vehicle: Vehicle, now_ms: int) -> None:
        gate = self.gatekeeper.landing_at
        fix = None if gate is None or self._precision is None else self._precision.fix(gate.frame, now_ms)
        if fix is None or not fix.strays:
            self._strays_since_ms = None
        elif self._strays_since_ms is None:
            self._strays_since_ms = now_ms
        elif now_ms - self._strays_since_ms >= STRAYS_MS:
            self._do(self.gatekeeper.strayed(fix.place_m, vehicle, now_ms), vehicle, now_ms)

    def vehicle(self, now_ms: int) -> Vehicle | None:
        """What it does now; None while that is not known."""
        claim = None if self._link is None else self._link.claim(now_ms)
        return self._state.seen(claim, now_ms)

    @property
    def _system(self) -> int:
        followed = None if self._link is None else self._link.navigator.sender
        return 0 if followed is None else followed.system

    # --- the agent's act ---------------------------------------------------------------------------------------

    async def act(self, verdict: Verdict) -> str:
        """Do what a committed verdict permits; returns ``done``, or why it was not done."""
        if verdict.action == "takeoff":
            return await self._let_take_off()
        if verdict.action == "land":
            return await self._land(verdict.pad_id)
        return "done"

    async def _land(self, pad_id: str) -> str:
        now_ms = self._clock()
        vehicle = self.vehicle(now_ms)
        why_not, orders = self.gatekeeper.permit(pad_id, vehicle, now_ms)
        if why_not:
            _log.warning("a permission to land at %s is not made use of: %s", pad_id, why_not)
            return why_not
        if vehicle is not None:
            self._do(orders, vehicle, now_ms)
        try:
            while self.gatekeeper.landing:
                await self._next_look()
        except asyncio.CancelledError:
            now_ms = self._clock()
            vehicle = self.vehicle(now_ms)
            orders = self.gatekeeper.revoke("the session ended", vehicle, now_ms)
            if vehicle is not None:
                self._do(orders, vehicle, now_ms)
            raise
        return "done" if self.gatekeeper.phase in {Phase.WATCHING, Phase.LANDING} else self.gatekeeper.why

    async def _let_take_off(self) -> str:
        """Arming is possible from now on, until it flies or nobody has armed it for a while."""
        self.arming.permit(self._clock() + round(TAKE_OFF_S * 1_000))
        try:
            async with asyncio.timeout(TAKE_OFF_S):
                while (vehicle := self.vehicle(self._clock())) is None or not vehicle.armed or vehicle.on_ground:
                    await self._next_look()
        except TimeoutError:
            return "nobody took off"
        finally:
            self.arming.withdraw()
        return "done"

    # --- parts -------------------------------------------------------------------------------------------------

    async def _next_look(self) -> None:
        self._looked.clear()
        await self._looked.wait()

    def _arming_asked(self, now_ms: int) -> None:
        vehicle = self.vehicle(now_ms)
        gate = self.gatekeeper.near(vehicle) if vehicle is not None else None
        wanted = self.arming.asked(now_ms, at_a_pad=gate is not None, known=vehicle is not None)
        if wanted and gate is not None and self._begin is not None:
            why_not = self._begin(gate.pad_id, "takeoff", lambda _: None)
            if why_not:
                _log.warning("no proof for taking off from %s: %s", gate.pad_id, why_not)

    def _do(self, orders: Iterable[Order], vehicle: Vehicle, now_ms: int) -> None:
        for order in orders:
            match order:
                case Tell():
                    _log.warning("%s", order.text)
                    if self.gatekeeper.phase is Phase.OVERRIDDEN:
                        self._orders.forget()
                case Report():
                    _log.error("%s", order.text)
                    if self._report is not None:
                        self._report(tx.ReportLanding(pad_id=order.pad_id, cause=order.cause, claim=vehicle.claim))
                case Prove():
                    self._prove(order.pad_id)
                case GoTo() | Land() | Return():
                    precise = isinstance(order, Land) and self._sees_pad(now_ms)
                    self._orders.give(order, vehicle, self._system, now_ms, precise=precise)

    def _sees_pad(self, now_ms: int) -> bool:
        """Whether the ranges say where the pad is."""
        gate = self.gatekeeper.landing_at
        return self._precision is not None and gate is not None and self._precision.fix(gate.frame, now_ms) is not None

    def _prove(self, pad_id: str) -> None:
        why_not = "no agent proves" if self._begin is None else self._begin(pad_id, "land", self._proved)
        if why_not:
            self._proved(why_not)

    def _proved(self, why_not: str) -> None:
        now_ms = self._clock()
        vehicle = self.vehicle(now_ms)
        orders = self.gatekeeper.proof_ended(why_not, vehicle, now_ms)
        if vehicle is not None:
            self._do(orders, vehicle, now_ms)
