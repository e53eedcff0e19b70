"""Flights as they are: what was claimed within the last minute, by drone. In memory only.

A flight begins with the first position of a drone that says it flies (or does not say), and ends when it was not heard
for a minute. Its id is random: it tells nothing about the drone.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from uas_standards.astm.f3411.v22a import constants
from uas_standards.astm.f3411.v22a.api import RIDOperationalStatus

from wonderland_backend.uspace.claims import Details, State
from wonderland_backend.uspace.geo import Box

WINDOW_MS: Final = constants.NetMaxNearRealTimeDataPeriodSeconds * 1000
STEP_MS: Final = 1000 // constants.NetMinUasLocRefreshFrequencyHz
"""Positions are kept this far apart: the standard asks for one a second; a faster source's newest is always shown."""
MAX_FLIGHTS: Final = 20_000
NETWORK_MS: Final = 5_000
"""So long a drone's own agent, which has proved who it is, counts for more than broadcasts in its name."""


@dataclass(slots=True)
class Flight:
    """One flight of one drone."""

    flight_id: str
    drone: str
    details: Details
    simulated: bool = False
    states: deque[State] = field(default_factory=deque)
    """Oldest first; the last one is the current state."""
    heard_ms: int = 0
    changed: int = 0
    """The number of its last change among those of all flights."""
    networked_ms: int = 0
    """When the drone's own agent last said where it is; 0: never."""
    south: int = 0
    north: int = 0
    """Bounds of the latitudes in `states`, or wider."""

    @property
    def current(self) -> State:
        """The newest state; there is always one."""
        return self.states[-1]

    @property
    def is_airborne(self) -> bool:
        """Whether it flew within the last minute: a drone that says it stands on the ground is no flight."""
        return any(state.status is not RIDOperationalStatus.Ground for state in self.states)

    def was_in(self, view: Box) -> bool:
        """Whether any of its positions of the last minute lies in a view."""
        if self.north < view.south or self.south > view.north:
            return False
        return any(view.contains(state.lat, state.lng) for state in self.states)

    def take_state(self, state: State) -> bool:
        """A newer state, or one of the same moment that changes nothing. Returns whether it was new."""
        if self.states and state.t_ms <= self.current.t_ms:
            return False
        # The newest gives way until it lies a step from the one before it.
        if len(self.states) > 1 and self.current.t_ms - self.states[-2].t_ms < STEP_MS:
            self.states.pop()
        if not self.states:
            self.south = self.north = state.lat
        self.states.append(state)
        self.south, self.north = min(self.south, state.lat), max(self.north, state.lat)
        return True

    def forget(self, before_ms: int) -> bool:
        """Drop older states; whether any is left."""
        dropped = False
        while self.states and self.states[0].t_ms < before_ms:
            self.states.popleft()
            dropped = True
        if dropped and self.states:
            self.south = min(state.lat for state in self.states)
            self.north = max(state.lat for state in self.states)
        return bool(self.states)


class Flights:
    """All flights that are heard of now."""

    def __init__(self, clock: Callable[[], int], new_id: Callable[[], str]) -> None:
        """`clock` gives Unix ms, `new_id` an id that tells nothing."""
        self.changes = 0
        """How many changes there were."""
        self._clock = clock
        self._new_id = new_id
        self._by_drone: OrderedDict[str, Flight] = OrderedDict()
        self._by_id: dict[str, Flight] = {}

    def take_state(
        self,
        drone: str,
        state: State,
        details: Details,
        *,
        heard_ms: int,
        flight_id: str | None = None,
        simulated: bool = False,
        networked: bool = False,
    ) -> Flight | None:
        """A state of a drone; its flight, unless the state is older than the last minute or than what is known.

        `networked`: by the drone's own agent. While that speaks, what is broadcast in the drone's name is left out.
        """
        now = self._clock()
        if state.t_ms < now - WINDOW_MS:
            return None
        flight = self._by_drone.get(drone)
        if flight is not None and not flight.forget(now - WINDOW_MS):
            self._end(flight)
            flight = None
        if flight is None:
            flight = Flight(flight_id or self._new_id(), drone, details, simulated)
            self._by_drone[drone] = self._by_id[flight.flight_id] = flight
            while len(self._by_drone) > MAX_FLIGHTS:
                self._end(next(iter(self._by_drone.values())))
        elif not networked and now - flight.networked_ms < NETWORK_MS:
            return None
        if not flight.take_state(state):
            return None
        if networked:
            flight.networked_ms = now
        flight.details = _newer(flight.details, details)
        flight.heard_ms = heard_ms
        self.changes += 1
        flight.changed = self.changes
        self._by_drone.move_to_end(drone)
        return flight

    def tidy(self) -> None:
        """Forget what is older than a minute."""
        before_ms = self._clock() - WINDOW_MS
        for flight in list(self._by_drone.values()):
            if not flight.forget(before_ms):
                self._end(flight)

    def remove(self, flight_id: str) -> None:
        """End a flight now."""
        flight = self._by_id.get(flight_id)
        if flight is not None:
            self._end(flight)

    def find_flight(self, flight_id: str) -> Flight | None:
        """A flight of the last minute."""
        flight = self._by_id.get(flight_id)
        if flight is None or not flight.forget(self._clock() - WINDOW_MS):
            return None
        return flight

    def __iter__(self) -> Iterator[Flight]:
        """Those of the last minute."""
        before_ms = self._clock() - WINDOW_MS
        return (flight for flight in list(self._by_drone.values()) if flight.forget(before_ms))

    def __len__(self) -> int:
        return len(self._by_drone)

    def _end(self, flight: Flight) -> None:
        self._by_drone.pop(flight.drone, None)
        self._by_id.pop(flight.flight_id, None)


def _newer(known: Details, details: Details) -> Details:
    """The newer details, unless they say nothing; a registration that was known stays known."""
    if not details.uas_id:
        return known
    registration = known.operator.registration
    if registration is None or details.operator.registration is not None:
        return details
    return replace(details, operator=replace(details.operator, registration=registration))
