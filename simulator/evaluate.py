"""``wonderland evaluate``: a recording judged window by window by the contract's own function, without radios.

What ``simulate`` sends the whole way this command hands to ``proofs.verdict`` directly, some thousand windows a minute:
for studying a pad, a radio or a commissioning. A window counts as countersigned and authorised.
"""

from __future__ import annotations

import bisect
import csv
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from edge_agent.commissioning.judging import START_MS, Prepared
from edge_agent.commissioning.judging import prepare as prepare_window
from simulator.flight import Vector
from simulator.recording import RecordedRound, Recording, RecordingError, dw1000_commissioning
from simulator.simulate import MIN_ROUNDS, parse_claim
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.verdicts import OUTCOMES, Verdict

NO_ESTIMATE: Final = 3
"""Exit code where windows were judged, and none had an estimate."""
SAME_PLACE_M: Final = 0.05
"""A commissioning is of these anchors if it has them no further from where the list of anchors says."""
MAX_CLAIM_ROWS: Final = 1_000_000

Claimed = Callable[[float, Vector], Vector]
"""What the drone claims (m, anchors' frame) at a time (s), given the truth."""


@dataclass(frozen=True)
class EvaluateSettings:
    """What the command line asked for. Lengths in metres, times in seconds."""

    recording: Path
    anchors: Path
    commissioning: Path | None = None
    claim: str = "truth"
    truth_shift_s: float = 0.0
    truth_raise_m: float = 0.0
    rounds: int = 20
    windows: int = 0
    buffer_m: float = 1.0
    as_json: bool = False


@dataclass(frozen=True)
class Window:
    """One judged window: its rounds (t in s), what was claimed, and the verdict."""

    first_s: float
    last_s: float
    truth_m: Vector
    verdict: Verdict

    def line(self) -> dict[str, Any]:
        """One JSON object for machines; fields that a verdict does not have are left out."""
        verdict = self.verdict
        value: dict[str, Any] = {
            "from_s": round(self.first_s, 3),
            "to_s": round(self.last_s, 3),
            "outcome": verdict.outcome,
            "rounds": verdict.rounds,
            "more_rounds": verdict.more_rounds,
            "distance_m": round(math.hypot(self.truth_m[0], self.truth_m[1]), 3),
            "reasons": [{"code": reason.code, "text": reason.text} for reason in verdict.reasons],
        }
        if verdict.signed is not None:
            value |= {
                "likelihood": verdict.signed.likelihood_ppm / 1e6,
                "error_m": verdict.signed.error_mm / 1000,
                "paper_rule": verdict.signed.paper_rule,
            }
        if verdict.estimate is not None and verdict.covariance is not None:
            off = (
                verdict.estimate.east_mm / 1000 - self.truth_m[0],
                verdict.estimate.north_mm / 1000 - self.truth_m[1],
            )
            value |= {
                "estimate_m": [verdict.estimate.east_mm / 1000, verdict.estimate.north_mm / 1000],
                "truth_error_m": round(math.hypot(*off), 3),
                "covariance_mm2": verdict.covariance.to_json(),
            }
        if verdict.chi2_milli is not None:
            value["chi2"] = verdict.chi2_milli / 1000
        if verdict.within_mm is not None:
            value["within_m"] = verdict.within_mm / 1000
        return value


