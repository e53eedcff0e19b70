"""``wonderland evaluate``: a recording judged window by window by the contract's own function, without radios.

What ``simulate`` sends the whole way this command hands to ``proofs.verdict`` directly, some thousand windows a minute:
for studying a pad, a radio or a commissioning. A window counts as countersigned and authorised.
"""

from __future__ import annotations

import bisect
import csv
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Self

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.verdicts import Verdict
from wonderland_edge_agent.commissioning.errors import TruthError
from wonderland_edge_agent.commissioning.judging import START_MS, Prepared
from wonderland_edge_agent.commissioning.judging import prepare as prepare_window
from wonderland_edge_agent.commissioning.reference import load_track
from wonderland_edge_agent.commissioning.run import Run
from wonderland_edge_agent.commissioning.shift import find_shift
from wonderland_edge_agent.commissioning.truth import Truth, find_truth
from wonderland_simulator.flight import Vector
from wonderland_simulator.recording import RecordedRound, Recording, RecordingError, dw1000_commissioning
from wonderland_simulator.simulate import MIN_ROUNDS, parse_claim

SAME_PLACE_M: Final = 0.05
"""A commissioning is of these anchors if it has them no further from where the list of anchors says."""
MAX_CLAIM_ROWS: Final = 1_000_000

Claimed = Callable[[float, Vector], Vector]
"""What the drone claims (m, anchors' frame) at a time (s), given the truth."""


@dataclass(frozen=True)
class EvaluateSettings:
    """What the command line asked for of one recording. Lengths in metres, times in seconds."""

    recording: Path
    anchors: Path
    commissioning: Path | None = None
    claim: str = "truth"
    truth_shift_s: float | None = 0.0
    """None: find it."""
    truth_raise_m: float = 0.0
    rounds: int = 20
    windows: int = 0
    buffer_m: float = 1.0
    reference: Path | None = None
    """A file of its own with the truth; None: it is in the recording, if anywhere."""


@dataclass(frozen=True)
class Window:
    """One judged window: its rounds (t in s), where the drone was and said that it was, and the verdict.

    Both places are those of the estimate's time: the mean of the rounds that it rests on.
    """

    first_s: float
    last_s: float
    at_s: float
    truth_m: Vector | None
    """None where the recording has none."""
    claim_m: Vector
    verdict: Verdict
    recording: str = ""

    @property
    def place_m(self) -> Vector:
        """Where the drone was; where nobody knows, where it said."""
        return self.claim_m if self.truth_m is None else self.truth_m

    @property
    def distance_m(self) -> float:
        """From the frame's origin, seen from above."""
        return math.hypot(self.place_m[0], self.place_m[1])

    @property
    def estimate_m(self) -> tuple[float, float] | None:
        """East and north, if there is one."""
        found = self.verdict.estimate
        return None if found is None else (found.east_mm / 1000, found.north_mm / 1000)

    @property
    def truth_error_m(self) -> float | None:
        """From the truth to the estimate, at its time."""
        if self.estimate_m is None or self.truth_m is None:
            return None
        return math.dist(self.estimate_m, self.truth_m[:2])

    def line(self) -> dict[str, Any]:
        """One JSON object for machines; fields that a verdict does not have are left out."""
        verdict = self.verdict
        value: dict[str, Any] = {
            "recording": self.recording,
            "from_s": round(self.first_s, 3),
            "to_s": round(self.last_s, 3),
            "outcome": verdict.outcome,
            "rounds": verdict.rounds,
            "more_rounds": verdict.more_rounds,
            "distance_m": round(self.distance_m, 3),
            "reasons": [{"code": reason.code, "facts": dict(reason.facts)} for reason in verdict.reasons],
        }
        if verdict.signed is not None:
            value |= {
                "likelihood": verdict.signed.likelihood_ppm / 1e6,
                "error_m": verdict.signed.error_mm / 1000,
                "paper_rule": verdict.signed.paper_rule,
            }
        if self.estimate_m is not None and verdict.covariance is not None:
            value |= {
                "at_s": round(self.at_s, 3),
                "estimate_m": list(self.estimate_m),
                "covariance_mm2": verdict.covariance.to_json(),
            }
        if self.truth_error_m is not None:
            value["truth_error_m"] = round(self.truth_error_m, 3)
        if verdict.chi2_milli is not None:
            value["chi2"] = verdict.chi2_milli / 1000
        if verdict.height is not None:
            value["height"] = {
                "outcome": verdict.height.outcome,
                "claimed_m": verdict.height.claimed_mm / 1000,
                "measured_m": verdict.height.measured_mm / 1000,
                "sigma_m": round(math.sqrt(max(verdict.height.uu_mm2, 0)) / 1000, 3),
            }
        if verdict.within_mm is not None:
            value["within_m"] = verdict.within_mm / 1000
        return value


