"""From calibration runs to a Commissioning record: the one entry for command, live calibration and studies.

run = Run.of(Recording.load(ranges, anchors, truth_shift_s=-0.175))
fit = fit_runs([run])
record = fit.commissioning(frame, valid_from_ms=…, valid_until_ms=…)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from edge_agent.commissioning.curves import Curves, fit_curves
from edge_agent.commissioning.errors import CalibrationError
from edge_agent.commissioning.places import Places, find_places
from edge_agent.commissioning.plausibility import check_plausible, standing_out
from edge_agent.commissioning.run import Floats, Run, Windows, distances, windows
from edge_agent.commissioning.spread import SLOPE_M_PER_M, Spread, find_spread
from edge_agent.commissioning.survey import check_anchors
from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame

MIN_SECONDS: Final = 20
"""Of ranges with truth: less holds nothing out and teaches nothing."""
MIN_ROUNDS_WITH_THREE: Final = 0.2
GAP_M: Final = 2.0
"""A stretch of distances without data that is longer than this is told, and widened in the table."""
EDGE_M: Final = 0.5
"""Beyond the furthest distance that was driven, the table still holds for this much."""
MAX_SHIFT_S: Final = 10.0
"""Clocks that are further apart have to be brought together first."""
NEAR_SHIFT_S: Final = 0.5
"""What filters and networks delay a truth by; more is another clock."""
MIN_SHIFT_S: Final = 0.02
SHIFT_GAIN: Final = 0.10
"""A delay of the truth that makes the errors' spread this much smaller is worth telling."""
CLOCK_GAIN: Final = 0.5
"""A delay beyond ``NEAR_SHIFT_S`` has to explain this much of the spread: some paths nearly repeat themselves."""
SECTORS: Final = 12
DEFAULT_SURVEY_SIGMA_M: Final = 0.010
MAC_BASE: Final = 0xA000


@dataclass(frozen=True)
class FitSettings:
    """What is known besides the run.

    ``reference_sigma_m``: how well the truth is known. ``installation_floor_m``: bias common to all anchors that this
    run cannot show (0.06 for anchors that are mounted anew between calibration and use).
    """

    reference_sigma_m: float = 0.01
    installation_floor_m: float = 0.0


@dataclass(frozen=True)
class Note:
    """Something that the operator should know: ``code`` for machines, ``text`` for people."""

    code: str
    text: str


@dataclass(frozen=True)
class Coverage:
    """Where the run was."""

    nearest_m: float
    furthest_m: float
    gaps_m: tuple[tuple[float, float], ...]
    """Distances without data, inside."""
    sectors: tuple[int, ...]
    """Seconds in each sector about the anchors' middle, from east counter-clockwise."""
    seconds: int


