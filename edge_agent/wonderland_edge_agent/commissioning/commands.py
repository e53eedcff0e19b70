"""``wonderland pad commission``: from recordings, or step by step at a live pad."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from wonderland_edge_agent.commissioning.live.wizard import LiveSettings, Wizard
    from wonderland_edge_agent.commissioning.offline import Calibrated, OfflineSettings

NO_GO: Final = 3
"""Exit code of a pad that verifies the buffer asked for nowhere."""
_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


def _shift(_: click.Context, __: click.Parameter, value: str | None) -> float | str | None:
    """Seconds, ``auto``, or None where it was not given."""
    if value is None or value == "auto":
        return value
    try:
        seconds = float(value)
    except ValueError:
        raise click.BadParameter(f"{value!r} is neither a number of seconds nor auto") from None
    if not -10.0 <= seconds <= 10.0:
        raise click.BadParameter("within 10 seconds of the ranges; bring the clocks together first")
    return seconds


class _Within(click.FloatRange):
    """A range that nan is outside of as well."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number. Fails with what was wrong."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is no finite number", param, ctx)
        return number


def _metres(name: str, default: float, least: float, most: float, text: str) -> Callable[[Any], Any]:
    kind = _Within(least, most)
    return click.option(name, default=default, show_default=True, type=kind, metavar="M", help=text)