@dataclass(frozen=True)
class Study:
    """A recording that was read, with everything that its windows are judged by."""

    settings: EvaluateSettings
    recording: Recording
    commissioning: Commissioning
    policy: Policy
    said: Claimed

    @classmethod
    def load(cls, settings: EvaluateSettings) -> Self:
        """Read the files. Raises RecordingError for what is none."""
        for name, value in (
            ("--truth-shift", settings.truth_shift_s or 0.0),
            ("--truth-raise", settings.truth_raise_m),
            ("--buffer", settings.buffer_m),
        ):
            if not math.isfinite(value):
                raise RecordingError(f"{name} {value}: a finite number is needed")
        recording = _recording(settings, settings.truth_shift_s or 0.0)
        if not recording.has_truth and not settings.claim.startswith("csv:"):
            raise RecordingError(
                f"{settings.recording}: it has no truth (gt_x, gt_y, gt_z; or --reference FILE), so say what the drone "
                "claims: --claim csv:FILE (t, x, y, z)"
            )
        if settings.truth_shift_s is None:
            recording = _recording(settings, _found_shift_s(settings, recording))
        policy = policy_of(settings.buffer_m, settings.rounds)
        said = claims_of(settings.claim, (recording.rounds[0].t_s, recording.rounds[-1].t_s))
        return cls(settings, recording, commissioning_of(settings.commissioning, recording), policy, said)

    @property
    def name(self) -> str:
        """The recording's file name without its suffix."""
        return self.settings.recording.stem

    @property
    def truth_off(self) -> Truth | None:
        """By how much the ranges contradict a truth that came from elsewhere, or whose delay was looked for."""
        if self.settings.reference is None and self.settings.truth_shift_s is not None:
            return None
        return find_truth([Run.of(self.recording, self.name)])

    def rounds(self) -> Iterator[Sequence[RecordedRound]]:
        """The rounds of one window after the other."""
        return itertools.islice(windows_of(self.recording.rounds, self.settings.rounds), self.settings.windows or None)

    def judged(self) -> Iterator[Window]:
        """Every window with its verdict. Raises RecordingError for claims that are nowhere."""
        for rounds in self.rounds():
            yield replace(judge(rounds, self.commissioning, self.policy, self.said), recording=self.name)


def _recording(settings: EvaluateSettings, shift_s: float) -> Recording:
    # Where the reference is on the globe, the commissioning says where the anchors are.
    frame = None if settings.commissioning is None else _read(settings.commissioning).frame
    try:
        truth = None if settings.reference is None else load_track(settings.reference, frame)
    except TruthError as error:
        raise RecordingError(str(error)) from error
    return Recording.load(
        settings.recording,
        settings.anchors,
        truth_shift_s=shift_s,
        truth_raise_m=settings.truth_raise_m,
        truthless=True,
        reference=truth,
    )


def _found_shift_s(settings: EvaluateSettings, recording: Recording) -> float:
    if not recording.has_truth:
        raise RecordingError("--truth-shift auto: there is no truth whose delay could be found")
    return find_shift([Run.of(recording, settings.recording.name)])[0]


