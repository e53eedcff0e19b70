"""What ``wonderland evaluate`` prints: a line for each window, a table over recordings, and what to do next."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rich.markup import escape
from rich.table import Table

from wonderland.consoles import for_people
from wonderland.proofs.records.verdicts import OUTCOMES
from wonderland_research.evaluate import EvaluateSettings, Study, Window
from wonderland_research.evaluate_delays import find_delays, said_of
from wonderland_research.evaluate_judged import HEADER, Judged, commission_first, rows

NO_ESTIMATE: Final = 3
"""Exit code where windows were judged, and none had an estimate."""
COMMISSION_FIRST: Final = 4
"""Exit code where nobody calibrated these anchors, and therefore no window was settled."""


def run(settings: Sequence[EvaluateSettings], *, as_json: bool = False, report: Path | None = None) -> int:
    """Judge every recording, print, draw; the exit code. Raises RecordingError."""
    console = for_people(stderr=as_json)
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
        count = len(study.recording.rounds)
        if not windows:
            console.print(
                f"[yellow]![/yellow] {escape(study.name)} has {count} rounds, fewer than a window of "
                f"{study.settings.rounds}: --rounds {count} judges them together",
                soft_wrap=True,
            )
    if len(found) > 1:
        console.print(_table(found))
    console.print(_total(found), soft_wrap=True)
    for study in studies:
        if (off := study.truth_off) is not None:
            shift_s = study.recording.truth_shift_s
            when = f"{abs(shift_s):.2f} s {'later' if shift_s > 0 else 'earlier'}"
            taken = f"Of each range the truth {when} was taken. " if shift_s else ""
            console.print(f"{escape(study.name)}: {taken}{escape(off.sentence())}", soft_wrap=True)
    for sentence in said_of([(one.study.name, find_delays(one.study)) for one in found]):
        console.print(f"[yellow]![/yellow] {escape(sentence)}", soft_wrap=True)
    first = commission_first(found)
    if first:
        console.print(f"[yellow]![/yellow] {escape(first)}", soft_wrap=True)
    if report is not None:
        from wonderland_research.evaluate_report import write  # noqa: PLC0415 - loads Matplotlib

        console.print(f"The report is {write(report, found)}.", soft_wrap=True)
    return _exit_code(found, first)


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


def _table(found: Sequence[Judged]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("recording", overflow="fold")
    for title in HEADER:
        table.add_column(title, justify="right", no_wrap=True)
    for name, *values in rows(found):
        table.add_row(escape(name), *values, end_section=name == found[-1].study.name)
    return table
