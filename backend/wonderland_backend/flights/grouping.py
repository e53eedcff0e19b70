"""Which positions belong together, without I/O."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

GAP_MS: Final = 300_000
"""Not heard for longer, a drone has landed or left; heard again, it is another flight."""


Position = tuple[int, int, int]
"""t_ms, lat_e7, lon_e7."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A stretch of positions; the fields are the columns of its row."""

    flight_id: str
    uav_id: str
    start_ms: int
    end_ms: int
    positions: int
    south_e7: int
    west_e7: int
    north_e7: int
    east_e7: int
    first_lat_e7: int
    first_lon_e7: int
    last_lat_e7: int
    last_lon_e7: int

    @classmethod
    def of(cls, uav_id: str, positions: Sequence[Position]) -> Flight:
        """Positions in the order of their times, without a longer pause."""
        first, last = positions[0], positions[-1]
        lats, lons = [each[1] for each in positions], [each[2] for each in positions]
        flight_id = hashlib.sha256(f"{uav_id} {first[0]}".encode()).hexdigest()[:32]
        box = (min(lats), min(lons), max(lats), max(lons))
        return cls(flight_id, uav_id, first[0], last[0], len(positions), *box, *first[1:], *last[1:])

    def to_row(self) -> dict[str, Any]:
        """The flight as a row of the database."""
        return asdict(self)


def stretches(uav_id: str, positions: Iterable[Position]) -> list[Flight]:
    """Positions of one drone in any order, cut at its pauses."""
    ordered = sorted(positions)
    begins = [0, *(at for at in range(1, len(ordered)) if ordered[at][0] - ordered[at - 1][0] > GAP_MS)]
    ends = [*begins[1:], len(ordered)]
    return [Flight.of(uav_id, ordered[begin:end]) for begin, end in zip(begins, ends, strict=True) if begin < end]


def joined(one: Flight, other: Flight) -> Flight:
    """Both as one flight; it keeps the identifier of `one`."""
    first, last = min(one, other, key=_start), max(one, other, key=_end)
    return replace(
        one,
        start_ms=first.start_ms,
        end_ms=last.end_ms,
        positions=one.positions + other.positions,
        south_e7=min(one.south_e7, other.south_e7),
        west_e7=min(one.west_e7, other.west_e7),
        north_e7=max(one.north_e7, other.north_e7),
        east_e7=max(one.east_e7, other.east_e7),
        first_lat_e7=first.first_lat_e7,
        first_lon_e7=first.first_lon_e7,
        last_lat_e7=last.last_lat_e7,
        last_lon_e7=last.last_lon_e7,
    )


def grouped(known: Iterable[Flight], new: Iterable[Flight]) -> tuple[list[Flight], list[str]]:
    """Flights of one drone with new positions taken in: (those that are new or have changed, ids that are no more).

    Where positions that come late close a pause, two flights become one, which keeps the earlier one's identifier.
    """
    before = {flight.flight_id: flight for flight in known}
    found: list[Flight] = []
    for flight in sorted((*before.values(), *new), key=_start):
        if found and flight.start_ms - found[-1].end_ms <= GAP_MS:
            found[-1] = _keeping_known(found[-1], flight, before)
        else:
            found.append(flight)
    kept = {flight.flight_id for flight in found}
    changed = [flight for flight in found if before.get(flight.flight_id) != flight]
    return changed, [flight_id for flight_id in before if flight_id not in kept]


def _keeping_known(one: Flight, other: Flight, known: dict[str, Flight]) -> Flight:
    """Whoever looks at a flight that goes on must find it under the identifier that it had."""
    if one.flight_id not in known and other.flight_id in known:
        return joined(other, one)
    return joined(one, other)


def span(flights: Sequence[Flight]) -> tuple[int, int]:
    """From when until when known flights can touch these."""
    return min(map(_start, flights)) - GAP_MS, max(map(_end, flights)) + GAP_MS


def _start(flight: Flight) -> int:
    return flight.start_ms


def _end(flight: Flight) -> int:
    return flight.end_ms
