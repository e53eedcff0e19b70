"""What ``wonderland evaluate`` prints: a line for each window, a table over recordings, and what to do next."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from simulator.evaluate import EvaluateSettings, Study, Window
from simulator.evaluate_delays import find_delays, said_of
from wonderland.proofs.records.verdicts import OUTCOMES

NO_ESTIMATE: Final = 3
"""Exit code where windows were judged, and none had an estimate."""
COMMISSION_FIRST: Final = 4
"""Exit code where nobody calibrated these anchors, and therefore no window was settled."""
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


def run(settings: Sequence[EvaluateSettings], *, as_json: bool = False, report: Path | None = None) -> int:
    """Judge every recording, print, draw; the exit code. Raises RecordingError."""
    console = Console(stderr=as_json, highlight=False)
    studies = [Study.load(one) for one in settings]  # every file is read before the first line is printed
    found = []
    for study in studies:
        windows = []
        if len(studies) > 1:
            console.print(f"[bold]{escape(study.name)}[/bold]")
        for window in study.judged():
            windows.append(window)
            if as_json:
                print(json.dumps(window.line()), flush=True)  # noqa: T201 - the product of --json
            else:
                console.print(_line(window), soft_wrap=True)
        found.append(Judged(study, tuple(windows)))
    if len(found) > 1:
        console.print(_table(found))
    console.print(_total(found), soft_wrap=True)
    for sentence in said_of([(one.study.name, find_delays(one.study)) for one in found]):
        console.print(f"[yellow]![/yellow] {escape(sentence)}", soft_wrap=True)
    first = commission_first(found)
    if first:
        console.print(f"[yellow]![/yellow] {escape(first)}", soft_wrap=True)
    if report is not None:
        from simulator.evaluate_report import write  # noqa: PLC0415 - loads Matplotlib

        console.print(f"The report is {write(report, found)}.", soft_wrap=True)
    return _exit_code(found, first)


def commission_first(found: Sequence[Judged]) -> str:
    """What to do where windows stay open because nobody calibrated the anchors; empty where that is not missing."""
    unknown = [one for one in found if one.study.settings.commissioning is None]
    estimated = sum(one.estimated for one in unknown)
    settled = sum(one.count("verified") + one.count("refuted") for one in unknown)
    if estimated < LEAST_WINDOWS or settled > estimated / 2:
        return ""
    first = unknown[0].study.settings
    shift = f" --truth-shift {first.truth_shift_s:g}" if first.truth_shift_s else ""
    higher = f" --truth-raise {first.truth_raise_m:g}" if first.truth_raise_m else ""
    another = "OTHER.csv" if unknown[0].study.recording.has_truth else "RANGES-WITH-TRUTH.csv"
    return (
        f"{estimated - settled} of {estimated} windows stay open, and nobody calibrated these anchors: only the chip's "
        "published bias is known of them. Commission first, with another recording of this pad:\n"
        f"  wonderland pad commission --recording {another} --anchors {shlex.quote(str(first.anchors))}{shift}{higher} "
        "--out commissioning.json\n"
        "  and then evaluate with --commissioning commissioning.json"
    )


def _exit_code(found: Sequence[Judged], first: str) -> int:
    if not any(one.windows for one in found):
        return 1
    if not any(one.estimated for one in found):
        return NO_ESTIMATE
    settled = sum(one.count("verified") + one.count("refuted") for one in found)
    return COMMISSION_FIRST if first and not settled else 0


def _line(window: Window) -> str:
    signed = window.verdict.signed
    found = "no estimate"
    if signed is not None:
        found = f"likelihood {signed.likelihood_ppm / 1e6:.4f}  error {signed.error_mm / 1000:.2f} m"
    off = "" if window.truth_error_m is None else f"  {window.truth_error_m:.2f} m off"
    return (
        f"{window.first_s:8.1f}–{window.last_s:.1f} s  {window.verdict.outcome:<12} {found:<34}  "
        f"at {window.distance_m:.1f} m{off}  "
        f"[dim]{', '.join(reason.code for reason in window.verdict.reasons)}[/dim]"
    )


def _total(found: Sequence[Judged]) -> str:
    total = sum(len(one.windows) for one in found)
    counts = ", ".join(f"{sum(one.count(name) for one in found)} {name}" for name in OUTCOMES)
    rounds = found[0].study.settings.rounds
    return f"{total} windows of {rounds} rounds: {counts}; the paper's rule accepts {sum(one.paper for one in found)}"


HEADER: Final = ("n", "verified", "open", "refuted", "blind", "paper", "off by", "95 %")
"""Blind: without an estimate. Paper: accepted by its rule. Off by: median distance from truth to estimate."""


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
        f"{errors[int(0.95 * (len(errors) - 1))]:.2f} m" if errors else "–",
    )


def _table(found: Sequence[Judged]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("recording", overflow="fold")
    for title in HEADER:
        table.add_column(title, justify="right", no_wrap=True)
    for name, *values in rows(found):
        table.add_row(escape(name), *values, end_section=name == found[-1].study.name)
    return table
