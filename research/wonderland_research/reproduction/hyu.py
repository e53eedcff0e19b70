"""Real ranges with truth (the HYU recordings): how right the verdict is, with and without a calibration.

Four DW1000 anchors on a car, a tag out to 50 m, RTK truth; in line of sight and obstructed in part. Each window of
some rounds is judged by the contract's own function against five claims: the truth, lies of two and three buffers
across and along the line of sight, and some at random for the calibration of the likelihood: that assumes that any
place is as likely as another, so that they are drawn evenly by area. Three states of knowledge:

``none``    nobody calibrated these anchors: published bias of the chip, wide uncertainty
``part``    fitted on every other block of 20 s of the same recording, judged on the blocks between
``other``   fitted on the line-of-sight recording, judged on the other one: the anchors were mounted anew in between
"""

from __future__ import annotations

import csv
import dataclasses
import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.errors import CommissioningError
from wonderland_edge_agent.commissioning.fit import Fit, FitSettings, fit_runs
from wonderland_edge_agent.commissioning.judging import START_MS
from wonderland_edge_agent.commissioning.run import Run
from wonderland_research.batch import fixes
from wonderland_research.evaluate import Claimed, judge
from wonderland_research.reproduction.sampling import Share
from wonderland_simulator.flight import Vector
from wonderland_simulator.recording import RecordedRound, Recording, RecordingError, dw1000_commissioning
from wonderland_simulator.scenario import DAY_MS

TRUTH_SHIFT_S: Final = -0.175
"""The truth belonging to a range at t is the one at t − 0.175 s (the data set's README)."""
TRUTH_RAISE_M: Final = 1.05
BLOCK_S: Final = 20.0
"""Longer than what stays the same about a place; so a part that was held out is not known by its neighbours."""
MOUNTED_ANEW_M: Final = 0.06
RECORDINGS: Final = {"los": "los_a_case_1", "nlos": "nlos_a_case_1"}
STATIC: Final = "static_summary.csv"
DISTANCES_M: Final = ((0.0, 8.0), (8.0, 16.0), (16.0, 30.0), (30.0, 60.0))
ROUNDS: Final = 20
QUICK_EVERY: Final = 12
BUFFER_M: Final = 1.0
RANDOM_REACH_M: Final = 3.6
"""Half the side of the square from which claims at random are drawn; beyond it likelihoods are 0."""
RANDOM_CLAIMS: Final = 8
CLAIMS: Final = ("truth", "across 2", "along 2", "across 3", "along 3")
RANDOM: Final = "random"
LIES: Final = CLAIMS[1:]
"""Lies of two and three buffers, across the line of sight and along it."""

Progress = Callable[[str, int, int], None]
"""Hears what is under way, how much is done, and how much there is."""


@dataclass(frozen=True)
class Judged:
    """One window against one claim."""

    window: int
    recording: str
    known: str
    distance_m: float
    claim: str
    lie_m: float
    """How far the claim is from the truth."""
    outcome: str
    likelihood: float
    paper_accepts: bool


@dataclass(frozen=True)
class Single:
    """Every complete round by itself, as the paper takes it: its fix from four ranges, without correction."""

    recording: str
    distance_m: NDArray[np.float64]
    error_m: NDArray[np.float64]
    """(k, 2): across and along the line of sight."""

    def accepted(self, near_m: float, far_m: float, across_m: float, along_m: float = 0.0) -> Share:
        """How often the paper's rule accepts a claim so far from the truth, between two distances."""
        chosen = (self.distance_m >= near_m) & (self.distance_m < far_m)
        off = np.hypot(self.error_m[chosen, 0] - across_m, self.error_m[chosen, 1] - along_m)
        return Share(int((off <= BUFFER_M).sum()), int(chosen.sum()))


@dataclass(frozen=True)
class HyuResult:
    """All of it."""

    judged: tuple[Judged, ...]
    singles: dict[str, Single]
    fits: dict[str, Fit]
    """``los``: fitted on the blocks of the LOS recording with even numbers; ``los whole``: on all of it."""
    held: Run
    """The blocks of the LOS recording that ``fits["los"]`` did not see."""
    static: tuple[tuple[str, float, float, float], ...]
    """Standing series: condition, distance, bias and standard deviation (m)."""
    rounds: int
    seed: int

    def select(self, **fields: str) -> list[Judged]:
        """Windows whose fields have these values."""
        return [one for one in self.judged if all(getattr(one, name) == value for name, value in fields.items())]

    def share(self, outcome: str, windows: Sequence[Judged]) -> Share:
        """How many of these windows ended so; ``paper``: the paper's rule accepted."""
        count = sum(one.paper_accepts if outcome == "paper" else one.outcome == outcome for one in windows)
        return Share(count, len(windows))


