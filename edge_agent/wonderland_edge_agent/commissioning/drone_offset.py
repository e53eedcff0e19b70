"""How much longer a drone's ranges are than those of the tag with which the pad was commissioned: one offset for all.

Unknown are the offset, what each anchor's table is still wrong by, and where exactly the drone's antenna stood in each
session; the last two are known beforehand as well as the commissioning and the reference say. One linear least-squares
problem gives the offset and its σ, anchors' errors shared by all sessions included; its χ² says whether one offset
explains the ranges at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2

from wonderland.proofs.records.calibrations import MAX_OFFSET_MM, MAX_SIGMA_MM, SIGMA_FLOOR_MM
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import NO_RANGE, RangeTable
from wonderland.proofs.reduction import bias_at
from wonderland.proofs.rounds import usable
from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.run import Floats

Place = tuple[float, float, float]
"""East, north, up in the pad's frame, mm."""

MIN_ROUNDS: Final = 30
MIN_ANCHORS: Final = 4
"""Three explain any offset by another place."""
CHANCE: Final = 0.001
DAY_TO_DAY_MM: Final = 15.0
"""What another day's temperature changes."""
MEDIAN_WORTH: Final = math.pi / 2.0
"""A median's variance over a mean's."""
STEADY_SIGMAS: Final = 4.0
STEADY_FLOOR_MM: Final = 120.0
LOOSE_MM: Final = 1_000.0
"""How far off a place may be that was written down wrongly."""
VAGUE_MM: Final = 100.0
_MAD: Final = 1.4826


@dataclass(frozen=True)
class Ranged:
    """One session's ranges, and where the drone's antenna truly was at each moment (ms)."""

    session_id: str
    ranges: RangeTable
    place_at: Callable[[int], Place]


@dataclass(frozen=True)
class FoundOffset:
    """All lengths in mm."""

    offset_mm: float
    sigma_mm: float
    rounds: int
    by_anchor: dict[str, float]
    """What each anchor's ranges alone say, at the places as they were stated."""
    by_session: dict[str, float]
    chi2: float
    limit: float
    loose_sigma_mm: float
    """How well it would be known, were the stated places worth a metre only."""

    @property
    def rests_on_place(self) -> bool:
        """Whether a place that was written down wrongly would look like an offset."""
        return self.loose_sigma_mm > VAGUE_MM

    @property
    def stated_sigma_mm(self) -> int:
        """For the record."""
        return max(math.ceil(self.sigma_mm), SIGMA_FLOOR_MM)


@dataclass(frozen=True)
class _Row:
    """One anchor in one session."""

    session: int
    anchor: int
    residual: float
    variance: float
    direction: Floats


def find_offset(sessions: Sequence[Ranged], commissioning: Commissioning, *, reference_mm: float) -> FoundOffset:
    """The offset. ``reference_mm``: σ of each coordinate of the places. Raises CalibrationError, which says why not."""
    rows: list[_Row] = []
    rounds = 0
    for number, session in enumerate(sessions):
        found, count = _rows(number, session, commissioning)
        rows += found
        rounds += count
    if rounds < MIN_ROUNDS:
        raise CalibrationError(
            f"{rounds} rounds in {len(sessions)} sessions; {MIN_ROUNDS} are needed: let the drone ask again"
        )
    heard = {row.anchor for row in rows}
    if len(heard) < MIN_ANCHORS:
        raise CalibrationError(
            f"{len(heard)} anchors ranged the drone; {MIN_ANCHORS} are needed to tell an offset from another place"
        )
    offset, sigma, cost = _solved(rows, commissioning, reference_mm)
    limit = _limit(len(rows))
    if cost > limit:
        raise CalibrationError(_contradiction(rows, commissioning, reference_mm, cost, limit))
    sigma = math.hypot(sigma, DAY_TO_DAY_MM)
    if abs(offset) > MAX_OFFSET_MM:
        raise CalibrationError(
            f"the ranges are {offset:+.0f} mm longer than the commissioned tag's; no antenna delay is beyond "
            f"{MAX_OFFSET_MM} mm: is the drone where you say, and the height its antenna's? Else set its antenna delay"
        )
    if sigma > MAX_SIGMA_MM:
        raise CalibrationError(
            f"the offset is known to {sigma:.0f} mm only ({MAX_SIGMA_MM} are the most): put the drone between the "
            "anchors, or survey its place better"
        )
    return FoundOffset(
        offset_mm=offset,
        sigma_mm=sigma,
        rounds=rounds,
        by_anchor={
            commissioning.anchors[index].anchor_id: _mean([row for row in rows if row.anchor == index])
            for index in sorted(heard)
        },
        by_session={
            session.session_id: _mean([row for row in rows if row.session == number])
            for number, session in enumerate(sessions)
        },
        chi2=cost,
        limit=limit,
        loose_sigma_mm=_solved(rows, commissioning, LOOSE_MM)[1],
    )


