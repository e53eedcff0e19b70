"""What ``wonderland pad commission`` does with its options."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import click

from wonderland.consoles import for_people
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.commissioning.errors import CommissioningError, SurveyError
from wonderland_edge_agent.commissioning.fit import FitSettings
from wonderland_edge_agent.commissioning.live.ask import ask_nodes
from wonderland_edge_agent.commissioning.live.publish import Operator, publish
from wonderland_edge_agent.commissioning.live.terminal import Terminal
from wonderland_edge_agent.commissioning.live.wizard import PUBLISH_QUESTION, UNTIED, LiveSettings, Wizard
from wonderland_edge_agent.commissioning.offline import Calibrated, OfflineSettings, calibrate, write_record
from wonderland_edge_agent.commissioning.show import show
from wonderland_edge_agent.commissioning.survey_files import load_survey, parse_origin
from wonderland_edge_agent.references.sources import FORMS, Source, parse_source
from wonderland_edge_agent.settings import PadSettings, load

NO_GO: Final = 3
"""Exit code of a pad that verifies the buffer asked for nowhere."""


def perform(config: Path | None, state: Path | None, **options: Any) -> None:
    """Calibrate from recordings, or at a live pad. Raises click's exceptions, with texts for people."""
    try:
        if state is None and (config is None or options["recordings"]):
            _from_recordings(config, **options)
        elif config is None or state is None:
            raise click.UsageError("at a live pad both --config and --state are needed, or --config and --recording")
        else:
            _at_the_pad(config, state, **options)
    except (CommissioningError, SettingsError) as error:
        raise click.ClickException(str(error)) from error


