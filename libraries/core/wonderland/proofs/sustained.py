"""Which rounds know their place: part of step 5.

A range that fits no claim is left out as a burst, and an anchor may not have been heard at all. The anchors that are
left in such a round can be too few to tell its place: two of them, or three in a row, fit a second place as well, the
mirror image of the first. A drone that claims that one in half of its rounds, and lets nobody be heard there who would
contradict it, would be certified half-way between. So a round in which an anchor is missing counts where those that are
left know no second place, or where the rounds that do know theirs before and after it show a flight through its claim;
in the others the claims are judged as claims between rounds are.

A second place is sought where it can be: in the mirror through two anchors, at the claimed height, in the mirror plane
of three, at another height, and beside the line through two, where ranges hardly change.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import sqrt
from typing import Final

from wonderland.proofs.claims import LOWEST_MM, MAX_ACCELERATION_MM_MS2, Track
from wonderland.proofs.records.pads import Commissioning

APART_MM: Final = 500.0
"""A second place nearer than this is no other one: lies that small win nothing."""
EDGE_MS: Final = 300
"""Beyond the first or the last round that knows its place a flight is followed for so long."""
PLACING_ANCHORS: Final = 3
"""Fewer leave a whole circle open."""
_STEPS: Final = 4
_RIDGE: Final = 1e-3
_SINGULAR: Final = 1e-9

Place = tuple[float, float, float]


def vague_rounds(
    track: Track, heard: Sequence[frozenset[int]], commissioning: Commissioning, limit_mm: float
) -> frozenset[int]:
    """The rounds (positions in ``track``) whose anchors leave a second place open that no flight excludes.

    ``heard``: by round the anchors (positions in the commissioning) that fit its claim; ``limit_mm``: up to which error
    a range fits.
    """
    everybody = frozenset().union(*heard)
    if not everybody:
        return frozenset(range(len(heard)))
    lowest = min(commissioning.anchors[index].up_mm for index in everybody) - LOWEST_MM
    vague = set()
    for position, who in enumerate(heard):
        if who == everybody:
            continue
        if len(who) < PLACING_ANCHORS:
            vague.add(position)
            continue
        anchors = [commissioning.anchors[index] for index in sorted(who)]
        places = [(float(each.east_mm), float(each.north_mm), float(each.up_mm)) for each in anchors]
        claimed = (track.east[position], track.north[position], track.up[position])
        if _has_second(places, claimed, lowest, limit_mm):
            vague.add(position)
    return frozenset(position for position in vague if not _flown(track, position, vague))


def _flown(track: Track, position: int, vague: set[int]) -> bool:
    """Whether a drone that was where the nearest rounds outside of ``vague`` claim flew by this one's claim."""
    count = len(track.t_ms)
    before, after = _nearest(position, -1, count, vague), _nearest(position, 1, count, vague)
    if before is None or after is None:
        before, after = (after, before) if before is None else (before, after)
        after = None if before is None else _nearest(before, 1 if before > position else -1, count, vague)
        if before is None or after is None or abs(track.t_ms[position] - track.t_ms[before]) > EDGE_MS:
            return False
    since, until = track.t_ms[position] - track.t_ms[before], track.t_ms[after] - track.t_ms[position]
    turned = MAX_ACCELERATION_MM_MS2 * abs(since * until) / 2.0
    if since + until == 0 or turned > APART_MM:
        return False
    share = since / (since + until)
    off = [
        column[position] - column[before] - (column[after] - column[before]) * share
        for column in (track.east, track.north, track.up)
    ]
    return sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) <= APART_MM + turned


def _nearest(position: int, step: int, count: int, vague: set[int]) -> int | None:
    """The next round in a direction that is none of ``vague``."""
    position += step
    while position in vague:
        position += step
    return position if 0 <= position < count else None


def heard_in(count: int, columns: Sequence[tuple[int, Sequence[int], frozenset[int]]]) -> list[frozenset[int]]:
    """By round, the anchors that fit: ``columns`` are (anchor, rounds that it measured, those of its bursts)."""
    heard: list[set[int]] = [set() for _ in range(count)]
    for anchor, rounds, bursts in columns:
        for moment in rounds:
            if moment not in bursts:
                heard[moment].add(anchor)
    return [frozenset(each) for each in heard]


def _has_second(anchors: Sequence[Place], claimed: Place, lowest: float, limit: float) -> bool:
    """Whether ranges that fit the claimed place fit another one as well."""
    ranges = [_away(claimed, anchor) for anchor in anchors]
    # Were each error as large as one may be, that of the best fit would be no larger than this.
    largest = sqrt(float(len(anchors))) * limit
    for one, other in combinations(anchors, 2):
        if any(_error(anchors, ranges, place) <= limit for place in _beside(claimed, one, other)):
            return True
        if _fits(anchors, ranges, _mirrored_upright(claimed, one, other), claimed, largest, level=True):
            return True
    for one, other, third in combinations(anchors, 3):
        start = _mirrored(claimed, one, other, third)
        if start is not None and start[2] >= lowest and _fits(anchors, ranges, start, claimed, largest, level=False):
            return True
    return False


