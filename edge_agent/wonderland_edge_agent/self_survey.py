"""Do the anchors stand where the survey says? Asked of the ranges that they measure to each other.

Model of a range between anchors i and j: their distance, plus a bias common to all (c), plus each unit's own (a_i and
a_j), plus noise; each anchor may stand a little beside its surveyed place (d_i). All of these have prior standard
deviations, and the most probable values are found by Gauss–Newton. "Anchor i is off" is then the hypothesis that its
d_i is not bound by the survey at all; how much better it explains the ranges (χ²) says whether to believe it. Ranges
from a commissioning may stand in for the survey's distances: then units' biases cancel, and a centimetre shows.

Plain Python: a running pad asks, too. With 16 anchors it takes some tens of milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

OFF_CHI2: Final = 20.0
"""Three free coordinates gain this by chance once in 6,000; asked for each anchor."""
EXCHANGED_CHI2: Final = 30.0
LOOSE_M: Final = 3.0
"""How far an anchor may be off and still be found so; what is wrong by more is another survey."""
_ITERATIONS: Final = 12
_CONVERGED_M: Final = 1e-5
_RIDGE: Final = 1e-12
_LEAST_M: Final = 1e-3

Point = Sequence[float]
Pair = tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Priors:
    """What may be off, in metres (1σ)."""

    common_m: float = 0.15
    """Bias of all ranges: uncalibrated units near each other."""
    unit_m: float = 0.03
    place_m: Mapping[str, float] = field(default_factory=dict)
    """Survey of each anchor's coordinates; 10 mm where it is not given."""


@dataclass(frozen=True, slots=True)
class Displaced:
    """One anchor, freed from its survey."""

    anchor_id: str
    off_m: float
    """How far beside its place the ranges have it."""
    sigma_m: float
    """Standard deviation of that, in its direction."""
    vector_m: tuple[float, float, float]
    gain: float
    """χ² that freeing this anchor gains."""

    @property
    def significant(self) -> bool:
        """Whether chance does not explain it."""
        return self.gain >= OFF_CHI2


@dataclass(frozen=True, slots=True)
class SelfSurvey:
    """What the ranges between anchors say. ``suspect`` is the anchor that is off, if one is."""

    anchors: tuple[Displaced, ...]
    chi2: float
    freedom: int
    common_m: float
    """Bias that all ranges between anchors share."""
    suspect: Displaced | None
    exchanged: Pair | None
    """Two anchors whose places seem to be exchanged in the survey."""

    @property
    def agrees(self) -> bool:
        """Whether survey and ranges fit together."""
        return self.suspect is None and self.exchanged is None


def self_survey(
    places_m: Mapping[str, Point],
    ranges_m: Mapping[Pair, float],
    *,
    sigma_m: float | Mapping[Pair, float] = 0.01,
    priors: Priors | None = None,
    expected_m: Mapping[Pair, float] | None = None,
) -> SelfSurvey:
    """Compare ranges between anchors (one for each pair) with where they should be.

    ``expected_m``: what each pair measured when the anchors stood where ``places_m`` says; else the distances.
    ``sigma_m``: of each range, as it enters. Pairs of unknown anchors are left out.
    """
    priors = priors or Priors()
    pairs = [pair for pair in ranges_m if pair[0] in places_m and pair[1] in places_m]
    if expected_m is not None:
        pairs = [pair for pair in pairs if pair in expected_m]
    sigmas = [sigma_m if isinstance(sigma_m, float) else sigma_m[pair] for pair in pairs]
    model = _Model(dict(places_m), pairs, [ranges_m[pair] for pair in pairs], sigmas, priors, expected_m)
    rest = model.solve(None)
    displaced = []
    for name in places_m:
        freed = model.solve(name)
        vector = freed.moves[name]
        off = math.sqrt(sum(value * value for value in vector))
        displaced.append(Displaced(name, off, freed.sigma_m, vector, max(rest.chi2 - freed.chi2, 0.0)))
    suspect = max(displaced, key=lambda item: item.gain, default=None)
    if suspect is not None and not suspect.significant:
        suspect = None
    exchanged = None
    if suspect is not None:
        exchanged = _exchanged(model, rest.chi2, rest.chi2 - suspect.gain)
    return SelfSurvey(
        tuple(displaced), rest.chi2, max(len(pairs) - 1, 0), rest.common_m, None if exchanged else suspect, exchanged
    )


@dataclass(frozen=True, slots=True)
class _Solution:
    chi2: float
    common_m: float
    moves: dict[str, tuple[float, float, float]]
    sigma_m: float
    """Of the freed anchor's move, in its direction."""


