"""``wonderland pad commission --recording``: from files to a commissioning, without a live pad."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from wonderland.proofs.honest import SHARE_PPM
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.choice import Choice, fit_best
from wonderland_edge_agent.commissioning.clocks import Clocks, fit_clocks
from wonderland_edge_agent.commissioning.coverage import Note
from wonderland_edge_agent.commissioning.errors import CalibrationError, CommissioningError, RecordingError
from wonderland_edge_agent.commissioning.fit import Fit, FitSettings, fit_runs
from wonderland_edge_agent.commissioning.reach import (
    AtDistance,
    HeightProspects,
    Reach,
    ReachMap,
    TimedProspects,
    by_distance,
    reach,
    reach_map,
)
from wonderland_edge_agent.commissioning.recording import Recording
from wonderland_edge_agent.commissioning.reference import load_track
from wonderland_edge_agent.commissioning.run import Run
from wonderland_edge_agent.commissioning.shift import find_shift
from wonderland_edge_agent.commissioning.stamps import StampedRun
from wonderland_edge_agent.commissioning.survey_files import NOWHERE, Origin, Survey, load_survey
from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic

DAY_MS: Final = 86_400_000


@dataclass(frozen=True, kw_only=True)
class OfflineSettings:
    """What the command line asked for. Metres, seconds."""

    recordings: tuple[Path, ...]
    anchors: Path
    reference: Path | None = None
    time_stamps: tuple[Path, ...] = ()
    """Of the same runs as ``recordings``, in their order; none: the pad's nodes share no clock."""
    truth_shift_s: float | None = 0.0
    """None: find it."""
    truth_raise_m: float = 0.0
    fit: FitSettings = field(default_factory=FitSettings)
    origin: Origin | None = None
    crs: str = ""
    control: Path | None = None
    buffer_m: float = 1.0
    height_m: float = 3.0
    valid_days: int = 365


@dataclass(frozen=True)
class Calibrated:
    """What a calibration brought."""

    fit: Fit
    record: Commissioning
    reaches: list[Reach]
    map: ReachMap
    by_distance: tuple[AtDistance, ...]
    """The worst direction at usual distances, for the map's buffer."""
    shift_s: float
    notes: tuple[Note, ...]
    clocks: Clocks | None = None
    timed_reaches: tuple[Reach, ...] = ()
    """How far out time stamps alone verify a buffer (assurance 3)."""
    height_reaches: tuple[Reach, ...] = ()
    """How far out a height is proved within a buffer above and below it."""
    choice: Choice | None = None

    @property
    def go(self) -> bool:
        """Whether the pad verifies the buffer that was asked for (the map's) at any distance, in every direction."""
        return any(item.everywhere_m is not None for item in self.reaches if item.buffer_m == self.map.buffer_m)

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        out = self.fit.document()
        out["go"] = self.go
        if self.choice is not None:
            out["choice"] = self.choice.document()
        if self.clocks is not None:
            out["clocks"] = self.clocks.document()
            out["reach_by_time_stamps"] = [item.document() for item in self.timed_reaches]
        out["truth_shift_s"] = round(self.shift_s, 3)
        out["reach"] = [item.document() for item in self.reaches]
        out["reach_of_heights"] = [item.document() for item in self.height_reaches]
        out["honest_share"] = SHARE_PPM / 1_000_000
        out["rounds"] = [item.document() for item in self.by_distance]
        out["warnings"] = [{"code": note.code, "text": note.text} for note in self.notes]
        return out


def calibrate(settings: OfflineSettings, now_ms: int) -> Calibrated:
    """Read, fit, and say what the pad can settle. Raises CommissioningError."""
    survey = load_survey(settings.anchors, origin=settings.origin, crs=settings.crs, control=settings.control)
    stamps: Sequence[Path | None] = settings.time_stamps or (None,) * len(settings.recordings)
    if len(stamps) != len(settings.recordings):
        raise RecordingError(
            f"{len(stamps)} files of time stamps for {len(settings.recordings)} recordings; give one for each, in the "
            "same order"
        )
    return calibrate_runs(
        [Files(path, settings.reference, times) for path, times in zip(settings.recordings, stamps, strict=True)],
        survey,
        now_ms=now_ms,
        truth_shift_s=settings.truth_shift_s,
        truth_raise_m=settings.truth_raise_m,
        fit=settings.fit,
        buffer_m=settings.buffer_m,
        height_m=settings.height_m,
        valid_days=settings.valid_days,
    )


@dataclass(frozen=True)
class Files:
    """What was recorded of one run."""

    ranges: Path
    reference: Path | None = None
    """None: the truth is in the recording."""
    time_stamps: Path | None = None