def _rows(number: int, session: Ranged, commissioning: Commissioning) -> tuple[list[_Row], int]:
    names = [anchor.anchor_id for anchor in commissioning.anchors]
    rounds = usable(session.ranges, names, commissioning.max_range_mm)
    places = [session.place_at(t_ms) for t_ms in rounds.t_ms]
    rows = []
    for index, column in zip(rounds.anchor_indices, rounds.range_mm, strict=True):
        anchor = commissioning.anchors[index]
        at = np.array((anchor.east_mm, anchor.north_mm, anchor.up_mm), dtype=np.float64)
        pairs = [(value, place) for value, place in zip(column, places, strict=True) if value != NO_RANGE]
        if not pairs:
            continue
        values = np.array([value - bias_at(anchor, float(value))[0] for value, _ in pairs])
        arms = np.array([place for _, place in pairs]) - at
        away = np.linalg.norm(arms, axis=1)
        if float(away.min()) < 1.0:
            raise CalibrationError(f"the drone's antenna cannot be where anchor {anchor.anchor_id} is")
        residuals = values - away
        middle = float(np.median(residuals))
        sigma = float(commissioning.range_sigma_mm)
        scatter = _MAD * float(np.median(np.abs(residuals - middle)))
        if scatter > max(STEADY_SIGMAS * sigma, STEADY_FLOOR_MM):
            raise CalibrationError(
                f"the ranges of anchor {anchor.anchor_id} scatter by {scatter:.0f} mm in one session, where "
                f"{sigma:.0f} is usual: the drone moved, or something was in the way; let it stand still"
            )
        correlation = (commissioning.correlation_ppm or 0) / 1e6
        worth = (1.0 - correlation) / (1.0 + correlation)
        variance = MEDIAN_WORTH * sigma**2 / (len(values) * worth)
        rows.append(_Row(number, index, middle, variance, np.asarray(np.mean(arms / away[:, None], axis=0))))
    return rows, len(rounds.t_ms)


def _solved(rows: Sequence[_Row], commissioning: Commissioning, reference_mm: float) -> tuple[float, float, float]:
    """(offset, σ, χ²): offset, anchors' errors and places together, the last two drawn to what is known of them."""
    anchors = sorted({row.anchor for row in rows})
    sessions = sorted({row.session for row in rows})
    size = 1 + len(anchors) + 3 * len(sessions)
    matrix = np.zeros((len(rows) + size - 1, size))
    wanted = np.zeros(len(matrix))
    for line, row in enumerate(rows):
        weight = 1.0 / math.sqrt(row.variance)
        place = 1 + len(anchors) + 3 * sessions.index(row.session)
        matrix[line, 0] = matrix[line, 1 + anchors.index(row.anchor)] = weight
        matrix[line, place : place + 3] = weight * row.direction
        wanted[line] = weight * row.residual
    known = [1.0 / _own_sigma(commissioning.anchors[index]) for index in anchors]
    known += [1.0 / reference_mm] * (3 * len(sessions))
    matrix[len(rows) :, 1:] = np.diag(known)
    covariance = np.linalg.inv(matrix.T @ matrix)
    found = covariance @ (matrix.T @ wanted)
    left = wanted - matrix @ found
    return float(found[0]), float(np.sqrt(covariance[0, 0])), float(left @ left)


def _own_sigma(anchor: Anchor) -> float:
    """What the commissioning leaves of this anchor's error, where its table is known worst."""
    worst = max(point.sigma_mm for point in anchor.bias)
    return max(math.hypot(worst, anchor.survey_sigma_mm), 1.0)


def _contradiction(
    rows: Sequence[_Row], commissioning: Commissioning, reference_mm: float, cost: float, limit: float
) -> str:
    """What would explain ranges that no single offset does: one anchor, or another place."""
    said = f"no single offset explains these ranges (χ² {cost:.0f}, chance {limit:.0f})"
    anchors = {row.anchor for row in rows}
    if len(anchors) > MIN_ANCHORS:
        best = min(anchors, key=lambda index: _cost_without(rows, index, commissioning, reference_mm))
        left = [row for row in rows if row.anchor != best]
        if _cost_without(rows, best, commissioning, reference_mm) <= _limit(len(left)):
            name = commissioning.anchors[best].anchor_id
            return f"{said}; without anchor {name} they agree: is it where it was commissioned, and in sight?"
    if _solved(rows, commissioning, LOOSE_MM)[2] <= limit:
        return f"{said}; another place does: measure again where the drone's antenna stands, its height too"
    return f"{said}: is something in the way, or was the pad's survey changed? See wonderland pad status"


def _cost_without(rows: Sequence[_Row], index: int, commissioning: Commissioning, reference_mm: float) -> float:
    return _solved([row for row in rows if row.anchor != index], commissioning, reference_mm)[2]


def _limit(count: int) -> float:
    """χ² that one in a thousand honest calibrations exceeds: all that was measured, less the offset."""
    return float(chi2.isf(CHANCE, count - 1))


def _mean(rows: Sequence[_Row]) -> float:
    return float(np.mean([row.residual for row in rows]))