@dataclass(frozen=True)
class Fit:
    """What calibration runs taught."""

    anchor_ids: tuple[str, ...]
    anchors_m: Floats
    curves: Curves
    spread: Spread
    windows: Windows
    held_m: Floats
    """(w, a) errors of windows with curves that did not see them."""
    coverage: Coverage
    outliers: Mapping[str, float]
    """Share of each anchor's ranges that were bursts."""
    warnings: tuple[Note, ...]
    interval_s: float
    shift_s: float
    """By how much more the truth should be shifted (``--truth-shift``); positive where it is old."""
    settings: FitSettings = field(default_factory=FitSettings)
    places: Places | None = None
    """How biases change over place, where the runs went far enough to tell."""

    @property
    def installation_m(self) -> float:
        """Standard deviation of the bias that all anchors share."""
        return max(self.spread.installation_m, self.settings.installation_floor_m)

    @property
    def max_range_m(self) -> float:
        """Beyond this distance nothing was learnt."""
        return self.coverage.furthest_m + EDGE_M

    def table(self, anchor: int) -> tuple[BiasPoint, ...]:
        """The bias table of an anchor, by its position in ``anchor_ids``."""
        name = self.anchor_ids[anchor]
        rows: dict[int, tuple[float, float]] = {}
        knots, bias, sigma = self.curves.knots_m, self.curves.bias_m[anchor], self.spread.bias_sigma_m[anchor]
        for knot, value, deviation in zip(knots, bias, sigma, strict=True):
            rows[round(knot * 1000)] = (float(value), float(deviation))
        for low, high in self.coverage.gaps_m:  # as wide in the middle as the bias may wander from both ends
            middle = (low + high) / 2
            known = float(np.interp(middle, knots, sigma))
            wandered = SLOPE_M_PER_M * (high - low) / 2
            rows[round(middle * 1000)] = (float(np.interp(middle, knots, bias)), float(np.hypot(known, wandered)))
        nearest = float(knots[0])
        if nearest > EDGE_M:
            rows[0] = (float(bias[0]), float(np.hypot(sigma[0], SLOPE_M_PER_M * nearest)))
        return tuple(
            BiasPoint(
                range_mm=range_mm,
                bias_mm=_mm(value, 5_000, f"a bias of anchor {name}"),
                sigma_mm=max(1, _mm(deviation, 5_000, f"an uncertain bias of anchor {name}")),
            )
            for range_mm, (value, deviation) in sorted(rows.items())
        )

    def commissioning(
        self,
        frame: Frame,
        *,
        valid_from_ms: int,
        valid_until_ms: int,
        macs: Mapping[str, int] | None = None,
        survey_sigma_m: Mapping[str, float] | None = None,
        method: str = "",
    ) -> Commissioning:
        """The record for CommissionPad. Raises CalibrationError where the ledger's records cannot hold it."""
        macs = macs or {}
        sigmas = survey_sigma_m or {}
        try:
            return Commissioning(
                frame=frame,
                anchors=tuple(
                    Anchor(
                        anchor_id=name,
                        mac=macs.get(name, MAC_BASE + index),
                        east_mm=round(place[0] * 1000),
                        north_mm=round(place[1] * 1000),
                        up_mm=round(place[2] * 1000),
                        survey_sigma_mm=round(sigmas.get(name, DEFAULT_SURVEY_SIGMA_M) * 1000),
                        bias=self.table(index),
                    )
                    for index, (name, place) in enumerate(zip(self.anchor_ids, self.anchors_m.tolist(), strict=True))
                ),
                range_sigma_mm=max(1, _mm(self.spread.range_sigma_m, 10_000, "noise")),
                installation_sigma_mm=_mm(self.installation_m, 5_000, "a common bias"),
                max_range_mm=min(max(round(self.max_range_m * 1000), 1_000), 1_000_000),
                valid_from_ms=valid_from_ms,
                valid_until_ms=valid_until_ms,
                method=(method or self.method())[:500],
                correlation_ppm=round(self.spread.correlation * 1_000_000),
                bias_length_mm=None if self.places is None else round(self.places.length_m * 1000),
                bias_fixed_ppm=None if self.places is None else round(self.places.fixed * 1_000_000),
            )
        except RecordError as error:
            raise CalibrationError(f"what was fitted is no commissioning: {error}") from error

    def method(self) -> str:
        """How it was found, for the record."""
        return (
            f"Fitted to {self.coverage.seconds} s of ranges with truth, {self.coverage.nearest_m:.1f} to "
            f"{self.coverage.furthest_m:.1f} m, a round every {self.interval_s * 1000:.0f} ms; uncertainty from "
            "held-out parts"
        )

    def document(self) -> dict[str, Any]:
        """Everything for machines, in metres and seconds."""
        return {
            "seconds": self.coverage.seconds,
            "nearest_m": round(self.coverage.nearest_m, 3),
            "furthest_m": round(self.coverage.furthest_m, 3),
            "max_range_m": round(self.max_range_m, 3),
            "gaps_m": [[round(low, 2), round(high, 2)] for low, high in self.coverage.gaps_m],
            "sectors_s": list(self.coverage.sectors),
            "interval_s": round(self.interval_s, 4),
            "range_sigma_m": round(self.spread.range_sigma_m, 4),
            "correlation": round(self.spread.correlation, 3),
            "installation_sigma_m": round(self.installation_m, 4),
            "bias_length_m": None if self.places is None else round(self.places.length_m, 1),
            "bias_fixed": None if self.places is None else round(self.places.fixed, 3),
            "held_out_error_m": round(float(np.nanmedian(np.abs(self.held_m))), 4),
            "uncalibrated_error_m": round(float(np.nanmedian(np.abs(self.windows.error_m))), 4),
            "truth_shift_left_s": round(self.shift_s, 3),
            "smoothness": self.curves.smoothness,
            "sharing": self.curves.sharing,
            "anchors": {
                name: {
                    "outliers": round(self.outliers[name], 4),
                    "bias": [point.to_json() for point in self.table(index)],
                }
                for index, name in enumerate(self.anchor_ids)
            },
            "warnings": [{"code": warning.code, "text": warning.text} for warning in self.warnings],
        }