@dataclass(slots=True)
class _Model:
    places: dict[str, Point]
    pairs: list[Pair]
    ranges: list[float]
    sigmas: list[float]
    priors: Priors
    expected: Mapping[Pair, float] | None

    def solve(self, freed: str | None) -> _Solution:
        names = list(self.places)
        count = len(names)
        size = 1 + 4 * count
        index = {name: position for position, name in enumerate(names)}
        deviations = [self.priors.common_m] + [self.priors.unit_m] * count
        for name in names:
            deviations += [LOOSE_M if name == freed else self.priors.place_m.get(name, 0.01)] * 3
        weights = [1.0 / (max(value, 1e-6) ** 2) for value in deviations]
        x = [0.0] * size
        normal: list[list[float]] = []
        for _ in range(_ITERATIONS):
            normal = [[0.0] * size for _ in range(size)]
            right = [-weight * value for weight, value in zip(weights, x, strict=True)]
            for position, weight in enumerate(weights):
                normal[position][position] = weight
            for number, (pair, sigma) in enumerate(zip(self.pairs, self.sigmas, strict=True)):
                i, j = index[pair[0]], index[pair[1]]
                residual, unit = self._residual(number, x, i, j, count)
                columns = [(0, 1.0), (1 + i, 1.0), (1 + j, 1.0)]
                columns += [(1 + count + 3 * i + axis, unit[axis]) for axis in range(3)]
                columns += [(1 + count + 3 * j + axis, -unit[axis]) for axis in range(3)]
                scale = 1.0 / (sigma * sigma)
                for row, left in columns:
                    right[row] += scale * left * residual
                    for column, other in columns:
                        normal[row][column] += scale * left * other
            step = _solved(normal, right)
            x = [value + change for value, change in zip(x, step, strict=True)]
            if max(abs(change) for change in step) < _CONVERGED_M:
                break
        chi2 = sum(weight * value * value for weight, value in zip(weights, x, strict=True))
        for number, (pair, sigma) in enumerate(zip(self.pairs, self.sigmas, strict=True)):
            residual, _ = self._residual(number, x, index[pair[0]], index[pair[1]], count)
            chi2 += (residual / sigma) ** 2
        moves = {
            name: (
                x[1 + count + 3 * position],
                x[1 + count + 3 * position + 1],
                x[1 + count + 3 * position + 2],
            )
            for name, position in index.items()
        }
        spread = 0.0
        if freed is not None:
            start = 1 + count + 3 * index[freed]
            length = math.sqrt(sum(value * value for value in moves[freed])) or 1.0
            direction = [0.0] * size
            for axis in range(3):
                direction[start + axis] = moves[freed][axis] / length if length else 0.0
            if not any(direction):
                direction[start] = 1.0
            spread = math.sqrt(max(sum(a * b for a, b in zip(direction, _solved(normal, direction), strict=True)), 0.0))
        return _Solution(chi2, x[0], moves, spread)

    def _residual(
        self, number: int, x: Sequence[float], i: int, j: int, count: int
    ) -> tuple[float, tuple[float, float, float]]:
        """Measured minus modelled, and the direction from j to i."""
        pair = self.pairs[number]
        a, b = self.places[pair[0]], self.places[pair[1]]
        di, dj = 1 + count + 3 * i, 1 + count + 3 * j
        gap = [a[axis] + x[di + axis] - b[axis] - x[dj + axis] for axis in range(3)]
        away = max(math.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2), _LEAST_M)
        modelled = away + x[0] + x[1 + i] + x[1 + j]
        if self.expected is not None:
            modelled += self.expected[pair] - math.dist(a, b)
        return self.ranges[number] - modelled, (gap[0] / away, gap[1] / away, gap[2] / away)


def _exchanged(model: _Model, chi2: float, best_single: float) -> Pair | None:
    """Two anchors whose exchange explains the ranges far better than moving one of them."""
    names = list(model.places)
    best: tuple[float, Pair] | None = None
    for index, one in enumerate(names):
        for other in names[:index]:
            places = dict(model.places)
            places[one], places[other] = places[other], places[one]
            expected = _renamed(model.expected, {one: other, other: one})
            if expected is not None and not all(pair in expected for pair in model.pairs):
                continue
            found = _Model(places, model.pairs, model.ranges, model.sigmas, model.priors, expected).solve(None)
            if best is None or found.chi2 < best[0]:
                best = (found.chi2, (other, one))
    if best is None or chi2 - best[0] < EXCHANGED_CHI2 or best[0] > best_single:
        return None
    return best[1]


def _renamed(expected: Mapping[Pair, float] | None, names: Mapping[str, str]) -> dict[Pair, float] | None:
    """What pairs would measure if these anchors had each other's names; pairs in either order."""
    if expected is None:
        return None
    out: dict[Pair, float] = {}
    for (one, other), range_m in expected.items():
        pair = names.get(one, one), names.get(other, other)
        out[pair] = out[pair[1], pair[0]] = range_m
    return out


def _solved(matrix: Sequence[Sequence[float]], right: Sequence[float]) -> list[float]:
    """Cholesky; the priors make the matrix positive definite."""
    size = len(right)
    lower = [[0.0] * size for _ in range(size)]
    for i in range(size):
        row = lower[i]
        for j in range(i + 1):
            other = lower[j]
            total = matrix[i][j]
            for k in range(j):
                total -= row[k] * other[k]
            row[j] = math.sqrt(max(total, _RIDGE)) if i == j else total / other[j]
    y = [0.0] * size
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= lower[i][k] * y[k]
        y[i] = total / lower[i][i]
    x = [0.0] * size
    for i in reversed(range(size)):
        total = y[i]
        for k in range(i + 1, size):
            total -= lower[k][i] * x[k]
        x[i] = total / lower[i][i]
    return x
