"""Whether the truth of a run is where the ranges say: its delay, its height, its place, its lever arm.

A truth that is off looks like bias, and a table that was fitted to it like knowledge. But bias belongs to an anchor and
a distance, and an error of the truth to a direction, a height or a speed: four anchors that see it from different sides
tell them apart. All are estimated together, with what is known of the chip's bias; the uncertainty is the larger of the
fit's own and of what differs between parts of the run (jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wonderland_edge_agent.commissioning.curves import ALIKE_S, COMMON_M, OWN_M, chip_bias_m, hats
from wonderland_edge_agent.commissioning.errors import TruthError
from wonderland_edge_agent.commissioning.run import Floats, Run, distances

LARGEST_M: Final = 0.3
"""A truth that is further off than this is refused, where it is certain."""
SIGMAS: Final = 4.0
"""How certain: one of 30,000 good runs is refused."""
TELL_M: Final = 0.1
TELL_SIGMAS: Final = 2.5
SPACING_M: Final = 4.0
"""Of the common curve's knots."""
WANDER_M: Final = 0.02
"""By how much the common bias changes over a metre (and by the root of the distance over more)."""
PARTS: Final = 6
MOST_ROUNDS: Final = 1_500
SLOWEST_M_S: Final = 0.3
"""Below this a drone has no direction of travel."""
SMOOTHED_S: Final = 0.5
PRIOR_SIGMAS: Final = (0.5, 2.0, 2.0, 2.0, 0.5, 0.5)
"""Of each part of ``Truth``, before anything was seen (s, m)."""
_STEPS: Final = 8
_STEPS_PART: Final = 3
_FLOOR_M: Final = 0.01
_HUBER: Final = 1.5
_BURST: Final = 8.0


@dataclass(frozen=True)
class Offset:
    """One number and its standard deviation."""

    value: float
    sigma: float

    def beyond(self, limit: float, sigmas: float) -> bool:
        """Whether it is larger than a limit, and certainly so."""
        return abs(self.value) > limit and abs(self.value) > sigmas * self.sigma

    def text(self, positive: str, negative: str, unit: str = "m") -> str:
        """For people: so much to the one side, or to the other."""
        return f"{abs(self.value):.2f} ± {self.sigma:.2f} {unit} {positive if self.value >= 0 else negative}"


@dataclass(frozen=True)
class Truth:
    """By how much the tag was elsewhere than the truth says: metres, ``delay`` in s (positive: old)."""

    delay: Offset
    east: Offset
    north: Offset
    up: Offset
    forward: Offset
    """In the direction of travel: the lever arm from the reference to the tag, of a drone that flies ahead."""
    left: Offset

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {
            name: {"value": round(part.value, 3), "sigma": round(part.sigma, 3)}
            for name, part in (
                ("delay_s", self.delay),
                ("east_m", self.east),
                ("north_m", self.north),
                ("up_m", self.up),
                ("forward_m", self.forward),
                ("left_m", self.left),
            )
        }

    def sentence(self) -> str:
        """One line for the operator: where the ranges put the tag against the truth, and how late that is."""
        up, east, north, ahead, left = (part.text(*sides) for part, sides, _ in self._places())
        return (
            f"The ranges put the tag {up} than the truth, {east} and {north} of it, {ahead} and {left} on its way; the "
            f"truth is {self.delay.text('late', 'early', 's')}."
        )

    def notes(self) -> list[tuple[str, str]]:
        """(code, text) of what is not refused and worth knowing."""
        found = [part.text(*sides) for part, sides, _ in self._places() if part.beyond(TELL_M, TELL_SIGMAS)]
        if not found:
            return []
        return [
            ("truth_off", f"The ranges put the tag {', '.join(found)} of the truth; is the reference's mount known?")
        ]

    def check(self, name: str) -> None:
        """Refuse a truth that the ranges contradict. Raises TruthError, which names the part and what to do."""
        wrong = [
            f"{part.text(*sides)}: {cure}" for part, sides, cure in self._places() if part.beyond(LARGEST_M, SIGMAS)
        ]
        if wrong:
            raise TruthError(
                f"{name}: the ranges of all anchors contradict the truth. They put the tag {'; '.join(wrong)}"
            )

    def _places(self) -> tuple[tuple[Offset, tuple[str, str], str], ...]:
        """Each offset, the words for its two sides, and what to do about it."""
        origin = "is the reference in the survey's frame (origin, axes, antenna's place)?"
        height = (
            "measure the height between the reference's antenna and the tag, and give a --truth-raise that is "
            f"{abs(self.up.value):.2f} {'higher' if self.up.value > 0 else 'lower'}"
        )
        lever = "correct the reference by the lever arm from its antenna to the tag"
        return (
            (self.up, ("higher", "lower"), height),
            (self.east, ("east", "west"), origin),
            (self.north, ("north", "south"), origin),
            (self.forward, ("ahead", "behind"), lever),
            (self.left, ("to the left", "to the right"), lever),
        )