def _away(place: Place, anchor: Place) -> float:
    x, y, z = place[0] - anchor[0], place[1] - anchor[1], place[2] - anchor[2]
    return sqrt(x * x + y * y + z * z)


def _apart(place: Place, claimed: Place) -> bool:
    x, y = place[0] - claimed[0], place[1] - claimed[1]
    return x * x + y * y > APART_MM * APART_MM


def _error(anchors: Sequence[Place], ranges: Sequence[float], place: Place) -> float:
    """The largest, of all ranges to a place."""
    return max(abs(wanted - _away(place, anchor)) for anchor, wanted in zip(anchors, ranges, strict=True))


def _beside(place: Place, one: Place, other: Place) -> tuple[Place, ...]:
    """On both sides of the line through two anchors, twice as far from the place as is apart."""
    x, y = other[0] - one[0], other[1] - one[1]
    length = sqrt(x * x + y * y)
    if length < 1.0:
        return ()
    east, north = 2.0 * APART_MM * y / length, -2.0 * APART_MM * x / length
    return (place[0] + east, place[1] + north, place[2]), (place[0] - east, place[1] - north, place[2])


def _mirrored_upright(place: Place, one: Place, other: Place) -> Place:
    """In the upright plane through two anchors; on the other side of both where they stand above one another."""
    x, y = other[0] - one[0], other[1] - one[1]
    square = x * x + y * y
    east, north = place[0] - one[0], place[1] - one[1]
    if square < 1.0:
        return one[0] - east, one[1] - north, place[2]
    across = 2.0 * (east * y - north * x) / square
    return place[0] - across * y, place[1] + across * x, place[2]


def _mirrored(place: Place, one: Place, other: Place, third: Place) -> Place | None:
    """In the plane of three anchors; None where they stand in a line."""
    ax, ay, az = other[0] - one[0], other[1] - one[1], other[2] - one[2]
    bx, by, bz = third[0] - one[0], third[1] - one[1], third[2] - one[2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    square = nx * nx + ny * ny + nz * nz
    if square <= _SINGULAR * (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz):
        return None
    over = 2.0 * ((place[0] - one[0]) * nx + (place[1] - one[1]) * ny + (place[2] - one[2]) * nz) / square
    return place[0] - over * nx, place[1] - over * ny, place[2] - over * nz


def _fits(
    anchors: Sequence[Place], ranges: Sequence[float], start: Place, claimed: Place, limit: float, *, level: bool
) -> bool:
    """Whether a place near a start, apart from the claimed one, fits all ranges; ``level``: at its height."""
    place = start
    for step in range(_STEPS + 1):
        largest = 0.0
        ee = en = nn = eu = nu = uu = be = bn = bu = 0.0
        for anchor, wanted in zip(anchors, ranges, strict=True):
            x, y, z = place[0] - anchor[0], place[1] - anchor[1], place[2] - anchor[2]
            away = max(sqrt(x * x + y * y + z * z), 1.0)
            error = wanted - away
            largest = max(largest, abs(error))
            x, y, z = x / away, y / away, 0.0 if level else z / away
            ee, en, nn = ee + x * x, en + x * y, nn + y * y
            eu, nu, uu = eu + x * z, nu + y * z, uu + z * z
            be, bn, bu = be + x * error, bn + y * error, bu + z * error
        if largest <= limit:
            return _apart(place, claimed)
        if step == _STEPS:
            break
        moved = _solved((ee + _RIDGE, en, eu, nn + _RIDGE, nu, uu + _RIDGE), (be, bn, bu))
        place = place[0] + moved[0], place[1] + moved[1], place[2] + moved[2]
    return False


def _solved(matrix: tuple[float, float, float, float, float, float], right: Place) -> Place:
    """Of a symmetric positive matrix (ee, en, eu, nn, nu, uu), by Cramer's rule."""
    ee, en, eu, nn, nu, uu = matrix
    x, y, z = right
    a, b, c = nn * uu - nu * nu, eu * nu - en * uu, en * nu - eu * nn
    determinant = ee * a + en * b + eu * c
    return (
        (a * x + b * y + c * z) / determinant,
        (b * x + (ee * uu - eu * eu) * y + (en * eu - ee * nu) * z) / determinant,
        (c * x + (en * eu - ee * nu) * y + (ee * nn - en * en) * z) / determinant,
    )
