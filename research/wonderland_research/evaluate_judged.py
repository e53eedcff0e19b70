"""What windows come to, recording by recording, and whether a commissioning is what is missing."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from wonderland_research.evaluate import Study, Window

HEADER: Final = ("n", "verified", "open", "refuted", "blind", "paper", "off by", "95 %")
"""Blind: without an estimate. Paper: accepted by its rule. Off by: median distance from truth to estimate."""
LEAST_WINDOWS: Final = 5
"""Fewer say nothing about a pad."""


@dataclass(frozen=True)
class Judged:
    """A recording with its windows."""

    study: Study
    windows: tuple[Window, ...]

    def count(self, outcome: str) -> int:
        """Windows that ended so."""
        return sum(window.verdict.outcome == outcome for window in self.windows)

    @property
    def estimated(self) -> int:
        """Windows with an estimate."""
        return sum(window.verdict.signed is not None for window in self.windows)

    @property
    def errors_m(self) -> list[float]:
        """From truth to estimate."""
        return sorted(window.truth_error_m for window in self.windows if window.truth_error_m is not None)

    @property
    def paper(self) -> int:
        """Windows that the paper's rule accepts."""
        return sum(window.verdict.signed is not None and window.verdict.signed.paper_rule for window in self.windows)


def rows(found: Sequence[Judged]) -> list[tuple[str, ...]]:
    """A row for each recording and one for all: name, and what ``HEADER`` says."""
    out = [_row(one.study.name, [one]) for one in found]
    return [*out, _row("all", found)] if len(found) > 1 else out


def _row(name: str, judged: Sequence[Judged]) -> tuple[str, ...]:
    count = sum(len(one.windows) for one in judged)
    errors = sorted(error for one in judged for error in one.errors_m)
    return (
        name,
        str(count),
        *(str(sum(one.count(outcome) for one in judged)) for outcome in ("verified", "inconclusive", "refuted")),
        str(count - sum(one.estimated for one in judged)),
        str(sum(one.paper for one in judged)),
        f"{errors[len(errors) // 2]:.2f} m" if errors else "–",
        f"{errors[math.ceil(0.95 * len(errors)) - 1]:.2f} m" if errors else "–",
    )


def commission_first(found: Sequence[Judged]) -> str:
    """What to do where windows stay open because nobody calibrated the anchors; empty where that is not missing."""
    unknown = [one for one in found if one.study.settings.commissioning is None]
    estimated = sum(one.estimated for one in unknown)
    settled = sum(one.count("verified") + one.count("refuted") for one in unknown)
    if estimated < LEAST_WINDOWS or settled > estimated / 2:
        return ""
    first = unknown[0].study.settings
    shift_s = unknown[0].study.recording.truth_shift_s
    shift = " --truth-shift auto" if first.truth_shift_s is None else f" --truth-shift {shift_s:g}" if shift_s else ""
    higher = f" --truth-raise {first.truth_raise_m:g}" if first.truth_raise_m else ""
    another = "OTHER.csv" if unknown[0].study.recording.has_truth else "RANGES-WITH-TRUTH.csv"
    if first.reference is not None:
        another += " --reference ITS-TRACK.csv"
    return (
        f"{estimated - settled} of {estimated} windows stay open, and nobody calibrated these anchors: only the chip's "
        "published bias is known of them. Commission first, with another recording of this pad:\n"
        f"  wonderland pad commission --recording {another} --anchors {shlex.quote(str(first.anchors))}{shift}{higher} "
        "--out commissioning.json\n"
        "  and then evaluate with --commissioning commissioning.json"
    )