def find_truth(runs: Sequence[Run]) -> Truth:
    """From the run with most movement."""
    run = _thinned(max(runs, key=lambda item: float(np.ptp(item.truth_m, axis=0).max())))
    ways = _ways(run)
    everything = np.ones(len(run.t_s), dtype=bool)
    found, sigma = _estimate(run, ways, everything, np.zeros(len(ways)), _STEPS)
    part = np.minimum((run.t_s - run.t_s[0]) / max(float(np.ptp(run.t_s)), 1e-9) * PARTS, PARTS - 1).astype(int)
    parts = np.array([_estimate(run, ways, part != index, found, _STEPS_PART)[0] for index in np.unique(part)])
    between = np.sqrt((len(parts) - 1) / len(parts) * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))
    sigma = np.maximum(sigma, between)
    return Truth(*(Offset(float(value), float(one)) for value, one in zip(found, sigma, strict=True)))


def _thinned(run: Run) -> Run:
    step = -(-len(run.t_s) // MOST_ROUNDS)
    rows = np.zeros(len(run.t_s), dtype=bool)
    rows[::step] = True
    return run.only(rows)


def _ways(run: Run) -> Floats:
    """(p, n, 3): how each part of ``Truth`` moves the tag."""
    velocity = np.gradient(run.truth_m, np.maximum.accumulate(run.t_s + 1e-9 * np.arange(len(run.t_s))), axis=0)
    width = 2 * max(1, round(SMOOTHED_S / max(run.interval_s, 1e-3))) + 1
    if width < len(run.t_s):
        velocity = np.stack([np.convolve(axis, np.ones(width) / width, "same") for axis in velocity.T], axis=1)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    ahead = np.where(speed > SLOWEST_M_S, 1.0 / np.maximum(speed, SLOWEST_M_S), 0.0)[:, None] * velocity[:, :2]
    still = np.zeros(len(speed))
    axes = [np.tile(axis, (len(speed), 1)) for axis in np.eye(3)]
    forward = np.stack([ahead[:, 0], ahead[:, 1], still], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0], still], axis=1)
    return np.stack([velocity, *axes, forward, left])


def _estimate(run: Run, ways: Floats, chosen: Floats, start: Floats, steps: int) -> tuple[Floats, Floats]:
    """(parts, their σ) by Gauss-Newton with Huber's weights; every anchor's level and a common curve besides."""
    anchors = len(run.anchor_ids)
    knots = np.arange(0.0, float(np.max(run.distance_m)) + 2 * SPACING_M, SPACING_M)
    alike = max(ALIKE_S / max(run.interval_s, 1e-3), 1.0)
    known = _known(len(ways), anchors, knots)
    found, scale = start, OWN_M
    rest: Floats | None = None
    normal = known
    for _ in range(steps):
        moved = run.truth_m + np.tensordot(found, ways, axes=1)
        away = distances(moved, run.anchors_m)
        error = run.range_m - away - chip_bias_m(away)
        rows, values = [], []
        for index in range(anchors):
            good = chosen & np.isfinite(error[:, index])
            unit = (moved[good] - run.anchors_m[index]) / np.maximum(away[good, index], 1e-6)[:, None]
            slopes = np.einsum("pnx,nx->np", ways[:, good], unit)
            own = np.zeros((int(good.sum()), anchors))
            own[:, index] = 1.0
            rows.append(np.hstack([slopes, own, hats(away[good, index], knots)]))
            values.append(error[good, index] + slopes @ found)
        design, right = np.vstack(rows), np.concatenate(values)
        weight = np.ones(len(right))
        if rest is not None and len(rest) == len(right):
            weight = np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(rest), 1e-9)) * (np.abs(rest) < _BURST * scale)
        normal = (design * weight[:, None]).T @ design + known * scale**2 * alike
        solved = np.linalg.solve(normal, design.T @ (weight * right))
        rest = right - design @ solved
        scale = max(1.4826 * float(np.median(np.abs(rest))), _FLOOR_M)
        found = solved[: len(ways)]
    covariance = np.linalg.inv(normal) * scale**2 * alike
    return found, np.sqrt(np.diag(covariance)[: len(ways)])


def _known(parts: int, anchors: int, knots_m: Floats) -> Floats:
    """Precision of everything before the run: the truth's parts, anchors' levels, the common curve."""
    count = len(knots_m)
    steps = np.diff(np.eye(count), axis=0) / (WANDER_M * np.sqrt(np.diff(knots_m))[:, None])
    out = np.zeros((parts + anchors + count,) * 2)
    out[:parts, :parts] = np.diag(1.0 / np.array(PRIOR_SIGMAS[:parts]) ** 2)
    out[parts : parts + anchors, parts : parts + anchors] = np.eye(anchors) / OWN_M**2
    out[parts + anchors :, parts + anchors :] = np.eye(count) / COMMON_M**2 / count + steps.T @ steps
    return out