def load(directory: Path) -> dict[str, Recording]:
    """The recordings of a directory by condition; raises RecordingError where one is missing or none."""
    found = {}
    for name, stem in RECORDINGS.items():
        ranges, anchors = directory / f"{stem}.csv", directory / f"{stem}_anchors.csv"
        missing = [path.name for path in (ranges, anchors) if not path.is_file()]
        if missing:
            raise RecordingError(
                f"{directory}: no {' and no '.join(missing)}; --data needs the converted HYU recordings "
                "(docs/reproduce.md says where they come from)"
            )
        found[name] = Recording.load(ranges, anchors, truth_shift_s=TRUTH_SHIFT_S, truth_raise_m=TRUTH_RAISE_M)
    return found


def measure(
    directory: Path, *, rounds: int = ROUNDS, seed: int = 1, quick: bool = False, progress: Progress = lambda *_: None
) -> HyuResult:
    """Judge everything; some 600 windows, a minute or two. ``quick``: every twelfth window.

    Raises RecordingError for files that are none, CommissioningError where a part cannot be fitted.
    """
    recordings = load(directory)
    static = tuple(_static(directory / STATIC))
    los, nlos = recordings["los"], recordings["nlos"]
    fits = {
        "los": fit_part(los, 0),
        "los odd": fit_part(los, 1),
        "nlos": fit_part(nlos, 0),
        "nlos odd": fit_part(nlos, 1),
        "los whole": fit_runs([Run.of(los, "los")], FitSettings(installation_floor_m=MOUNTED_ANEW_M)),
    }
    work: list[tuple[str, str, Commissioning, list[tuple[RecordedRound, ...]]]] = []
    for name, recording in recordings.items():
        unknown = dw1000_commissioning(recording.pad(), START_MS)
        work.append((name, "none", unknown, list(windows(recording.rounds, rounds))))
        for parity, key in ((0, name), (1, f"{name} odd")):
            held = part(recording, 1 - parity)
            work.append((name, "part", record_of(fits[key], unknown), list(windows(held.rounds, rounds))))
    other = record_of(fits["los whole"], dw1000_commissioning(nlos.pad(), START_MS), nlos)
    work.append(("nlos", "other", other, list(windows(nlos.rounds, rounds))))

    policy = Policy(buffer_mm=round(BUFFER_M * 1000), min_rounds=max(5, rounds // 2), max_rounds=max(rounds, 10))
    rng = random.Random(seed)
    every = QUICK_EVERY if quick else 1
    total = sum(len(chosen[::every]) for _, _, _, chosen in work)
    judged: list[Judged] = []
    done = 0
    for name, known, commissioning, chosen in work:
        for window in chosen[::every]:
            judged.extend(_window(done, name, known, window, commissioning, policy, rng))
            done += 1
            progress(f"{name.upper()}, calibration: {known}", done, total)
    return HyuResult(
        tuple(judged),
        {name: single_rounds(name, recording) for name, recording in recordings.items()},
        fits,
        Run.of(part(los, 1), "held out"),
        static,
        rounds,
        seed,
    )


def part(recording: Recording, parity: int) -> Recording:
    """Every other block of 20 s of a recording."""
    chosen = tuple(item for item in recording.rounds if int(item.t_s // BLOCK_S) % 2 == parity)
    return dataclasses.replace(recording, rounds=chosen)


def fit_part(recording: Recording, parity: int) -> Fit:
    """A calibration on every other block. Raises CommissioningError."""
    try:
        return fit_runs([Run.of(part(recording, parity), "part")])
    except CommissioningError as error:
        raise RecordingError(f"a part of the recording cannot be fitted: {error}") from error


def record_of(fit: Fit, like: Commissioning, anchors_of: Recording | None = None) -> Commissioning:
    """The Commissioning record of a fit; with ``anchors_of`` its anchors stand where that recording's do."""
    record = fit.commissioning(like.frame, valid_from_ms=START_MS - DAY_MS, valid_until_ms=START_MS + DAY_MS)
    if anchors_of is None:
        return record
    places = {anchor.anchor_id: anchor for anchor in like.anchors}
    moved = tuple(
        dataclasses.replace(
            anchor,
            east_mm=places[anchor.anchor_id].east_mm,
            north_mm=places[anchor.anchor_id].north_mm,
            up_mm=places[anchor.anchor_id].up_mm,
        )
        for anchor in record.anchors
    )
    return dataclasses.replace(record, anchors=moved)


def windows(rounds: Sequence[RecordedRound], size: int) -> Iterator[tuple[RecordedRound, ...]]:
    """Consecutive windows of so many rounds that lie within two seconds a gap."""
    for first in range(0, len(rounds) - size + 1, size):
        window = tuple(rounds[first : first + size])
        if all(after.t_s - before.t_s < 2.0 for before, after in pairwise(window)):
            yield window


def offsets(truth_m: Vector, rng: random.Random) -> dict[str, tuple[float, float]]:
    """Each kind of claim as an offset east and north (m), seen from the anchors' middle at the origin."""
    away = math.hypot(truth_m[0], truth_m[1]) or 1.0
    ue, un = truth_m[0] / away, truth_m[1] / away
    side = rng.choice((-1.0, 1.0))
    return {
        "truth": (0.0, 0.0),
        "across 2": (-2.0 * side * un, 2.0 * side * ue),
        "along 2": (2.0 * side * ue, 2.0 * side * un),
        "across 3": (-3.0 * side * un, 3.0 * side * ue),
        "along 3": (3.0 * side * ue, 3.0 * side * un),
    }


def anywhere(rng: random.Random) -> tuple[float, float]:
    """A claim at random as an offset east and north (m)."""
    return rng.uniform(-RANDOM_REACH_M, RANDOM_REACH_M), rng.uniform(-RANDOM_REACH_M, RANDOM_REACH_M)


def single_rounds(name: str, recording: Recording) -> Single:
    """The fix of each round in which every anchor measured, and its error."""
    names = tuple(recording.anchors)
    complete = [item for item in recording.rounds if all(item.ranges_m.get(one, 0.0) > 0.0 for one in names)]
    truth = np.array([item.truth_m for item in complete])
    anchors = np.array([recording.anchors[one] for one in names])
    found = fixes(anchors, np.array([[item.ranges_m[one] for one in names] for item in complete]), truth[:, 2])
    away = np.hypot(truth[:, 0], truth[:, 1])
    along = truth[:, :2] / away[:, None]
    error = found - truth[:, :2]
    across_error = error[:, 1] * along[:, 0] - error[:, 0] * along[:, 1]
    along_error = (error * along).sum(axis=1)
    return Single(name, away, np.column_stack([across_error, along_error]))


def _window(
    number: int,
    name: str,
    known: str,
    window: tuple[RecordedRound, ...],
    commissioning: Commissioning,
    policy: Policy,
    rng: random.Random,
) -> Iterator[Judged]:
    middle = window[len(window) // 2].truth_m
    claims = [*offsets(middle, rng).items(), *((RANDOM, anywhere(rng)) for _ in range(RANDOM_CLAIMS))]
    for claim, (east, north) in claims:
        verdict = judge(window, commissioning, policy, _said(east, north)).verdict
        signed = verdict.signed
        yield Judged(
            window=number,
            recording=name,
            known=known,
            distance_m=math.hypot(middle[0], middle[1]),
            claim=claim,
            lie_m=math.hypot(east, north),
            outcome=verdict.outcome,
            likelihood=signed.likelihood_ppm / 1e6 if signed is not None else math.nan,
            paper_accepts=signed is not None and signed.paper_rule,
        )


def _said(east: float, north: float) -> Claimed:
    return lambda _, truth: (truth[0] + east, truth[1] + north, truth[2])


def _static(path: Path) -> Iterator[tuple[str, float, float, float]]:
    """Standing series, if they are there: condition, true distance, bias, standard deviation."""
    if not path.is_file():
        return
    with path.open(newline="", encoding="utf-8") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            try:
                values = float(row["true"]), float(row["bias"]), float(row["std"])
            except (KeyError, TypeError, ValueError):
                raise RecordingError(f"{path}, line {line}: needs numbers in the columns true, bias, std") from None
            if all(math.isfinite(value) for value in values):
                yield (row.get("cond") or "LOS", *values)
