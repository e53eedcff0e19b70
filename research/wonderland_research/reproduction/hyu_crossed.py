"""Commissioned on one recording, judged on the others: what a commissioning is worth, beside none.

Each of the HYU recordings commissions the pad as ``wonderland pad commission`` does, whole or from a piece of it, and
every other recording is judged with the result. Where its anchors had been mounted anew, the table goes with the nodes,
and their common bias counts as unknown (60 mm). No window is judged by what was learnt from its own recording.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.table import Table

from wonderland.consoles import for_people
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.choice import fit_best
from wonderland_edge_agent.commissioning.fit import Fit, FitSettings, fit_runs
from wonderland_edge_agent.commissioning.judging import START_MS
from wonderland_edge_agent.commissioning.run import Run
from wonderland_research.evaluate import judge
from wonderland_research.reproduction.hyu import MOUNTED_ANEW_M, TRUTH_RAISE_M, TRUTH_SHIFT_S, record_of, windows
from wonderland_simulator.flight import Vector
from wonderland_simulator.recording import RecordedRound, Recording, RecordingError, dw1000_commissioning

STEMS: Final = {"los a": "los_a_case_1", "nlos a": "nlos_a_case_1", "los b": "los_b_case_3", "nlos b": "nlos_b_case_3"}
LIES_M: Final = (1.5, 2.0, 3.0)
PIECES_S: Final = (30.0, 60.0)
EVERY_S: Final = 55.0
"""A piece begins so often."""
PIECES_EVERY: Final = 3
"""Of the windows, judged by what a piece taught."""
QUICK_EVERY: Final = 12

Window = tuple[RecordedRound, ...]


@dataclass(frozen=True)
class Crossed:
    """What windows of one recording came to, known in one way."""

    learnt_from: str
    """A recording; ``none``: nobody calibrated."""
    piece: str
    """``whole``, or how long and which."""
    judged: str
    mounted: str
    """``same``, ``anew``, or nothing where nothing was learnt."""
    basis: str
    honest: tuple[str, ...]
    lies: dict[float, Counter[str]]

    @property
    def verified(self) -> int:
        """How many honest windows were verified."""
        return self.honest.count("verified")

    def row(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        count = Counter(self.honest)
        return {
            "learnt_from": self.learnt_from,
            "piece": self.piece,
            "judged": self.judged,
            "mounted": self.mounted,
            "basis": self.basis,
            "honest": {name: count[name] for name in ("verified", "inconclusive", "refuted")},
            "lies": {
                f"{size:g} m": {name: found[name] for name in ("verified", "inconclusive", "refuted")}
                for size, found in self.lies.items()
            },
        }


@dataclass(frozen=True)
class _Learnt:
    """A commissioning for one recording."""

    source: str
    piece: str
    mounted: str
    basis: str
    record: Commissioning


def load(directory: Path) -> dict[str, Recording]:
    """Those that are there, two at least. Raises RecordingError."""
    found = {
        name: Recording.load(
            directory / f"{stem}.csv",
            directory / f"{stem}_anchors.csv",
            truth_shift_s=TRUTH_SHIFT_S,
            truth_raise_m=TRUTH_RAISE_M,
        )
        for name, stem in STEMS.items()
        if (directory / f"{stem}.csv").is_file()
    }
    if len(found) < 2:
        raise RecordingError(f"{directory}: two of {', '.join(STEMS.values())} are needed to judge one by another")
    return found


def measure(directory: Path, *, rounds: int = 20, quick: bool = False) -> Iterator[Crossed]:
    """Every recording by nothing, by every other, and by pieces of one other. Raises CommissioningError."""
    recordings = load(directory)
    policy = Policy(buffer_mm=1000, min_rounds=max(5, rounds // 2), max_rounds=max(rounds, 10))
    every = QUICK_EVERY if quick else 1
    for judged, recording in recordings.items():
        chosen = list(windows(recording.rounds, rounds))[::every]
        nothing = dw1000_commissioning(recording.pad(), START_MS)
        yield _judged(judged, chosen, _Learnt("none", "whole", "", "prior", nothing), policy)
        for source in recordings:
            if source != judged:
                yield _judged(judged, chosen, _learn(recordings, source, judged), policy)
    for judged, source in _pairs(recordings):
        recording = recordings[judged]
        chosen = list(windows(recording.rounds, rounds))[:: PIECES_EVERY * every]
        nothing = dw1000_commissioning(recording.pad(), START_MS)
        for seconds in PIECES_S:
            for number, piece in enumerate(_pieces(Run.of(recordings[source], source), seconds)):
                learnt = _learn(recordings, source, judged, piece, f"{seconds:g} s, piece {number + 1}")
                yield _judged(judged, chosen, learnt, policy)
                # Beyond what was driven nothing was learnt: so far the chip's prior is taken as well.
                near = dataclasses.replace(nothing, max_range_mm=learnt.record.max_range_mm)
                yield _judged(judged, chosen, _Learnt("none", learnt.piece, "", "prior", near), policy)


def summary(found: Sequence[Crossed]) -> list[tuple[str, ...]]:
    """Rows of the table: what was known, windows, honest outcomes, lies verified by size."""
    groups: list[tuple[str, list[Crossed]]] = []
    whole = [one for one in found if one.piece == "whole"]
    nothing = [one for one in whole if one.learnt_from == "none"]
    learnt = [one for one in whole if one.learnt_from != "none"]
    groups.append(("nothing", [other for one in learnt for other in nothing if other.judged == one.judged]))
    groups.append(("another recording", learnt))
    groups += [(f"  mounted {how}", [one for one in learnt if one.mounted == how]) for how in ("same", "anew")]
    for seconds in PIECES_S:
        pieces = [one for one in found if one.piece.startswith(f"{seconds:g} s")]
        groups.append(("nothing, as far out", [one for one in pieces if one.learnt_from == "none"]))
        groups.append((f"{seconds:g} s of another", [one for one in pieces if one.learnt_from != "none"]))
    beside = {(one.judged, one.piece): one for one in found if one.learnt_from == "none"}
    return [_summed(name, group, beside) for name, group in groups if group]


HEADER: Final = ("known", "n", "verif.", "open", "ref.", *(f"{size:g} m" for size in LIES_M), "worse")


def run(data: Path, *, rounds: int, quick: bool, as_json: bool) -> int:
    """Measure and print; the exit code."""
    console = for_people(stderr=as_json)
    found = []
    for one in measure(data, rounds=rounds, quick=quick):
        found.append(one)
        if as_json:
            print(json.dumps(one.row()), flush=True)  # noqa: T201 - the product of --json
    table = Table(box=None, pad_edge=False, title=f"Windows of {rounds} rounds, judged by what other recordings taught")
    for title in HEADER:
        table.add_column(title, justify="left" if title == "known" else "right", no_wrap=True)
    for row in summary(found):
        table.add_row(*row)
    console.print(table)
    console.print(
        f"By metres: lies verified, of all. Worse: commissionings that verified fewer than none by more than {SLACK}."
    )
    return 0


SLACK: Final = 1
"""Windows that chance may take."""


def _pairs(recordings: dict[str, Recording]) -> Iterator[tuple[str, str]]:
    """(judged, learnt from): the other recording of the same course."""
    for judged in recordings:
        for source in recordings:
            if source != judged and source[-1] == judged[-1]:
                yield judged, source


def _pieces(run: Run, seconds: float) -> Iterator[Run]:
    start, end = float(run.t_s[0]), float(run.t_s[-1])
    for begin in np.arange(start, end - seconds, EVERY_S):
        yield run.only((run.t_s >= begin) & (run.t_s < begin + seconds))


def _learn(
    recordings: dict[str, Recording], source: str, judged: str, piece: Run | None = None, said: str = "whole"
) -> _Learnt:
    same = recordings[source].anchors == recordings[judged].anchors
    fit = _fitted(piece or Run.of(recordings[source], source), same=same)
    recording = recordings[judged]
    record = record_of(fit, dw1000_commissioning(recording.pad(), START_MS), recording)
    return _Learnt(source, said, "same" if same else "anew", fit.basis, record)


def _fitted(run: Run, *, same: bool) -> Fit:
    return fit_best([run], fit_runs([run], FitSettings(installation_floor_m=0.0 if same else MOUNTED_ANEW_M))).fit


def _judged(name: str, chosen: Sequence[Window], learnt: _Learnt, policy: Policy) -> Crossed:
    honest = tuple(_outcome(window, learnt.record, policy, (0.0, 0.0)) for window in chosen)
    lies: dict[float, Counter[str]] = {size: Counter() for size in LIES_M}
    for window in chosen:
        east, north = window[len(window) // 2].truth_m[:2]
        away = math.hypot(east, north) or 1.0
        for size in LIES_M:
            for way in ((-north, east), (north, -east), (east, north), (-east, -north)):
                off = (size * way[0] / away, size * way[1] / away)
                lies[size][_outcome(window, learnt.record, policy, off)] += 1
    return Crossed(learnt.source, learnt.piece, name, learnt.mounted, learnt.basis, honest, lies)


def _outcome(window: Window, record: Commissioning, policy: Policy, off_m: tuple[float, float]) -> str:
    def said(_: float, truth: Vector) -> Vector:
        return (truth[0] + off_m[0], truth[1] + off_m[1], truth[2])

    return judge(window, record, policy, said).verdict.outcome


def _summed(name: str, group: Sequence[Crossed], beside: Mapping[tuple[str, str], Crossed]) -> tuple[str, ...]:
    honest = Counter(outcome for one in group for outcome in one.honest)
    lies = []
    for size in LIES_M:
        counts = sum((one.lies[size] for one in group), Counter[str]())
        lies.append(f"{counts['verified']}/{counts.total()}")
    fewer = sum(one.verified < beside[one.judged, one.piece].verified - SLACK for one in group)
    worse = "" if group[0].learnt_from == "none" else f"{fewer}/{len(group)}"
    return (
        name,
        str(honest.total()),
        *(str(honest[outcome]) for outcome in ("verified", "inconclusive", "refuted")),
        *lies,
        worse,
    )