def evaluate(settings: EvaluateSettings) -> Iterator[Window]:
    """Judge each whole window of ``settings.rounds`` rounds; raises RecordingError for files that are none."""
    for name, value in (
        ("--truth-shift", settings.truth_shift_s),
        ("--truth-raise", settings.truth_raise_m),
        ("--buffer", settings.buffer_m),
    ):
        if not math.isfinite(value):
            raise RecordingError(f"{name} {value}: a finite number is needed")
    recording = Recording.load(
        settings.recording,
        settings.anchors,
        truth_shift_s=settings.truth_shift_s,
        truth_raise_m=settings.truth_raise_m,
    )
    commissioning = _commissioning(settings.commissioning, recording)
    said = claims_of(settings.claim)
    policy = Policy(
        buffer_mm=round(settings.buffer_m * 1000),
        min_rounds=max(min(MIN_ROUNDS, settings.rounds), settings.rounds // 2),
        max_rounds=max(settings.rounds, MIN_ROUNDS),
    )
    rounds = recording.rounds
    for count, first in enumerate(range(0, len(rounds) - settings.rounds + 1, settings.rounds)):
        if settings.windows and count >= settings.windows:
            return
        yield judge(rounds[first : first + settings.rounds], commissioning, policy, said)


def judge(rounds: tuple[RecordedRound, ...], commissioning: Commissioning, policy: Policy, said: Claimed) -> Window:
    """The verdict on consecutive rounds, were the drone to countersign them."""
    verdict = prepare(rounds, commissioning, policy, said).verdict()
    return Window(rounds[0].t_s, rounds[-1].t_s, rounds[len(rounds) // 2].truth_m, verdict)


def prepare(rounds: Sequence[RecordedRound], commissioning: Commissioning, policy: Policy, said: Claimed) -> Prepared:
    """What the contract would be given of consecutive rounds; times are relative to the first."""
    return prepare_window(
        [item.t_s for item in rounds],
        [item.ranges_m for item in rounds],
        [said(item.t_s, item.truth_m) for item in rounds],
        commissioning,
        policy,
    )


def claims_of(text: str) -> Claimed:
    """``truth``, ``offset:E,N,U`` or ``csv:FILE`` with columns t, x, y, z (s, m); raises RecordingError."""
    kind, _, rest = text.partition(":")
    if kind != "csv":
        moved = parse_claim(text)
        return lambda _, truth: moved(truth)
    path = Path(rest)
    times: list[float] = []
    places: list[Vector] = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                t_s, x, y, z = (float(row[name]) for name in ("t", "x", "y", "z"))
                if not all(math.isfinite(value) for value in (t_s, x, y, z)) or (times and t_s < times[-1]):
                    raise RecordingError(f"{path}: times must rise and numbers be finite (t = {t_s})")
                times.append(t_s)
                places.append((x, y, z))
                if len(times) > MAX_CLAIM_ROWS:
                    raise RecordingError(f"{path}: more than {MAX_CLAIM_ROWS} rows")
    except (OSError, UnicodeDecodeError, csv.Error, KeyError, ValueError, TypeError) as error:
        raise RecordingError(f"{path}: no claims; it needs the columns t, x, y, z in s and m ({error})") from error
    if not times:
        raise RecordingError(f"{path}: no claims in it")
    return lambda t_s, _: _between(times, places, t_s)


def run(settings: EvaluateSettings) -> int:
    """Print a line for each window and a summary; the exit code."""
    console = Console(stderr=settings.as_json, highlight=False)
    outcomes = dict.fromkeys(OUTCOMES, 0)
    paper = estimated = 0
    for window in evaluate(settings):
        line = window.line()
        outcomes[window.verdict.outcome] += 1
        paper += bool(line.get("paper_rule"))
        estimated += "likelihood" in line
        if settings.as_json:
            print(json.dumps(line), flush=True)  # noqa: T201 - the product of --json
            continue
        found = "no estimate"
        if "likelihood" in line:
            found = f"likelihood {line['likelihood']:.4f}  error {line['error_m']:.2f} m"
        console.print(
            f"{window.first_s:8.1f}–{window.last_s:.1f} s  {window.verdict.outcome:<12} {found:<34}  "
            f"at {line['distance_m']:.1f} m  [dim]{', '.join(reason.code for reason in window.verdict.reasons)}[/dim]",
            soft_wrap=True,
        )
    total = sum(outcomes.values())
    counts = ", ".join(f"{outcomes[name]} {name}" for name in OUTCOMES)
    console.print(f"{total} windows of {settings.rounds} rounds: {counts}; the paper's rule accepts {paper}")
    if total == 0:
        return 1
    return 0 if estimated else NO_ESTIMATE


def _commissioning(path: Path | None, recording: Recording) -> Commissioning:
    if path is None:
        return dw1000_commissioning(recording.pad(), START_MS)
    try:
        record = Commissioning.decode(path.read_bytes())
    except (OSError, ProofError) as error:
        raise RecordingError(f"{path}: no commissioning record ({error})") from error
    known = {anchor.anchor_id for anchor in record.anchors}
    if unknown := sorted(set(recording.anchors) - known):
        raise RecordingError(f"{path}: knows {', '.join(sorted(known))}, but not the recording's {', '.join(unknown)}")
    for anchor in record.anchors:
        place = (anchor.east_mm / 1000, anchor.north_mm / 1000, anchor.up_mm / 1000)
        off_m = math.dist(place, recording.anchors.get(anchor.anchor_id, place))
        if off_m > SAME_PLACE_M:
            raise RecordingError(
                f"{path}: commissioned with anchor {anchor.anchor_id} {off_m:.2f} m away from where the list of "
                "anchors has it; a bias table holds for the anchors that it was fitted to"
            )
    return record


def _between(times: list[float], places: list[Vector], t_s: float) -> Vector:
    index = bisect.bisect_left(times, t_s)
    if index == 0:
        return places[0]
    if index == len(times):
        return places[-1]
    before, after = times[index - 1], times[index]
    share = (t_s - before) / (after - before) if after > before else 0.0
    x, y, z = (a + (b - a) * share for a, b in zip(places[index - 1], places[index], strict=True))
    return (x, y, z)