def _from_recordings(
    config: Path | None, *, out: Path | None, report: Path | None, as_json: bool, anchors: Path, **options: Any
) -> None:
    """With ``config`` what is found is published for that pad, as at a live one."""
    publishing = {name: options[name] for name in _PUBLISHING}
    live = [name for name, usual in (_LIVE_ONLY | _PUBLISHING).items() if options.pop(name) not in usual]
    if config is not None:
        live = [name for name in live if name not in _PUBLISHING]
    if live:
        raise click.UsageError(
            f"{', '.join('--' + name.replace('_', '-') for name in live)}: only at a live pad (--config)"
        )
    settings = _offline(anchors=anchors, **options)
    pad = None if config is None else _recorded_pad(config, settings)
    found = calibrate(settings, time.time_ns() // 1_000_000)
    if pad is not None:
        found = _with_nodes(pad, found)
    if out is not None:
        write_record(out, found.record)
    where = None if report is None else _report(report, found, anchors.stem)
    if as_json:
        click.echo(json.dumps(found.document()))
    else:
        show(found)
        for path, what in ((out, "The commissioning record"), (where, "The report")):
            if path is not None:
                click.echo(f"{what} is in {path}.")
    if pad is not None:
        _publish(pad, found, as_json=as_json, **publishing)
    if not found.go:
        sys.exit(NO_GO)


def _recorded_pad(config: Path, settings: OfflineSettings) -> PadSettings:
    """The pad that recordings are published for: its survey has the same anchors, and a place on the globe."""
    pad = load(config)
    survey = load_survey(settings.anchors, origin=settings.origin, crs=settings.crs, control=settings.control)
    names = {anchor.anchor_id for anchor in pad.anchors} or set(survey.places_m)
    if differing := sorted(names ^ set(survey.places_m)):
        raise SurveyError(f"{', '.join(differing)}: in pad.toml or in the survey, but not in both")
    if survey.frame is None:
        raise SurveyError(UNTIED)
    return pad


def _with_nodes(pad: PadSettings, found: Calibrated) -> Calibrated:
    """With what the pad's nodes can do on the record: a session's plan follows from it, and no recording tells it."""
    told = asyncio.run(ask_nodes(pad, [anchor.anchor_id for anchor in found.record.anchors]))
    if told.note:
        click.echo(told.note, err=True)
    return replace(found, record=replace(found.record, nodes=told.nodes))


def _publish(
    pad: PadSettings,
    found: Calibrated,
    *,
    as_json: bool,
    identity: str,
    register: str,
    operator_id: str,
    yes: bool,
    dry_run: bool,
) -> None:
    terminal = Terminal(for_people(stderr=as_json), yes=yes)
    try:
        if dry_run or not terminal.confirm(PUBLISH_QUESTION.format(pad.pad_id)):
            terminal.say("Nothing was sent.")
            return
        operator = Operator(connection=pad.connection, identity=identity, register_as=register, operator_id=operator_id)
        done = asyncio.run(publish(operator, pad.pad_id, found.record))
        terminal.say(f"Committed in block {done['block']}." if done["tx_id"] else "The ledger has it already.")
    finally:
        terminal.close()


_LIVE_ONLY: Final[dict[str, tuple[Any, ...]]] = {
    "tag_port": ("",),
    "tag_mac": ("d001",),
    "reach": (20.0,),
    "seconds": (0.0,),
    "another_run": (False,),
    "redo": ("",),
}
"""Options that mean something at a live pad only, with their defaults."""
_PUBLISHING: Final[dict[str, tuple[Any, ...]]] = {
    "identity": ("pad_operator",),
    "register": ("",),
    "operator_id": ("",),
    "yes": (False,),
    "dry_run": (False,),
}
"""The same, where a pad is named to publish for."""


def _at_the_pad(config: Path, state: Path, **options: Any) -> None:

    for name, said in (
        ("recordings", "recording"),
        ("time_stamps", "time-stamps"),
        ("out", "out"),
        ("report", "report"),
    ):
        if options.pop(name):
            raise click.UsageError(f"--{said}: at a live pad everything is kept in --state")
    as_json, yes = options.pop("as_json"), options.pop("yes")
    terminal = Terminal(for_people(stderr=as_json), yes=yes)
    wizard = Wizard(_live(config, state, **options), terminal)
    try:
        done = asyncio.run(_until_stopped(wizard))
    finally:
        terminal.close()
    if as_json:
        click.echo(json.dumps(done))
    if not done["go"]:
        sys.exit(NO_GO)


async def _until_stopped(wizard: Wizard) -> dict[str, Any]:
    """Ctrl-C ends a run that is under way; a second one ends the command, and everything found so far is kept."""
    loop = asyncio.get_running_loop()
    working = asyncio.ensure_future(wizard.run())

    def interrupted() -> None:
        if wizard.recording and not wizard.stop.is_set():
            wizard.stop.set()
        else:
            working.cancel()

    loop.add_signal_handler(signal.SIGINT, interrupted)
    loop.add_signal_handler(signal.SIGTERM, working.cancel)
    try:
        return await working
    except asyncio.CancelledError:
        raise click.ClickException("stopped; what was found so far is kept, call it again to go on") from None


def _live(
    config: Path,
    state: Path,
    *,
    anchors: Path,
    reference: str | None,
    truth_shift: float | str | None,
    truth_raise: float,
    reference_sigma: float,
    installation_sigma: float,
    origin: str | None,
    tag_mac: str,
    reach: float,
    identity: str,
    register: str,
    operator_id: str,
    buffer: float,
    height: float,
    **same: Any,
) -> LiveSettings:

    pad = load(config)
    if pad.uwb.listen is not None:
        raise click.UsageError(
            "this pad has DWM1001 boards: record what they measure (wonderland uwb record), and give --recording FILE "
            "in place of --state"
        )
    try:
        mac = int(tag_mac, 16)
    except ValueError:
        raise click.UsageError(f"--tag-mac {tag_mac!r}: up to four hexadecimal digits") from None
    live, file = _reference(reference)
    return LiveSettings(
        pad=pad,
        state=state,
        anchors=anchors,
        origin=None if origin is None else parse_origin(origin),
        tag_mac=mac,
        reference_live=live,
        reference_file=file,
        reach_m=reach,
        truth_shift_s=None if truth_shift in {None, "auto"} else float(truth_shift or 0.0),
        truth_raise_m=truth_raise,
        fit=FitSettings(reference_sigma, installation_sigma),
        buffer_m=buffer,
        height_m=height,
        operator=Operator(connection=pad.connection, identity=identity, register_as=register, operator_id=operator_id),
        **same,
    )


def _reference(text: str | None) -> tuple[Source | None, Path | None]:
    if text is None:
        return None, None
    try:
        source = parse_source(text)
    except ValueError as error:
        raise click.UsageError(f"--reference {error}") from None
    if source is not None:
        return source, None
    path = Path(text)
    if not path.is_file():
        raise click.UsageError(f"--reference {text}: there is no such file; give {FORMS}")
    return None, path


def _offline(
    *,
    recordings: tuple[Path, ...],
    reference: str | None,
    truth_shift: float | str | None,
    truth_raise: float,
    reference_sigma: float,
    installation_sigma: float,
    origin: str | None,
    buffer: float,
    height: float,
    **same: Any,
) -> OfflineSettings:

    if not recordings:
        raise click.UsageError("give at least one --recording, or --config and --state at a live pad")
    live, file = _reference(reference)
    if live is not None:
        raise click.UsageError("--reference: a recording's truth is in a file")
    return OfflineSettings(
        recordings=recordings,
        reference=file,
        truth_shift_s=None if truth_shift == "auto" else float(truth_shift or 0.0),
        truth_raise_m=truth_raise,
        fit=FitSettings(reference_sigma, installation_sigma),
        origin=None if origin is None else parse_origin(origin),
        buffer_m=buffer,
        height_m=height,
        **same,
    )


def _report(path: Path, found: Calibrated, name: str) -> Path:
    from wonderland_edge_agent.commissioning.report import write_report  # noqa: PLC0415 - loads Matplotlib

    return write_report(
        path,
        found.fit,
        found.record,
        found.reaches,
        found.map,
        title=f"Calibration of {name}",
        by_distance=found.by_distance,
        clocks=found.clocks,
        timed_reaches=found.timed_reaches,
        height_reaches=found.height_reaches,
    )
