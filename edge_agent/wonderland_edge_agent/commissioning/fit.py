"""From calibration runs to a Commissioning record: the one entry for command, live calibration and studies.

run = Run.of(Recording.load(ranges, anchors, truth_shift_s=-0.175))
fit = fit_runs([run])
record = fit.commissioning(frame, valid_from_ms=…, valid_until_ms=…)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame
from wonderland_edge_agent.commissioning import prior
from wonderland_edge_agent.commissioning.coverage import (
    OFTEN_OBSTRUCTED,
    Coverage,
    Note,
    coverage_of,
    notes_of,
    notes_of_shift,
)
from wonderland_edge_agent.commissioning.curves import Curves, chip_bias_m, fit_curves
from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.places import Places, find_places
from wonderland_edge_agent.commissioning.plausibility import check_plausible
from wonderland_edge_agent.commissioning.run import Floats, Run, Windows, windows
from wonderland_edge_agent.commissioning.shift import NEAR_SHIFT_S, find_shift
from wonderland_edge_agent.commissioning.spread import (
    PRIOR_COMMON_M,
    PRIOR_OWN_M,
    SLOPE_M_PER_M,
    Spread,
    find_spread,
    wandered,
)
from wonderland_edge_agent.commissioning.survey import check_anchors
from wonderland_edge_agent.commissioning.truth import Truth, find_truth

MIN_SECONDS: Final = 20
"""Of ranges with truth: less holds nothing out and teaches nothing."""
MIN_ROUNDS_WITH_THREE: Final = 0.2
EDGE_M: Final = 0.5
"""Beyond the furthest distance that was driven, the table still holds for this much."""
DEFAULT_SURVEY_SIGMA_M: Final = 0.010
MAC_BASE: Final = 0xA000
BASES: Final = ("fitted", "halfway", "prior")


@dataclass(frozen=True)
class FitSettings:
    """What is known besides the run.

    ``reference_sigma_m``: how well the truth is known. ``installation_floor_m``: bias common to all anchors that this
    run cannot show (0.06 for anchors that are mounted anew between calibration and use).
    """

    reference_sigma_m: float = 0.01
    installation_floor_m: float = 0.0


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
    truth: Truth
    settings: FitSettings = field(default_factory=FitSettings)
    basis: str = "fitted"
    """``fitted``; ``prior`` where the chip's serves better (``choice``); ``halfway`` between both."""
    places: Places | None = None
    """How biases change over place, where the runs went far enough to tell."""

    @property
    def _places(self) -> Places | None:
        """What was learnt of biases over place, where the record is what was fitted."""
        return self.places if self.basis == "fitted" else None

    @property
    def installation_m(self) -> float:
        """Standard deviation of the bias that all anchors share."""
        if self.basis == "prior":
            return max(PRIOR_COMMON_M, self.settings.installation_floor_m)
        return max(self.spread.installation_m, self.settings.installation_floor_m)

    @property
    def max_range_m(self) -> float:
        """Beyond this distance nothing was learnt."""
        return self.coverage.furthest_m + EDGE_M

    def on_basis(self, basis: str) -> Fit:
        """The same with the chip's prior instead of what was fitted, or with what lies halfway between."""
        if basis == self.basis:
            return self
        weight = {"halfway": 0.5, "prior": 1.0}[basis]
        chip = chip_bias_m(self.curves.knots_m)
        bias = (1.0 - weight) * self.curves.bias_m + weight * chip
        sigma = self.spread.bias_sigma_m ** (1.0 - weight) * PRIOR_OWN_M**weight
        installation = self.spread.installation_m ** (1.0 - weight) * PRIOR_COMMON_M**weight
        noise = self.spread.range_sigma_m ** (1.0 - weight) * (prior.SIGMA_MM / 1000) ** weight
        return replace(
            self,
            basis=basis,
            curves=replace(self.curves, bias_m=bias),
            spread=replace(self.spread, bias_sigma_m=sigma, installation_m=installation, range_sigma_m=noise),
        )

    def table(self, anchor: int) -> tuple[BiasPoint, ...]:
        """The bias table of an anchor, by its position in ``anchor_ids``."""
        name = self.anchor_ids[anchor]
        rows: dict[int, tuple[float, float]] = {}
        knots, bias, sigma = self.curves.knots_m, self.curves.bias_m[anchor], self.spread.bias_sigma_m[anchor]
        for knot, value, deviation in zip(knots, bias, sigma, strict=True):
            rows[round(knot * 1000)] = (float(value), float(deviation))
        for low, high in self.coverage.gaps_m:  # as wide in the middle as the bias may wander from both ends
            middle = (low + high) / 2
            near = (float(np.interp(middle, knots, bias)), float(np.interp(middle, knots, sigma)))
            rows[round(middle * 1000)] = _unseen(near, middle, (high - low) / 2)
        nearest = float(knots[0])
        if nearest > EDGE_M:
            rows[0] = _unseen((float(bias[0]), float(sigma[0])), 0.0, nearest)
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
                correlation_ppm=None if self.basis == "prior" else round(self.spread.correlation * 1_000_000),
                bias_length_mm=None if self._places is None else round(self._places.length_m * 1000),
                bias_fixed_ppm=None if self._places is None else round(self._places.fixed * 1_000_000),
            )
        except RecordError as error:
            raise CalibrationError(f"what was fitted is no commissioning: {error}") from error

    def method(self) -> str:
        """How it was found, for the record."""
        if self.basis == "prior":
            return f"{prior.METHOD}; a run of {self.coverage.seconds} s taught nothing better"
        return (
            f"Fitted to {self.coverage.seconds} s of ranges with truth, {self.coverage.nearest_m:.1f} to "
            f"{self.coverage.furthest_m:.1f} m, a round every {self.interval_s * 1000:.0f} ms; uncertainty from "
            "held-out parts"
        )

    def document(self) -> dict[str, Any]:
        """Everything for machines, in metres and seconds."""
        return {
            "basis": self.basis,
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
            "truth_off": self.truth.document(),
            "smoothness": self.curves.smoothness,
            "sharing": self.curves.sharing,
            "anchors": {
                name: {
                    "outliers": round(self.outliers[name], 4),
                    "obstructed": round(1.0 - float(self.spread.in_sight[index]), 4),
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
    truth = find_truth(runs)
    truth.check(runs[0].name if len(runs) == 1 else "the runs")
    notes += notes_of_shift(shift, gain)
    notes += [Note(code, text) for code, text in truth.notes()]
    return _fitted(runs, data, settings, shift, truth, notes)


def refit(runs: Sequence[Run], like: Fit) -> Fit:
    """The same from some of the runs that ``like`` was fitted to: neither truth nor anchors are examined again."""
    runs = tuple(runs)
    data = windows(runs)
    _check_amount(data, runs[0])
    return _fitted(runs, data, like.settings, like.shift_s, like.truth, [], like.curves)


def _fitted(
    runs: tuple[Run, ...],
    data: Windows,
    settings: FitSettings,
    shift: float,
    truth: Truth,
    notes: list[Note],
    like: Curves | None = None,
) -> Fit:
    first = runs[0]
    curves, held = fit_curves(data, like)
    interval = float(np.median([run.interval_s for run in runs]))
    spread = find_spread(data, curves, held, reference_sigma_m=settings.reference_sigma_m)
    coverage = coverage_of(data, first.anchors_m)
    outliers = {
        name: float(data.bursts[index] / max(int(data.ranges[index]), 1)) for index, name in enumerate(first.anchor_ids)
    }
    notes = [*notes, *notes_of(runs, data, coverage, outliers)]
    notes += _obstructed(first.anchor_ids, spread)
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
        truth=truth,
        settings=settings,
        places=find_places(
            data,
            spread,
            reference_sigma_m=settings.reference_sigma_m,
            remounted=settings.installation_floor_m > 0.0,
        ),
    )


def _obstructed(names: tuple[str, ...], spread: Spread) -> list[Note]:
    return [
        Note(
            "obstructed",
            f"Anchor {name}: something stood between in {1.0 - share:.0%} of the run. Those seconds did not count; "
            "where drones will be, give it a free view.",
        )
        for name, share in zip(names, spread.in_sight.tolist(), strict=True)
        if 1.0 - share > OFTEN_OBSTRUCTED
    ]


def _check_amount(data: Windows, run: Run) -> None:
    count, least = len(data.t_s), MIN_SECONDS * data.length_s
    if count < MIN_SECONDS:
        raise CalibrationError(
            f"{count * data.length_s:.0f} s of ranges with truth; {least:.0f} are the least, some minutes are usual"
        )
    present = np.isfinite(data.error_m)
    for index, name in enumerate(run.anchor_ids):
        if present[:, index].sum() < MIN_SECONDS / 2:
            raise CalibrationError(
                f"anchor {name}: ranges in {present[:, index].mean():.0%} of the time; is its node powered, and is "
                "its address the one in the list of anchors?"
            )
    if (present.sum(axis=1) >= 3).mean() < MIN_ROUNDS_WITH_THREE:
        raise CalibrationError("hardly ever did three anchors range at the same time; check the nodes")


def _unseen(near: tuple[float, float], distance_m: float, away_m: float) -> tuple[float, float]:
    """(bias, σ) where nobody measured, so far from where it was ``near``: the further, the more the chip's own."""
    bias, sigma = near
    away = SLOPE_M_PER_M * away_m
    chip2 = PRIOR_OWN_M**2 + PRIOR_COMMON_M**2
    share = chip2 / (chip2 + sigma**2 + away**2)
    return share * bias + (1.0 - share) * float(chip_bias_m(np.array(distance_m))), wandered(sigma, away)


def _mm(metres: float, most_mm: int, what: str) -> int:
    """For the record. Raises CalibrationError for what it cannot hold: cut off, it would be another pad's."""
    value = round(float(metres) * 1000)
    if abs(value) > most_mm:
        raise CalibrationError(
            f"{what} of {metres:.2f} m was fitted, and a record holds {most_mm / 1000:g} m at most; are ranges, survey "
            "and reference of the same pad, in metres?"
        )
    return value
