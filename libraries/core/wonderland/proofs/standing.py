"""Which moment a verdict's place is of: part of step 5.

The place in a verdict is a claim of one moment, moved by the offset that all rounds measured. Claims that waver less
than would matter for the whole may still be off by metres at a single moment, and one of these in the middle of the
session would certify a place where the drone never was. So where the claims leave a straight flight, the moment is one
that what was measured about it bears out: of the stretches of a session that whose own ranges agree best with all of
them, and in it the round whose claim lies in the middle of its neighbours'.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from wonderland.proofs.claims import LocalClaim, Track
from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import Reduced, Residuals, distance
from wonderland.proofs.sights import Sights

STRAIGHT_MM: Final = 250.0
"""Claims that lie so near to a straight flight, or nearer, are off by no more than that at any moment."""
STRETCHES: Final = 6
"""A session is cut into so many, and each two neighbours' halves make one more."""
LEAST_ROUNDS: Final = 6
"""Fewer rounds by themselves tell too little of a place far from a small pad."""


def standing_at(reduced: Reduced, offset: Offset) -> LocalClaim | None:
    """The claim of the moment that the verdict's place is of; None where nothing was ranged."""
    seen = reduced.residuals
    if seen is None:
        return None
    if _straight(seen.track):
        return seen.track.middle()
    steady = _steady(seen)
    count = len(steady)
    length = max(LEAST_ROUNDS, count // STRETCHES)
    if count <= length:
        return _central(seen.claimed.only(steady))
    starts = [*range(0, count - length, max(length // 2, 1)), count - length]
    stretches = [steady[start : start + length] for start in starts]
    return _central(seen.claimed.only(min(stretches, key=lambda rows: _away(reduced, offset, seen, rows))))


def _straight(track: Track) -> bool:
    """Whether the claims lie on one straight flight at a steady speed, give or take ``STRAIGHT_MM``."""
    first_ms, span = track.t_ms[0], track.t_ms[-1] - track.t_ms[0]
    if span <= 0:
        return True
    east, north = track.east[-1] - track.east[0], track.north[-1] - track.north[0]
    for t_ms, x, y in zip(track.t_ms, track.east, track.north, strict=True):
        share = (t_ms - first_ms) / span
        off = distance(x - track.east[0] - east * share, y - track.north[0] - north * share, 0.0)
        if off > STRAIGHT_MM / 2.0:
            return False
    return True


def _steady(seen: Residuals) -> list[int]:
    """Rounds (positions in the claimed track) that are neither torn nor next to one that is; else all that are left."""
    left = set(seen.track.kept)
    kept = [position for position, moment in enumerate(seen.claimed.kept) if moment in left]
    if not seen.torn:
        return kept
    torn = [moment not in left for moment in seen.claimed.kept]
    near = {at + side for at, (one, other) in enumerate(pairwise(torn)) if one != other for side in (0, 1)}
    steady = [position for position in kept if position not in near]
    return steady if len(steady) >= LEAST_ROUNDS else kept


def _away(reduced: Reduced, offset: Offset, seen: Residuals, rows: Sequence[int]) -> float:
    """How far (mm) what a stretch's rounds measured against their claims lies from what all did."""
    first, last, middle = rows[0], rows[-1], rows[len(rows) // 2]
    inside = set(rows)
    away: list[float | None] = []
    for column, mean in seen.series:
        values = [
            value
            for position, value in zip(column.rounds, column.values, strict=True)
            if first <= position <= last and position in inside
        ]
        total = 0.0
        for value in values:
            total += value - mean
        away.append(total / len(values) if values else None)
    track = seen.claimed
    found = Sights(reduced, offset, track.east[middle], track.north[middle], track.up[middle]).offset(away)
    return distance(found[0], found[1], 0.0) if found is not None else float("inf")


def _central(track: Track) -> LocalClaim:
    """The claim nearest to the median of these, the one next to the middle of their times among equals."""
    half = len(track.t_ms) // 2
    east, north = sorted(track.east)[half], sorted(track.north)[half]
    middle_ms = track.mean_ms()
    at = min(
        range(len(track.t_ms)),
        key=lambda position: (
            distance(track.east[position] - east, track.north[position] - north, 0.0),
            abs(track.t_ms[position] - middle_ms),
        ),
    )
    return LocalClaim(track.t_ms[at], track.east[at], track.north[at], track.up[at])