def fit_runs(runs: Sequence[Run], settings: FitSettings | None = None) -> Fit:
    """Fit one or more runs of the same anchors. With several, what differs between them counts as uncertainty.

    Raises SurveyError (anchors) and CalibrationError (runs).
    """
    settings = settings or FitSettings()
    runs = tuple(runs)
    if not runs:
        raise CalibrationError("no calibration run was given")
    first = runs[0]
    for other in runs[1:]:
        if other.anchor_ids != first.anchor_ids:
            raise CalibrationError(
                f"{other.name}: has anchors {', '.join(other.anchor_ids)}, {first.name} has "
                f"{', '.join(first.anchor_ids)}; runs of one commissioning are of the same anchors"
            )
    notes = [
        Note(code, text)
        for code, text in check_anchors(dict(zip(first.anchor_ids, first.anchors_m.tolist(), strict=True)))
    ]
    data = windows(runs)
    _check_amount(data, first)
    shift, gain = find_shift(runs)
    if abs(shift) > NEAR_SHIFT_S:
        raise CalibrationError(
            f"the truth is {abs(shift):.2f} s {'late' if shift > 0 else 'early'}: errors would spread {gain:.0%} less "
            f"with a --truth-shift {'higher' if shift > 0 else 'lower'} by that (auto finds it); bring the clocks of "
            "reference and ranges together"
        )
    check_plausible(runs, data)
    curves, held = fit_curves(data)
    interval = float(np.median([run.interval_s for run in runs]))
    spread = find_spread(data, curves, held, reference_sigma_m=settings.reference_sigma_m)
    coverage = _coverage(data, first.anchors_m)
    outliers = {
        name: float(data.bursts[index] / max(int(data.ranges[index]), 1)) for index, name in enumerate(first.anchor_ids)
    }
    notes += _notes(runs, data, coverage, outliers, shift, gain)
    return Fit(
        anchor_ids=first.anchor_ids,
        anchors_m=first.anchors_m,
        curves=curves,
        spread=spread,
        windows=data,
        held_m=held,
        coverage=coverage,
        outliers=outliers,
        warnings=tuple(notes),
        interval_s=interval,
        shift_s=shift,
        settings=settings,
        places=find_places(
            data,
            spread,
            reference_sigma_m=settings.reference_sigma_m,
            remounted=settings.installation_floor_m > 0.0,
        ),
    )


def _check_amount(data: Windows, run: Run) -> None:
    seconds = len(data.t_s)
    if seconds < MIN_SECONDS:
        raise CalibrationError(f"{seconds} s of ranges with truth; {MIN_SECONDS} are the least, some minutes are usual")
    present = np.isfinite(data.error_m)
    for index, name in enumerate(run.anchor_ids):
        if present[:, index].sum() < MIN_SECONDS / 2:
            raise CalibrationError(
                f"anchor {name}: ranges in {int(present[:, index].sum())} of {seconds} s; is its node powered, and is "
                "its address the one in the list of anchors?"
            )
    if (present.sum(axis=1) >= 3).mean() < MIN_ROUNDS_WITH_THREE:
        raise CalibrationError("hardly ever did three anchors range at the same time; check the nodes")


def _coverage(data: Windows, anchors_m: Floats) -> Coverage:
    present = np.sort(data.distance_m[np.isfinite(data.distance_m)])
    jumps = np.flatnonzero(np.diff(present) > GAP_M)
    middle = anchors_m.mean(axis=0)
    offset = data.truth_m - middle
    angles = np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi)
    sectors = np.bincount((angles / (2 * np.pi) * SECTORS).astype(int) % SECTORS, minlength=SECTORS)
    return Coverage(
        float(present[0]),
        float(present[-1]),
        tuple((float(present[i]), float(present[i + 1])) for i in jumps[:6]),
        tuple(int(value) for value in sectors),
        len(data.t_s),
    )


def find_shift(runs: Sequence[Run]) -> tuple[float, float]:
    """(best shift of the truth in s, by what share it shrinks the spread), from the run with most movement."""
    run = max(runs, key=lambda item: float(np.ptp(item.truth_m, axis=0).max()))
    now = _roughness(run, 0.0)
    if now <= 0:
        return 0.0, 0.0
    near = _best_shift(run, 0.0)
    coarse = np.arange(-MAX_SHIFT_S, MAX_SHIFT_S + 0.1, 0.2)
    far = float(min(coarse, key=lambda shift: _roughness(run, float(shift))))
    if abs(far) > NEAR_SHIFT_S:
        shift, roughness = _best_shift(run, far)
        if roughness < (1.0 - CLOCK_GAIN) * near[1]:
            near = (shift, roughness)
    return near[0], 1.0 - near[1] / now


