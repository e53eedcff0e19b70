"""Whether what was fitted serves better than what was known before: judged on parts of the runs that it did not see.

The contract's own decision judges windows of the parts that were held out, against the truth and against lies, with the
table fitted to the rest, with the chip's prior, and with what lies halfway between. A commissioning that verifies fewer
honest drones than none, or is wrong more often, is not used: the operator is told, and the better one is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.coverage import Note
from wonderland_edge_agent.commissioning.errors import CalibrationError, RecordingError
from wonderland_edge_agent.commissioning.fit import BASES, Fit, refit
from wonderland_edge_agent.commissioning.judging import START_MS, prepare
from wonderland_edge_agent.commissioning.recording import Point
from wonderland_edge_agent.commissioning.run import Bools, Run, point
from wonderland_edge_agent.commissioning.survey_files import NOWHERE

BLOCK_S: Final = 20.0
"""Longer than what stays the same about a place; so no held-out part is known by its neighbours."""
FOLDS: Final = 3
ROUNDS: Final = 20
MOST_WINDOWS: Final = 40
"""Of a fold: enough to tell, and a second's work."""
LIES: Final = (1.5, 2.0)
"""In buffers."""
TURN: Final = 2.399963
"""Radians from one lie's direction to the next (the golden angle): no direction is left out."""
LEAST_GAIN: Final = 2
LEAST_WINDOWS: Final = 8
"""Fewer say nothing."""


@dataclass(frozen=True)
class Judged:
    """What the held-out windows came to with one basis."""

    basis: str
    honest: tuple[str, ...]
    """Each window's outcome against the truth."""
    lies_verified: int
    lies: int

    @property
    def verified(self) -> int:
        """Honest windows that were."""
        return self.honest.count("verified")

    @property
    def wrong(self) -> int:
        """Honest windows that were refuted, and lies that were verified."""
        return self.honest.count("refuted") + self.lies_verified

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {
            "basis": self.basis,
            "windows": len(self.honest),
            "honest_verified": self.verified,
            "honest_refuted": self.honest.count("refuted"),
            "lies": self.lies,
            "lies_verified": self.lies_verified,
        }


@dataclass(frozen=True)
class Choice:
    """The fit to use, and what the choice rests on (nothing, where the run was too short to hold parts out)."""

    fit: Fit
    judged: tuple[Judged, ...] = ()

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {"basis": self.fit.basis, "held_out": [one.document() for one in self.judged]}

    def sentence(self) -> str:
        """For people; empty where nothing was held out."""
        if not self.judged:
            return ""
        words = ", ".join(f"{NAMES[one.basis]} {one.verified}" for one in self.judged)
        wrong = ", ".join(f"{NAMES[one.basis]} {one.wrong}" for one in self.judged if one.wrong)
        return (
            f"Judged on parts that the fit did not see ({len(self.judged[0].honest)} windows of {ROUNDS} rounds): "
            f"honest verified with {words}; wrong of these and {self.judged[0].lies} lies: {wrong or 'none'}."
        )


NAMES: Final = {"fitted": "the fitted table", "halfway": "halfway to the prior", "prior": "the chip's prior"}


def fit_best(runs: Sequence[Run], fit: Fit, buffer_m: float = 1.0) -> Choice:
    """The fit, or what serves better than it where that is certain enough."""
    judged = tuple(_judge(tuple(runs), fit, buffer_m))
    if not judged or len(judged[0].honest) < LEAST_WINDOWS:
        return Choice(fit)
    better = [other for other in judged[1:] if _better(other, judged[0])]
    if not better:
        return Choice(fit, judged)
    best = max(better, key=lambda one: (-one.wrong, one.verified))
    chosen = fit.on_basis(best.basis)
    text = (
        f"On parts that the fit did not see, {NAMES[best.basis]} verifies {best.verified} of {len(best.honest)} honest "
        f"windows ({best.wrong} wrong), the fitted table {judged[0].verified} ({judged[0].wrong} wrong): "
        f"{NAMES[best.basis]} is used. What disturbed the run? Record another one."
    )
    return Choice(replace(chosen, warnings=(*chosen.warnings, Note(f"{best.basis}_better", text))), judged)


