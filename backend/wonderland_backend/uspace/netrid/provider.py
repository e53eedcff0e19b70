"""The service provider: which flights are ours to tell, and what of them is told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from wonderland_backend.uspace.claims import State, time_of
from wonderland_backend.uspace.flights import Flight, Flights
from wonderland_backend.uspace.geo import Box

MAX_RECENT_S: Final = 60


class ServiceProvider:
    """Answers display providers."""

    def __init__(self, flights: Flights, clock: Callable[[], int], serves: Callable[[Flight], bool]) -> None:
        """`serves` says whether a flight is one that we are the service provider of."""
        self._flights = flights
        self._clock = clock
        self._serves = serves

    def served(self) -> Iterator[Flight]:
        """The flights of the last minute that are ours to tell."""
        return (flight for flight in self._flights if flight.is_airborne and self._serves(flight))

    def flights_in(self, view: Box, recent_s: float, *, has_areas: bool) -> dict[str, Any]:
        """`GetFlightsResponse`: flights with a position of the last minute in the view.

        `has_areas`: whether an identification service area of ours meets the view.
        """
        now = self._clock()
        found = [_flight(flight, view, now, recent_s) for flight in self.served() if flight.was_in(view)]
        return {"timestamp": time_of(now), "flights": found, "no_isas_present": not has_areas and not found}

    def details(self, flight_id: str) -> dict[str, Any] | None:
        """`GetFlightDetailsResponse` of a flight of ours; None when there is none of this id."""
        flight = self._flights.find_flight(flight_id)
        if flight is None or not self._serves(flight):
            return None
        return {"details": flight.details.content(flight_id)}


def _flight(flight: Flight, view: Box, now_ms: int, recent_s: float) -> dict[str, Any]:
    content: dict[str, Any] = {
        "id": flight.flight_id,
        "aircraft_type": flight.details.aircraft_type,
        "current_state": flight.current.state(),
        "simulated": flight.simulated,
    }
    if recent_s > 0:
        since_ms = now_ms - int(recent_s * 1000)
        content["recent_positions"] = [state.recent() for state in within(flight, view) if state.t_ms >= since_ms]
    return content


def within(flight: Flight, view: Box) -> Iterator[State]:
    """Positions in the view, and those next to them by which it was entered or left; of others nothing is told."""
    states = list(flight.states)
    inside = [view.contains(state.lat, state.lng) for state in states]
    before, after = [False, *inside], [*inside[1:], False]
    return (state for state, *near in zip(states, inside, before, after, strict=False) if any(near))