def policy_of(buffer_m: float, rounds: int) -> Policy:
    """What a pad with that buffer would ask of windows of so many rounds."""
    return Policy(
        buffer_mm=round(buffer_m * 1000),
        min_rounds=max(min(MIN_ROUNDS, rounds), rounds // 2),
        max_rounds=max(rounds, MIN_ROUNDS),
    )


def windows_of(rounds: Sequence[RecordedRound], size: int) -> Iterator[Sequence[RecordedRound]]:
    """One whole window after the other; what is left over at the end is left out."""
    for first in range(0, len(rounds) - size + 1, size):
        yield rounds[first : first + size]


def evaluate(settings: EvaluateSettings) -> Iterator[Window]:
    """Judge each whole window of ``settings.rounds`` rounds; raises RecordingError for files that are none."""
    yield from Study.load(settings).judged()


def judge(rounds: Sequence[RecordedRound], commissioning: Commissioning, policy: Policy, said: Claimed) -> Window:
    """The verdict on consecutive rounds, were the drone to countersign them."""
    verdict = prepare(rounds, commissioning, policy, said).verdict()
    # A recording has no request.
    verdict = replace(verdict, reasons=tuple(each for each in verdict.reasons if each.code != "request_unjudged"))
    times = [item.t_s for item in rounds]
    estimate_ms = verdict.estimate_ms  # of the rounds that were kept
    at_s = sum(times) / len(times) if estimate_ms is None else times[0] + (estimate_ms - START_MS) / 1000
    claim = _between(times, [said(item.t_s, item.truth_m) for item in rounds], at_s)
    truth: Vector | None = _between(times, [item.truth_m for item in rounds], at_s)
    if truth is not None and not all(math.isfinite(value) for value in truth):
        truth = None
    return Window(times[0], times[-1], at_s, truth, claim, verdict)


def prepare(rounds: Sequence[RecordedRound], commissioning: Commissioning, policy: Policy, said: Claimed) -> Prepared:
    """What the contract would be given of consecutive rounds; times are relative to the first."""
    return prepare_window(
        [item.t_s for item in rounds],
        [item.ranges_m for item in rounds],
        [said(item.t_s, item.truth_m) for item in rounds],
        commissioning,
        policy,
    )


def claims_of(text: str, between_s: tuple[float, float] | None = None) -> Claimed:
    """``truth``, ``offset:E,N,U`` or ``csv:FILE`` with columns t, x, y, z (s, m); raises RecordingError.

    ``between_s``: the recording's first and last time, which claims of a file have to overlap.
    """
    kind, _, rest = text.partition(":")
    if kind != "csv":
        moved = parse_claim(text)
        return lambda _, truth: moved(truth)
    path = Path(rest)
    times: list[float] = []
    places: list[Vector] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
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
    if between_s is not None and (times[-1] < between_s[0] or times[0] > between_s[1]):
        raise RecordingError(
            f"{path}: its claims are of {times[0]:.1f} to {times[-1]:.1f} s, the ranges of {between_s[0]:.1f} to "
            f"{between_s[1]:.1f} s; bring them to one clock"
        )
    return lambda t_s, _: _between(times, places, t_s)


def commissioning_of(given: Path | Commissioning | None, recording: Recording) -> Commissioning:
    """What is known of the recording's anchors. Raises RecordingError where that is of other anchors."""
    if given is None:
        return dw1000_commissioning(recording.pad(), START_MS)
    record, where = (given, "commissioning") if isinstance(given, Commissioning) else (_read(given), given)
    known = {anchor.anchor_id for anchor in record.anchors}
    if unknown := sorted(set(recording.anchors) - known):
        raise RecordingError(f"{where}: knows {', '.join(sorted(known))}, but not the recording's {', '.join(unknown)}")
    for anchor in record.anchors:
        place = (anchor.east_mm / 1000, anchor.north_mm / 1000, anchor.up_mm / 1000)
        off_m = math.dist(place, recording.anchors.get(anchor.anchor_id, place))
        if off_m > SAME_PLACE_M:
            raise RecordingError(
                f"{where}: commissioned with anchor {anchor.anchor_id} {off_m:.2f} m away from where the list of "
                "anchors has it; a bias table holds for the anchors that it was fitted to"
            )
    return record


def _read(path: Path) -> Commissioning:
    try:
        return Commissioning.decode(path.read_bytes())
    except (OSError, ProofError) as error:
        raise RecordingError(f"{path}: no commissioning record ({error})") from error


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