def calibrate_runs(
    runs: Sequence[Files],
    survey: Survey,
    *,
    now_ms: int,
    truth_shift_s: float | None,
    truth_raise_m: float,
    fit: FitSettings,
    buffer_m: float,
    height_m: float,
    valid_days: int,
) -> Calibrated:
    """Fit recordings, and the clocks where there are time stamps. ``truth_shift_s`` None: find it.

    Raises CommissioningError.
    """
    shift = truth_shift_s or 0.0
    if truth_shift_s is None:
        shift, _ = find_shift(_runs(runs, survey, 0.0, truth_raise_m))
    read = _runs(runs, survey, shift, truth_raise_m)
    choice = fit_best(read, fit_runs(read, fit), buffer_m)
    return finish(
        choice,
        survey,
        now_ms=now_ms,
        shift_s=shift,
        buffer_m=buffer_m,
        height_m=height_m,
        valid_days=valid_days,
        clocks=_clocks(runs, survey, shift, truth_raise_m),
    )


def finish(
    choice: Choice,
    survey: Survey,
    *,
    now_ms: int,
    shift_s: float,
    buffer_m: float,
    height_m: float,
    valid_days: int,
    clocks: Clocks | None = None,
) -> Calibrated:
    """The record, and what the pad can settle with it. Raises CalibrationError."""
    fit = choice.fit
    notes = [Note(code, text) for code, text in survey.notes if code not in {n.code for n in fit.warnings}]
    notes += list(fit.warnings)
    if survey.frame is None:
        text = "The survey is not tied to the globe (--origin): good for studies, no ledger would take it for this pad."
        notes.append(Note("no_origin", text))
    record = fit.commissioning(
        survey.frame or NOWHERE.frame,
        valid_from_ms=now_ms,
        valid_until_ms=now_ms + valid_days * DAY_MS,
        macs={anchor.anchor_id: anchor.mac for anchor in survey.anchors},
        survey_sigma_m={anchor.anchor_id: anchor.sigma_m for anchor in survey.anchors},
    )
    if clocks is not None:
        record = clocks.into(record)
        notes += [Note(code, text) for code, text in clocks.notes()]
    policy = replace(Policy(), buffer_mm=round(buffer_m * 1000))
    buffers = sorted({0.5, 1.0, 2.0, 3.0, 5.0, 10.0, buffer_m})
    return Calibrated(
        fit,
        record,
        reach(record, policy, buffers_m=buffers, height_m=height_m),
        reach_map(record, policy, height_m=height_m),
        tuple(by_distance(record, policy, height_m=height_m)),
        shift_s,
        tuple(notes),
        clocks,
        tuple(reach(record, policy, buffers_m=buffers, height_m=height_m, kind=TimedProspects))
        if clocks is not None and clocks.usable
        else (),
        tuple(reach(record, policy, buffers_m=sorted({1.0, 2.0, buffer_m}), height_m=height_m, kind=HeightProspects)),
        choice,
    )


def write_record(path: Path, record: Commissioning) -> None:
    """The record as ``wonderland evaluate --commissioning`` and CommissionPad take it. Raises CommissioningError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, record.encode() + b"\n", PUBLIC)
    except (OSError, FileWriteError) as error:
        raise CommissioningError(f"{path}: not written ({error})") from error


def write_json(path: Path, document: dict[str, Any]) -> None:
    """A document for machines. Raises CommissioningError."""
    try:
        write_atomic(path, json.dumps(document, indent=2, ensure_ascii=False).encode() + b"\n", PUBLIC)
    except FileWriteError as error:
        raise CommissioningError(str(error)) from error


def _recording(files: Files, survey: Survey, shift_s: float, raise_m: float) -> Recording:
    return Recording.of_rows(
        files.ranges,
        survey.places_m,
        "the survey",
        truth_shift_s=shift_s,
        truth_raise_m=raise_m,
        reference=None if files.reference is None else load_track(files.reference, survey.frame),
    )


def _clocks(runs: Sequence[Files], survey: Survey, shift_s: float, raise_m: float) -> Clocks | None:
    stamped = [
        StampedRun.load(
            files.time_stamps,
            survey.places_m,
            _recording(files, survey, 0.0, 0.0).track,
            shift_s=shift_s,
            raise_m=raise_m,
        )
        for files in runs
        if files.time_stamps is not None
    ]
    return fit_clocks(stamped) if stamped else None


def _runs(files: Sequence[Files], survey: Survey, shift_s: float, raise_m: float) -> list[Run]:
    runs = []
    for each in files:
        path = each.ranges
        recording = _recording(each, survey, shift_s, raise_m)
        silent = sorted(set(survey.places_m) - {name for item in recording.rounds for name in item.ranges_m})
        if silent:
            raise CalibrationError(
                f"{path}: no range of {', '.join(silent)}; was the node silent, or is it not of this pad? A pad is "
                "calibrated with all its anchors"
            )
        runs.append(Run.of(recording, path.name))
    if not runs:
        raise RecordingError("no recording was given")
    return runs
