"""Being tested: flights that a test injects, as if drones reported them, and what their operators would be told.

Interfaces of InterUSS (`injection`, `observation`). They stand open under `--test-harness` alone.
"""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Annotated, Any, Final

from pydantic import Field, ValidationError
from uas_standards.astm.f3411.v22a.api import UAType

from wonderland.problems import said
from wonderland_backend.errors import NotFound, Problem
from wonderland_backend.uspace.claims import Details, State, time_of
from wonderland_backend.uspace.dss.models import Foreign
from wonderland_backend.uspace.flights import Flights
from wonderland_backend.uspace.netrid.foreign import AircraftState, ForeignDetails, TimeMs, current_state_of

MAX_TESTS: Final = 50
MAX_TEST_FLIGHTS: Final = 200
MAX_TELEMETRY: Final = 5_000
MAX_NOTICES: Final = 2_000
NEEDED: Final = ("timestamp_accuracy", "speed", "vertical_speed", "track", "speed_accuracy")
NEEDED_OF_POSITION: Final = ("lat", "lng", "alt", "accuracy_h", "accuracy_v")


class TestExists(Problem):
    """There is a test of this id already, or it has another version."""

    status, code = HTTPStatus.CONFLICT, "test-conflict"
    example = said("test_exists")


class InjectedDetails(Foreign):
    """`TestFlightDetails`."""

    effective_after: TimeMs
    details: ForeignDetails


class InjectedFlight(Foreign):
    """`TestFlight`. Its telemetry is looked at state by state: a test may leave out what a drone must not."""

    injection_id: Annotated[str, Field(min_length=1, max_length=200)]
    aircraft_type: UAType = UAType.NotDeclared
    telemetry: Annotated[list[dict[str, Any]], Field(max_length=MAX_TELEMETRY)]
    details_responses: Annotated[list[InjectedDetails], Field(min_length=1, max_length=100)]


class InjectedTest(Foreign):
    """`CreateTestParameters`."""

    requested_flights: Annotated[list[InjectedFlight], Field(max_length=MAX_TEST_FLIGHTS)]


@dataclass
class _Playing:
    drone: str
    flight_id: str
    details: list[tuple[int, Details]]
    states: deque[tuple[int, State | None, str]] = field(default_factory=deque)
    """Time, state if it can be shown, and what its operator is to be told."""

    def details_at(self, now_ms: int) -> Details:
        """The latest that are in effect."""
        found = self.details[0][1]
        for effective_ms, details in self.details:
            if effective_ms <= now_ms:
                found = details
        return found


@dataclass
class _Test:
    version: str
    flights: list[_Playing]
    content: list[dict[str, Any]]


class Harness:
    """Plays injected flights as their times come."""

    def __init__(self, flights: Flights, clock: Callable[[], int]) -> None:
        self._flights = flights
        self._clock = clock
        self._tests: dict[str, _Test] = {}
        self._notices: deque[tuple[int, str]] = deque(maxlen=MAX_NOTICES)

    def create(self, test_id: str, test: InjectedTest, content: dict[str, Any]) -> dict[str, Any]:
        """`ChangeTestResponse` of a new test; `content` is the request as it came. Raises `TestExists`."""
        if test_id in self._tests or len(self._tests) >= MAX_TESTS:
            raise TestExists(said("test_exists"))
        injected = []
        for flight, asked in zip(test.requested_flights, content["requested_flights"], strict=True):
            playing = _playing(flight)
            injected.append((playing, _with_id(asked, playing.flight_id)))
        made = _Test(str(uuid.uuid4()), [playing for playing, _ in injected], [shown for _, shown in injected])
        self._tests[test_id] = made
        self.advance()
        return {"injected_flights": made.content, "version": made.version}

    def delete(self, test_id: str, version: str) -> dict[str, Any]:
        """`DeleteTestResponse`: the flights are gone. Raises `NotFound`, `TestExists` for another version."""
        test = self._tests.get(test_id)
        if test is None:
            raise NotFound(said("no_such_test"))
        if test.version != version:
            raise TestExists(said("test_other_version"))
        del self._tests[test_id]
        for playing in test.flights:
            self._flights.remove(playing.flight_id)
        return {"injected_flights": test.content}

    def advance(self) -> None:
        """Hand over the states whose time has come."""
        now = self._clock()
        for test in self._tests.values():
            for playing in test.flights:
                _play(playing, now, self._flights, self.notify)

    def notify(self, message: str) -> None:
        """Something that an operator is told."""
        self._notices.append((self._clock(), message))

    def notices(self, after_ms: int, before_ms: int) -> dict[str, Any]:
        """`QueryUserNotificationsResponse`."""
        found = [
            {"observed_at": time_of(t_ms), "message": message}
            for t_ms, message in self._notices
            if after_ms <= t_ms <= before_ms
        ]
        return {"user_notifications": found}


def _play(playing: _Playing, now_ms: int, flights: Flights, notify: Callable[[str], None]) -> None:
    while playing.states and playing.states[0][0] <= now_ms:
        _, state, problem = playing.states.popleft()
        if problem:
            notify(problem)
        if state is not None:
            flights.take_state(
                playing.drone,
                state,
                playing.details_at(now_ms),
                heard_ms=now_ms,
                flight_id=playing.flight_id,
                simulated=True,
            )


def _playing(flight: InjectedFlight) -> _Playing:
    details = sorted(
        ((each.effective_after, each.details.details(flight.aircraft_type)) for each in flight.details_responses),
        key=lambda each: each[0],
    )
    playing = _Playing(f"test {flight.injection_id}", flight.details_responses[0].details.id, details)
    states = [_read(flight.injection_id, raw) for raw in flight.telemetry]
    playing.states.extend(sorted(states, key=lambda each: each[0]))
    return playing


def _read(injection_id: str, raw: dict[str, Any]) -> tuple[int, State | None, str]:
    who = f"Flight {injection_id}"
    try:
        told = AircraftState.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        return 0, None, f"{who}: its telemetry cannot be used ({where}: {first['msg']})"
    missing = [name for name in NEEDED if getattr(told, name) is None and raw.get(name) is None]
    missing += [name for name in NEEDED_OF_POSITION if getattr(told.position, name) is None]
    problem = f"{who}: its telemetry lacks {', '.join(missing)}" if missing else ""
    return told.timestamp, current_state_of(told), problem


def _with_id(asked: dict[str, Any], flight_id: str) -> dict[str, Any]:
    """The flight as it was asked for, all its details under the one id that it flies as."""
    responses = [{**each, "details": {**each["details"], "id": flight_id}} for each in asked["details_responses"]]
    return {**asked, "details_responses": responses}