def _best_shift(run: Run, about_s: float) -> tuple[float, float]:
    """(shift in s near another, spread with it); no shift where the best is at the edge of what was tried."""
    shifts = about_s + np.linspace(-NEAR_SHIFT_S, NEAR_SHIFT_S, 41)
    scores = [_roughness(run, float(shift)) for shift in shifts]
    best = int(np.argmin(scores))
    if not 0 < best < len(shifts) - 1:
        return 0.0, _roughness(run, 0.0)
    before, here, after = scores[best - 1 : best + 2]
    bend = before - 2 * here + after
    peak = shifts[best] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * (shifts[1] - shifts[0])
    return float(peak), here


def _roughness(run: Run, shift_s: float) -> float:
    """Spread of the errors about their median by distance, were the truth taken ``shift_s`` later."""
    moved = np.stack([np.interp(run.t_s + shift_s, run.t_s, run.truth_m[:, axis]) for axis in range(3)], axis=1)
    distance = distances(moved, run.anchors_m)
    error = run.range_m - distance
    spreads = []
    for column in range(error.shape[1]):
        good = np.isfinite(error[:, column])
        bins = np.floor(distance[good, column] / 2.0).astype(int)
        values = error[good, column]
        centres = {number: float(np.median(values[bins == number])) for number in np.unique(bins)}
        spreads.append(float(np.median(np.abs(values - np.array([centres[number] for number in bins])))))
    return float(np.mean(spreads))


def _notes(
    runs: tuple[Run, ...], data: Windows, coverage: Coverage, outliers: Mapping[str, float], shift: float, gain: float
) -> list[Note]:
    notes: list[Note] = []

    def note(code: str, text: str) -> None:
        notes.append(Note(code, text))

    if abs(shift) >= MIN_SHIFT_S and gain > SHIFT_GAIN:
        older, way = ("late", "higher") if shift > 0 else ("early", "lower")
        note(
            "truth_delayed",
            f"The truth seems {abs(shift):.2f} s {older}: errors would spread {gain:.0%} less with a --truth-shift "
            f"{way} by that (auto finds it).",
        )
    for low, high in coverage.gaps_m:
        note("gap", f"No data between {low:.1f} and {high:.1f} m; there the table is interpolated and vaguer.")
    if coverage.furthest_m - coverage.nearest_m < 3.0:
        note(
            "short_span",
            f"Distances of {coverage.nearest_m:.1f} to {coverage.furthest_m:.1f} m only; elsewhere the pad verifies "
            "little.",
        )
    seen = sum(seconds > 0 for seconds in coverage.sectors)
    if seen < SECTORS / 2:
        note(
            "bearings",
            f"The run saw {seen} of {SECTORS} directions; how an antenna's bias changes with the rest is not known.",
        )
    for name, away in standing_out(runs, data):
        note(
            "stands_out",
            f"Anchor {name} is off by {away:+.2f} m against the others; is its survey exact, its antenna delay set?",
        )
    for name, share in outliers.items():
        if share > 0.05:
            note("outliers", f"Anchor {name}: {share:.0%} of its ranges are bursts; what obstructs or disturbs it?")
    implausible, truthless = sum(run.implausible for run in runs), sum(run.truthless for run in runs)
    if implausible:
        note("implausible", f"{implausible} ranges were zero, negative or beyond a kilometre and were left out.")
    if truthless:
        note("truth_gaps", f"{truthless} rounds were left out: the truth has gaps there.")
    if data.run.max() == 0:
        note("one_run", "One run cannot show what another day changes; 15 mm are allowed for it. Add a second run.")
    return notes


def _mm(metres: float, most_mm: int, what: str) -> int:
    """For the record. Raises CalibrationError for what it cannot hold: cut off, it would be another pad's."""
    value = round(float(metres) * 1000)
    if abs(value) > most_mm:
        raise CalibrationError(
            f"{what} of {metres:.2f} m was fitted, and a record holds {most_mm / 1000:g} m at most; are ranges, survey "
            "and reference of the same pad, in metres?"
        )
    return value