def _better(other: Judged, than: Judged) -> bool:
    """Fewer errors; or as few, and clearly more honest windows verified (a sign test's standard deviation)."""
    if other.wrong != than.wrong:
        return other.wrong < than.wrong
    pairs = [(a == "verified", b == "verified") for a, b in zip(other.honest, than.honest, strict=True)]
    gained, lost = sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)
    return gained - lost >= max(LEAST_GAIN, math.sqrt(gained + lost))


def _judge(runs: tuple[Run, ...], fit: Fit, buffer_m: float) -> Iterator[Judged]:
    honest: dict[str, list[str]] = {basis: [] for basis in BASES}
    false = dict.fromkeys(BASES, 0)
    lies = 0
    for rest, held in _parts(runs):
        try:
            learnt = refit(rest, fit)
        except CalibrationError:  # too little is left to learn from
            continue
        records = {basis: _record(learnt.on_basis(basis)) for basis in BASES}
        chosen = _windows(held)
        for window in chosen[:: -(-len(chosen) // MOST_WINDOWS)] if chosen else []:
            angle = TURN * lies
            lies += len(LIES)
            for basis, record in records.items():
                honest[basis].append(_outcome(window, record, buffer_m, (0.0, 0.0)))
                for size in LIES:
                    off = (size * buffer_m * math.cos(angle + size), size * buffer_m * math.sin(angle + size))
                    false[basis] += _outcome(window, record, buffer_m, off) == "verified"
    for basis in BASES:
        yield Judged(basis, tuple(honest[basis]), false[basis], lies)


def _parts(runs: tuple[Run, ...]) -> Iterator[tuple[tuple[Run, ...], Run]]:
    """(what to learn from, what to judge): each run in turn; of a single one blocks of seconds."""
    if len(runs) > 1:
        for index, run in enumerate(runs):
            yield (*runs[:index], *runs[index + 1 :]), run
        return
    (run,) = runs
    block_s = max(BLOCK_S, 1.25 * ROUNDS * run.interval_s)
    number = np.floor((run.t_s - run.t_s[0]) / block_s).astype(int)
    for fold in range(min(FOLDS, int(number[-1]) + 1)):
        held = number % FOLDS == fold
        if held.any() and not held.all():
            yield (run.only(~held),), run.only(held)


def _windows(run: Run) -> list[Run]:
    """Windows of consecutive rounds."""
    gaps = np.diff(run.t_s) > max(2.0, 3.0 * run.interval_s)
    found = []
    for rows in np.split(np.arange(len(run.t_s)), np.flatnonzero(gaps) + 1):
        for first in range(0, len(rows) - ROUNDS + 1, ROUNDS):
            chosen: Bools = np.zeros(len(run.t_s), dtype=bool)
            chosen[rows[first : first + ROUNDS]] = True
            found.append(run.only(chosen))
    return found


def _outcome(window: Run, record: Commissioning, buffer_m: float, off_m: tuple[float, float]) -> str:
    ranges = [
        {name: float(value) for name, value in zip(window.anchor_ids, row, strict=True) if np.isfinite(value)}
        for row in window.range_m
    ]
    claims: list[Point] = [(x + off_m[0], y + off_m[1], z) for x, y, z in (point(row) for row in window.truth_m)]
    policy = Policy(buffer_mm=round(buffer_m * 1000), min_rounds=ROUNDS // 2, max_rounds=ROUNDS)
    try:
        return prepare(window.t_s.tolist(), ranges, claims, record, policy).verdict().outcome
    except RecordingError:
        return "inconclusive"


def _record(fit: Fit) -> Commissioning:
    return fit.commissioning(NOWHERE.frame, valid_from_ms=START_MS - 1, valid_until_ms=START_MS + 10**9)