@click.command()
@click.option("--recording", "recordings", multiple=True, type=_FILE, metavar="CSV", help="Ranges; may be repeated.")
@click.option(
    "--time-stamps",
    multiple=True,
    type=_FILE,
    metavar="CSV",
    help="Of blinks, for assurance 3; one for each --recording, in the same order.",
)
@click.option("--anchors", required=True, type=_FILE, metavar="CSV|TOML", help="The survey of the anchors.")
@click.option("--config", type=_FILE, metavar="TOML", help="Live: the pad's settings (pad.toml).")
@click.option("--state", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", help="Live: kept steps.")
@click.option("--reference", metavar="CSV|udp:HOST:PORT", help="The truth, where it is not in the recording.")
@click.option("--truth-shift", callback=_shift, metavar="S|auto", help="The truth of t is at t + S. Live: auto.")
@_metres("--truth-raise", 0.0, -1_000.0, 1_000.0, "Metres to add to the truth's height.")
@_metres("--reference-sigma", 0.01, 0.0, 1.0, "How well the truth is known.")
@_metres("--installation-sigma", 0.0, 0.0, 1.0, "Common bias that no run shows: 0.06 if anchors are mounted anew.")
@click.option("--origin", metavar="LAT,LON,HEIGHT", help="Where the pad's frame stands (degrees, metres).")
@click.option("--crs", default="", metavar="EPSG:N", help="The survey's x, y, z are of this map projection.")
@click.option("--control", type=_FILE, metavar="CSV", help="Points known in a total station's frame and on the globe.")
@click.option("--tag-port", default="", metavar="PORT", help="Live: the drone's node, if it hangs on this computer.")
@click.option("--tag-mac", default="d001", show_default=True, metavar="HEX", help="Live: the drone's node's address.")
@_metres("--reach", 20.0, 4.0, 100.0, "Live: how far out the drone will be carried.")
@click.option("--seconds", default=0.0, type=click.FloatRange(0.0), metavar="S", help="Live: end the run by itself.")
@click.option("--another-run", is_flag=True, help="Live: add one more run, as of another day.")
@click.option("--redo", default="", metavar="STEP", help="Live: do survey, check, run, fit or publish again.")
@click.option("--identity", default="pad_operator", show_default=True, help="Live: who publishes (connection.json).")
@click.option("--register", default="", metavar="NAME", help="Live: register the pad by this name, if it is not yet.")
@click.option("--operator-id", default="", metavar="ID", help="Live: with --register, who operates the pad.")
@click.option("--yes", is_flag=True, help="Live: publish without asking.")
@click.option("--dry-run", is_flag=True, help="Live: everything but the transaction.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), metavar="JSON", help="The record goes here.")
@click.option("--report", type=click.Path(path_type=Path), metavar="HTML|DIR", help="A report with plots goes here.")
@_metres("--buffer", 1.0, 0.1, 100.0, "Buffer of the go/no-go map.")
@_metres("--height", 3.0, 0.0, 120.0, "Height of drones for the go/no-go.")
@click.option("--valid-days", default=365, show_default=True, type=click.IntRange(1, 3650), help="How long it holds.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")
def commission(*, config: Path | None, state: Path | None, **options: Any) -> None:
    """Find how far off each anchor's ranges are, how well that is known, and what the pad can verify with it.

    \b
    From a recording, without a live pad:
      wonderland pad commission --recording ranges.csv --anchors anchors.csv --out commissioning.json
      wonderland evaluate --recording other.csv --anchors anchors.csv --commissioning commissioning.json
    The recording has a row for each range: t, anchor, range, gt_x, gt_y, gt_z (s and m). Several recordings, of
    different days, also show what changes between them. Time stamps of blinks in the same runs (--time-stamps: t,
    anchor, blink, ticks) calibrate the clocks, too.

    \b
    At a pad, step by step (survey, check, run, fit, publish); it goes on where it was interrupted:
      wonderland pad commission --config pad.toml --state ./commissioning --anchors survey.csv \\
          --origin 60.4503,22.2712,31.0 --reference udp:0.0.0.0:5490
    The reference is one JSON datagram for each position (x, y, z or lat, lon, height), or a file that is given
    afterwards: columns t, x, y, z or t, lat, lon, height, a ROS pose, or an export of Motive.

    \b
    Exit code:
      0  go: the pad verifies --buffer, at some distances in every direction
      1  nothing was commissioned: what was given teaches nothing, or the ledger refused it
      2  options that mean nothing
      3  no-go: fitted (and published, at a live pad, if that was confirmed), but it verifies --buffer nowhere
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    try:
        from wonderland_edge_agent.commissioning.errors import CommissioningError  # noqa: PLC0415 - needs the extra
        from wonderland_edge_agent.settings import SettingsError  # noqa: PLC0415

        try:
            if config is None and state is None:
                _from_recordings(**options)
            elif config is None or state is None:
                raise click.UsageError("at a live pad both --config and --state are needed")
            else:
                _at_the_pad(config, state, **options)
        except (CommissioningError, SettingsError) as error:
            raise click.ClickException(str(error)) from error
    except ModuleNotFoundError as error:
        text = f"{error.name} is not installed; calibrating needs it: pip install 'wonderland-edge-agent[commission]'"
        raise click.ClickException(text) from error


def _from_recordings(*, out: Path | None, report: Path | None, as_json: bool, anchors: Path, **options: Any) -> None:
    from wonderland_edge_agent.commissioning.offline import calibrate, write_record  # noqa: PLC0415 - needs the extra
    from wonderland_edge_agent.commissioning.show import show  # noqa: PLC0415

    live = [name for name in _LIVE_ONLY if options.pop(name) not in _LIVE_ONLY[name]]
    if live:
        raise click.UsageError(
            f"{', '.join('--' + name.replace('_', '-') for name in live)}: only at a live pad (--config)"
        )
    found = calibrate(_offline(anchors=anchors, **options), time.time_ns() // 1_000_000)
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
    if not found.go:
        sys.exit(NO_GO)


_LIVE_ONLY: Final[dict[str, tuple[Any, ...]]] = {
    "tag_port": ("",),
    "tag_mac": ("d001",),
    "reach": (20.0,),
    "seconds": (0.0,),
    "another_run": (False,),
    "redo": ("",),
    "identity": ("pad_operator",),
    "register": ("",),
    "operator_id": ("",),
    "yes": (False,),
    "dry_run": (False,),
}
"""Options that mean something at a live pad only, with their defaults."""


def _at_the_pad(config: Path, state: Path, **options: Any) -> None:
    from rich.console import Console  # noqa: PLC0415

    from wonderland_edge_agent.commissioning.live.terminal import Terminal  # noqa: PLC0415 - needs the extra
    from wonderland_edge_agent.commissioning.live.wizard import Wizard  # noqa: PLC0415

    for name, said in (
        ("recordings", "recording"),
        ("time_stamps", "time-stamps"),
        ("out", "out"),
        ("report", "report"),
    ):
        if options.pop(name):
            raise click.UsageError(f"--{said}: at a live pad everything is kept in --state")
    as_json, yes = options.pop("as_json"), options.pop("yes")
    terminal = Terminal(Console(stderr=as_json, highlight=False), yes=yes)
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
    from wonderland_edge_agent.commissioning.fit import FitSettings  # noqa: PLC0415 - needs the extra
    from wonderland_edge_agent.commissioning.live.publish import Operator  # noqa: PLC0415
    from wonderland_edge_agent.commissioning.live.wizard import LiveSettings  # noqa: PLC0415
    from wonderland_edge_agent.commissioning.survey_files import parse_origin  # noqa: PLC0415
    from wonderland_edge_agent.settings import load  # noqa: PLC0415

    pad = load(config)
    if pad.reports_listen is not None:
        raise click.UsageError(
            "this pad has DWM1001 anchors, which report nothing here; commission it from a recording"
        )
    try:
        mac = int(tag_mac, 16)
    except ValueError:
        raise click.UsageError(f"--tag-mac {tag_mac!r}: up to four hexadecimal digits") from None
    listen, file = _reference(reference)
    return LiveSettings(
        pad=pad,
        state=state,
        anchors=anchors,
        origin=None if origin is None else parse_origin(origin),
        tag_mac=mac,
        reference_listen=listen,
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


def _reference(text: str | None) -> tuple[tuple[str, int] | None, Path | None]:
    if text is None:
        return None, None
    if not text.startswith("udp:"):
        path = Path(text)
        if not path.is_file():
            raise click.UsageError(f"--reference {text}: there is no such file; live positions are udp:HOST:PORT")
        return None, path
    host, _, port = text[4:].rpartition(":")
    if not (port.isascii() and port.isdigit() and int(port) < 65_536):
        raise click.UsageError(f"--reference {text}: is not udp:HOST:PORT, as udp:0.0.0.0:5490")
    return (host.strip("[]") or "0.0.0.0", int(port)), None  # noqa: S104 - whoever knows the position sends it


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
    from wonderland_edge_agent.commissioning.fit import FitSettings  # noqa: PLC0415 - needs the extra
    from wonderland_edge_agent.commissioning.offline import OfflineSettings  # noqa: PLC0415
    from wonderland_edge_agent.commissioning.survey_files import parse_origin  # noqa: PLC0415

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
