"""Antenna delays that nobody set: by how much an anchor's ranges are off beyond what is known of uncalibrated radios.

Delays as delivered put a DW1000 0.2 to 0.4 m off, one anchor or all of them. That leaves near sessions open, and looks
like nothing in particular; so it is estimated here, and named.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.reduction import bias_at
from wonderland_edge_agent.commissioning import prior
from wonderland_research.evaluate import Study

SUSPECTED_SIGMAS: Final = 2.5
"""Of what units differ by; of all that a commissioned pad states."""
LEAST_M: Final = 0.05
LEAST_RANGES: Final = 30
MOST_M: Final = 3.0
"""No antenna delay is larger: something else is wrong."""


@dataclass(frozen=True)
class Delay:
    """How an anchor's ranges are off (m), beyond the commissioning's own table; ``anchor_id`` empty: all of them."""

    anchor_id: str
    off_m: float
    usual_m: float
    """One standard deviation of what is stated."""

    @property
    def suspected(self) -> bool:
        """Whether that is more than what is stated explains."""
        return abs(self.off_m) > max(SUSPECTED_SIGMAS * self.usual_m, LEAST_M)


@dataclass(frozen=True)
class Delays:
    """What all anchors share, and what each has besides."""

    common: Delay
    own: tuple[Delay, ...]
    against: str
    """``truth`` or ``claims``."""
    commissioned: bool

    @property
    def suspected(self) -> tuple[Delay, ...]:
        """Those that are worth a word."""
        return tuple(one for one in (self.common, *self.own) if one.suspected)

    def sentences(self) -> Iterator[str]:
        """Lines for the terminal: how late ranges are against the truth."""
        known = "the commissioning states" if self.commissioned else "uncalibrated DW1000 differ by"
        but = "" if self.against == "truth" else ", if the claims are true"
        cure = "Commission again" if self.commissioned else "Set it, or commission"
        for one in self.suspected:
            way = "long" if one.off_m > 0 else "short"
            what = f"All anchors' ranges are {abs(one.off_m):.2f} m too {way}"
            if one.anchor_id:
                what = f"Anchor {one.anchor_id}'s ranges are {abs(one.off_m):.2f} m {way}er than the others'"
            if abs(one.off_m) > MOST_M:
                yield (
                    f"{what}{but}: no antenna delay is so large. Are ranges, anchors and places all in metres, of this "
                    "pad, and on one clock (--truth-shift)?"
                )
                continue
            yield (
                f"{what}{but}; {known} ±{100 * one.usual_m:.1f} cm (1 σ). An antenna delay that was not set? {cure}."
            )


def find_delays(study: Study) -> Delays | None:
    """From all ranges of a recording, against its truth or else its claims; None where there are too few."""
    errors: dict[str, list[float]] = {}
    sigma: dict[str, list[float]] = {}
    anchors = {anchor.anchor_id: anchor for anchor in study.commissioning.anchors}
    for item in study.recording.rounds:
        place = item.truth_m if study.recording.has_truth else study.said(item.t_s, item.truth_m)
        for name, range_m in item.ranges_m.items():
            away = math.dist(place, study.recording.anchors[name])
            bias_mm, sigma_mm = bias_at(anchors[name], away * 1000)
            errors.setdefault(name, []).append(range_m - away - bias_mm / 1000)
            sigma.setdefault(name, []).append(sigma_mm / 1000)
    level = {name: statistics.median(values) for name, values in errors.items() if len(values) >= LEAST_RANGES}
    if len(level) < 3:
        return None
    common = statistics.median(level.values())
    shared = study.commissioning.installation_sigma_mm / 1000
    return Delays(
        Delay("", common, shared),
        tuple(Delay(name, value - common, statistics.median(sigma[name])) for name, value in level.items()),
        "truth" if study.recording.has_truth else "claims",
        study.commissioning.method != prior.METHOD,
    )


def said_of(studies: Iterable[tuple[str, Delays | None]]) -> Sequence[str]:
    """Sentences of several recordings, each named."""
    return [f"{name}: {sentence}" for name, found in studies if found is not None for sentence in found.sentences()]
