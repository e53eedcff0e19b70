"""The five steps at a live pad, each kept in the state directory: survey, check, run, fit, publish."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from wonderland.clock import Clock, SteadyClock
from wonderland.proofs.records.pads import Commissioning, Frame
from wonderland.proofs.records.radios import NodeAbility
from wonderland_edge_agent.commissioning.alone import alone
from wonderland_edge_agent.commissioning.errors import (
    ClockError,
    CommissioningError,
    RadioError,
    StateError,
    SurveyError,
)
from wonderland_edge_agent.commissioning.fit import FitSettings
from wonderland_edge_agent.commissioning.live.dialogue import Dialogue
from wonderland_edge_agent.commissioning.live.publish import Operator, publish
from wonderland_edge_agent.commissioning.live.radios import (
    TagPlan,
    common_to,
    open_nodes,
    recorded_ability,
    run,
)
from wonderland_edge_agent.commissioning.live.recorder import RunRecorder, middle_of
from wonderland_edge_agent.commissioning.live.state import STEPS, StateDirectory, fingerprint, time_stamps_of
from wonderland_edge_agent.commissioning.offline import Calibrated, Files, calibrate_runs, write_json, write_record
from wonderland_edge_agent.commissioning.survey_files import Origin, Survey, SurveyedAnchor, load_survey, local_of
from wonderland_edge_agent.drift.baseline import Baseline
from wonderland_edge_agent.radios import AnchorPort
from wonderland_edge_agent.radios.between import measure_between
from wonderland_edge_agent.references import Point, PositionError, SourceError
from wonderland_edge_agent.references.sources import Live, Source
from wonderland_edge_agent.self_survey import Priors, SelfSurvey, self_survey
from wonderland_edge_agent.settings import PadSettings
from wonderland_fabric_gateway.files import PRIVATE, write_atomic
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import Opener

SHOW_S: Final = 0.5
DEFAULT_REACH_M: Final = 20.0
KEY_FILE: Final = "run.key"
UNTIED: Final = "the survey has to be tied to the globe: give --origin LAT,LON,HEIGHT, or lat, lon, height"
PUBLISH_QUESTION: Final = "Publish this commissioning of {}? Verdicts rest on it then."


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """What the command line asked for."""

    pad: PadSettings
    state: Path
    anchors: Path
    origin: Origin | None = None
    crs: str = ""
    control: Path | None = None
    tag_port: str | Opener = ""
    """Where the tag hangs; empty: on another computer."""
    tag_mac: int = 0xD001
    reference_live: Source | None = None
    reference_file: Path | None = None
    seconds: float = 0.0
    """Length of the run; 0: until it is stopped."""
    reach_m: float = DEFAULT_REACH_M
    """How far out the drone is to be carried."""
    truth_shift_s: float | None = None
    truth_raise_m: float = 0.0
    fit: FitSettings = field(default_factory=FitSettings)
    buffer_m: float = 1.0
    height_m: float = 3.0
    valid_days: int = 365
    operator: Operator | None = None
    check_rounds: int = 30
    run_interval_ms: int = 100
    """100 ms is what a tag on another computer is told."""
    dry_run: bool = False
    redo: str = ""
    another_run: bool = False


class Wizard:
    """One commissioning. ``run`` does what is not done yet; raises CommissioningError, after which it can go on."""

    def __init__(self, settings: LiveSettings, dialogue: Dialogue, *, clock: Clock | None = None) -> None:
        self.stop = asyncio.Event()
        """Ends the calibration run."""
        self.recording = False
        """Whether a run is under way, which ``stop`` would end."""
        self.reference_address: tuple[str, int] | None = None
        """Where the live reference is heard, while it is."""
        self._settings = settings
        self._dialogue = dialogue
        self._clock = clock or SteadyClock()
        self._state = StateDirectory(settings.state, settings.pad.pad_id)
        if settings.redo:
            if settings.redo not in STEPS:
                raise StateError(f"there is no step {settings.redo!r}; steps are {', '.join(STEPS)}")
            self._state.forget_from(settings.redo)

    async def run(self) -> dict[str, Any]:
        """All steps that are left; what is committed, or would be (``dry_run``)."""
        survey = self._survey()
        if self._state.read("check") is None or not self._runs_done() or self._settings.another_run:
            with alone(self._settings.pad.spool):
                ports = [AnchorPort.of(anchor) for anchor in self._settings.pad.anchors]
                async with open_nodes(ports, self._clock) as nodes:
                    await self._check(nodes, survey)
                    if not self._runs_done() or self._settings.another_run:
                        await self._calibration_run(nodes, survey)
        record, found = self._fit(survey)
        self._dialogue.show_result(found)
        return {"go": found.go, **await self._publish(record)}

    # --- 1. survey -------------------------------------------------------------------------------------------------

    def _survey(self) -> Survey:
        kept = self._state.read("survey")
        self._dialogue.step(1, "Survey", "where the anchors stand")
        if kept is not None:
            survey = _survey_from(kept)
            self._dialogue.say(f"{len(survey.anchors)} anchors, as read before (--redo survey reads them again).")
            return survey
        options = self._settings
        survey = load_survey(options.anchors, origin=options.origin, crs=options.crs, control=options.control)
        ports = {anchor.anchor_id for anchor in options.pad.anchors}
        names = {anchor.anchor_id for anchor in survey.anchors}
        if ports != names:
            missing = sorted(ports ^ names)
            raise SurveyError(f"{', '.join(missing)}: in pad.toml or in the survey, but not in both")
        for anchor in survey.anchors:
            x, y, z = anchor.place_m
            sigma = anchor.sigma_m * 1000
            self._dialogue.say(f"{anchor.anchor_id}: {x:+.3f} {y:+.3f} {z:+.3f} m, ±{sigma:.0f} mm, {anchor.mac:04x}")
        for _, text in survey.notes:
            self._dialogue.warn(text)
        if survey.frame is None:
            raise SurveyError(UNTIED)
        self._state.write("survey", _survey_json(survey))
        return survey

    # --- 2. check --------------------------------------------------------------------------------------------------

    async def _check(self, nodes: dict[str, UwbNode], survey: Survey) -> None:
        self._dialogue.step(2, "Check", "the anchors range each other, to compare with the survey")
        kept = self._state.read("check")
        mark = fingerprint(_survey_json(survey))
        if kept is not None and kept.get("survey") == mark:
            self._dialogue.say("Done before (--redo check does it again).")
            return
        macs = {anchor.anchor_id: anchor.mac for anchor in survey.anchors}
        ranges = await measure_between(
            nodes, macs, rounds=self._settings.check_rounds, region=self._settings.pad.uwb.region
        )
        baseline = Baseline.of(ranges, t_ms=self._clock(), source="commissioning")
        if not baseline.pairs:
            raise RadioError("no anchor hears another; are their macs those of the survey, and nothing between them?")
        found = check_survey(survey, {pair: value.range_mm / 1000 for pair, value in baseline.pairs.items()})
        self._dialogue.show_check(found)
        if not found.agrees and not self._dialogue.confirm("Go on with a survey that its own anchors contradict?"):
            raise SurveyError("survey and ranges between the anchors disagree; survey the anchor named above again")
        self._state.write(
            "check",
            {
                "survey": mark,
                "agrees": found.agrees,
                "rows": [
                    {
                        "anchor_id": item.anchor_id,
                        "off_m": item.off_m,
                        "sigma_m": item.sigma_m,
                        "suspect": found.suspect is not None and item.anchor_id == found.suspect.anchor_id,
                    }
                    for item in found.anchors
                ],
                "baseline": baseline.to_json(),
            },
        )

    # --- 3. run ----------------------------------------------------------------------------------------------------

    def _runs_done(self) -> bool:
        return self._state.read("run") is not None and bool(self._state.runs())

    async def _calibration_run(self, nodes: dict[str, UwbNode], survey: Survey) -> None:
        self._dialogue.step(3, "Calibration run", "the drone is moved about while a reference says where it is")
        settings = self._settings
        macs = {anchor.anchor_id: anchor.mac for anchor in survey.anchors}
        ability = recorded_ability(settings.pad, {name: nodes[name].capabilities for name in macs})
        self._state.write("nodes", {} if ability is None else ability.to_json())
        plan = TagPlan(
            macs=macs,
            tag_mac=settings.tag_mac,
            session_id=int.from_bytes(secrets.token_bytes(4), "little") | 1,
            key=secrets.token_bytes(16),
            interval_ms=settings.run_interval_ms,
            region=settings.pad.uwb.region,
        ).among(common_to(nodes.values(), settings.pad.uwb.region))
        if not settings.tag_port:
            key_file = settings.state / KEY_FILE
            write_atomic(key_file, plan.key.hex().encode() + b"\n", PRIVATE)
            self._dialogue.say(f"Where the tag hangs, with a copy of {key_file}:\n  {plan.command(key_file)}")
        if settings.reference_live is None and settings.reference_file is None:
            self._dialogue.warn("No --reference: record it elsewhere on this clock, and give the file afterwards.")
        ranges, reference = self._state.next_run()
        self.stop.clear()
        started_ms = self._clock()
        stamps = time_stamps_of(ranges)
        with RunRecorder(
            *(ranges, reference, stamps, tuple(macs), middle_of(survey.places_m), plan.interval_ms),
            measured_ago_ms=plan.measured_ago_ms,
        ) as recorder:
            async with self._tag() as tag, self._reference(survey.frame, recorder) as live:
                ranging = asyncio.create_task(run(nodes, tag, plan, recorder, self.stop))
                self.recording = True
                try:
                    while not ranging.done():
                        await asyncio.wait({ranging}, timeout=SHOW_S)
                        seconds = (self._clock() - started_ms) / 1000
                        problem = "" if live is None else live.problem
                        self._dialogue.progress(recorder, seconds, settings.reach_m, problem)
                        if settings.seconds and seconds >= settings.seconds:
                            self.stop.set()
                    ranging.result()
                finally:
                    self.recording = False
                    self.stop.set()
                    await asyncio.gather(ranging, return_exceptions=True)
        if recorder.stamps == 0:
            stamps.unlink()
            why = recorder.no_stamps or "none arrived"
            self._dialogue.warn(
                f"No time stamps of blinks ({why}): assurance 2 is the most, as the clocks stay unknown."
            )
        if recorder.coverage.rounds == 0:
            ranges.unlink()
            reference.unlink()
            stamps.unlink(missing_ok=True)
            raise RadioError("no range to the tag arrived; does it range, with the key and the addresses told above?")
        if recorder.positions == 0:
            reference.unlink()
        self._state.write("run", {"runs": [path.name for path in self._state.runs()], "live": recorder.positions > 0})

    @contextlib.asynccontextmanager
    async def _tag(self) -> AsyncIterator[UwbNode | None]:
        if not self._settings.tag_port:
            yield None
            return
        async with UwbNode(self._settings.tag_port, name="tag", clock=self._clock) as node:
            yield node

    @contextlib.asynccontextmanager
    async def _reference(self, frame: Frame | None, recorder: RunRecorder) -> AsyncIterator[Live | None]:
        if self._settings.reference_live is None:
            yield None
            return
        async with self._opened(self._settings.reference_live, frame, recorder) as live:
            self.reference_address = live.address
            try:
                yield live
            finally:
                self.reference_address = None

    @contextlib.asynccontextmanager
    async def _opened(self, source: Source, frame: Frame | None, recorder: RunRecorder) -> AsyncIterator[Live]:
        try:
            async with source.open(None if frame is None else partial(_place_of, frame), recorder, self._clock) as live:
                yield live
        except SourceError as error:
            raise RadioError(str(error)) from error

    # --- 4. fit ----------------------------------------------------------------------------------------------------

    def _fit(self, survey: Survey) -> tuple[Commissioning, Calibrated]:
        self._dialogue.step(4, "Fit", "bias tables, their uncertainty, and what the pad can verify")
        settings = self._settings
        runs = self._state.runs()
        kept = self._state.references()
        if settings.reference_file is not None:
            references = [settings.reference_file] * len(runs)
        elif len(kept) == len(runs):
            references = kept
        else:
            raise CommissioningError(
                f"{len(runs)} runs are kept in {settings.state}, but not where the drone was; give --reference FILE "
                "and call this again: it goes on from here"
            )
        stamps = [path for path in map(time_stamps_of, runs) if path.exists()]
        files = [
            Files(path, reference, time_stamps_of(path) if time_stamps_of(path) in stamps else None)
            for path, reference in zip(runs, references, strict=True)
        ]
        try:
            found = self._calibrated(files, survey)
        except ClockError as error:
            self._dialogue.warn(f"The clocks stay unknown, and assurance 2 is the most: {error}.")
            found = self._calibrated([replace(each, time_stamps=None) for each in files], survey)
        mark = fingerprint([path.name + str(path.stat().st_size) for path in (*runs, *stamps)] + [_survey_json(survey)])
        before = self._state.read("fit")
        target = settings.state / "commissioning.json"
        record = found.record
        if before is not None and before.get("inputs") == mark and target.exists():
            # The same inputs: keep the record as it is, so that publishing again publishes the same.
            record = Commissioning.decode(target.read_bytes())
        else:
            nodes = self._state.read("nodes")
            record = replace(record, nodes=NodeAbility.parse(nodes) if nodes else None)
            write_record(target, record)
        shown = fingerprint([mark, settings.buffer_m, settings.height_m])
        if before is None or before.get("shown") != shown or not (settings.state / "report.html").exists():
            write_json(settings.state / "findings.json", found.document())
            self._report(found)
            self._state.write("fit", {"inputs": mark, "shown": shown, "truth_shift_s": found.shift_s})
        return record, found

    def _calibrated(self, files: list[Files], survey: Survey) -> Calibrated:
        settings = self._settings
        return calibrate_runs(
            files,
            survey,
            now_ms=self._clock(),
            truth_shift_s=settings.truth_shift_s,
            truth_raise_m=settings.truth_raise_m,
            fit=settings.fit,
            buffer_m=settings.buffer_m,
            height_m=settings.height_m,
            valid_days=settings.valid_days,
        )

    def _report(self, found: Calibrated) -> None:
        from wonderland_edge_agent.commissioning.report import write_report  # noqa: PLC0415 - loads Matplotlib

        check = self._state.read("check") or {}
        where = write_report(
            self._settings.state / "report.html",
            found.fit,
            found.record,
            found.reaches,
            found.map,
            title=f"Commissioning of {self._settings.pad.pad_id}",
            survey=check.get("rows", ()),
            by_distance=found.by_distance,
            clocks=found.clocks,
            timed_reaches=found.timed_reaches,
            height_reaches=found.height_reaches,
        )
        self._dialogue.say(f"The report is in {where}.")

    # --- 5. publish ------------------------------------------------------------------------------------------------

    async def _publish(self, record: Commissioning) -> dict[str, Any]:
        self._dialogue.step(5, "Publish", "CommissionPad on the ledger")
        settings = self._settings
        if settings.dry_run or settings.operator is None:
            self._dialogue.say("Nothing is sent (--dry-run); the record is in commissioning.json.")
            return {"published": False, "commissioning": str(settings.state / "commissioning.json")}
        if not self._dialogue.confirm(PUBLISH_QUESTION.format(settings.pad.pad_id)):
            return {"published": False, "commissioning": str(settings.state / "commissioning.json")}
        done = await publish(settings.operator, settings.pad.pad_id, record)
        self._state.write("publish", done)
        check = self._state.read("check") or {}
        if "baseline" in check:
            Baseline.parse(check["baseline"]).save(settings.pad.baseline_file, done["commissioning_sha256"])
        self._dialogue.say(f"Committed in block {done['block']}." if done["tx_id"] else "The ledger has it already.")
        return {"published": True, **done}


def check_survey(survey: Survey, ranges_m: dict[tuple[str, str], float], sigma_m: float = 0.01) -> SelfSurvey:
    """The survey against ranges between the anchors."""
    priors = Priors(place_m={anchor.anchor_id: anchor.sigma_m for anchor in survey.anchors})
    return self_survey(survey.places_m, ranges_m, sigma_m=sigma_m, priors=priors)


def _survey_json(survey: Survey) -> dict[str, Any]:
    return {
        "anchors": [[a.anchor_id, list(a.place_m), a.sigma_m, a.mac] for a in survey.anchors],
        "frame": None if survey.frame is None else survey.frame.to_json(),
        "notes": [list(note) for note in survey.notes],
    }


def _survey_from(value: dict[str, Any]) -> Survey:
    try:
        anchors = tuple(SurveyedAnchor(n, (p[0], p[1], p[2]), s, m) for n, p, s, m in value["anchors"])
        frame = None if value["frame"] is None else Frame.parse(value["frame"])
        notes = tuple((code, text) for code, text in value["notes"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise StateError(f"survey.json: holds no survey ({error}); --redo survey reads it again") from error
    return Survey(anchors, frame, notes)


def _place_of(frame: Frame, place: Point) -> Point:
    try:
        return local_of(frame, place, "reference")
    except SurveyError as error:
        raise PositionError(str(error)) from error
