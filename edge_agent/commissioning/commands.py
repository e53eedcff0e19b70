"""``wonderland pad commission``: from recordings, or step by step at a live pad."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from edge_agent.commissioning.offline import Calibrated, OfflineSettings

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


def _shift(_: click.Context, __: click.Parameter, value: str) -> float | None:
    """Seconds; None for ``auto``."""
    if value == "auto":
        return None
    try:
        seconds = float(value)
    except ValueError:
        raise click.BadParameter(f"{value!r} is neither a number of seconds nor auto") from None
    if not -10.0 <= seconds <= 10.0:
        raise click.BadParameter("within 10 seconds of the ranges; bring the clocks together first")
    return seconds


def _metres(name: str, default: float, least: float, most: float, text: str) -> Callable[[Any], Any]:
    kind = click.FloatRange(least, most)
    return click.option(name, default=default, show_default=True, type=kind, metavar="M", help=text)


@click.command()
@click.option("--recording", "recordings", multiple=True, type=_FILE, metavar="CSV", help="Ranges; may be repeated.")
@click.option("--anchors", required=True, type=_FILE, metavar="CSV|TOML", help="The survey of the anchors.")
@click.option("--reference", type=_FILE, metavar="CSV", help="The truth, where it is not in the recording.")
@click.option(
    "--truth-shift",
    default="0",
    callback=_shift,
    metavar="S|auto",
    help="The truth of a range at t is at t + S; auto finds S.",
)
@click.option("--truth-raise", default=0.0, metavar="M", help="Metres to add to the truth's height.")
@_metres("--reference-sigma", 0.01, 0.0, 1.0, "How well the truth is known.")
@_metres("--installation-sigma", 0.0, 0.0, 1.0, "Common bias that no run shows: 0.06 if anchors are mounted anew.")
@click.option("--origin", metavar="LAT,LON,HEIGHT", help="Where the pad's frame stands (degrees, metres).")
@click.option("--crs", default="", metavar="EPSG:N", help="The survey's x, y, z are of this map projection.")
@click.option("--control", type=_FILE, metavar="CSV", help="Points known in a total station's frame and on the globe.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), metavar="JSON", help="The record goes here.")
@click.option("--report", type=click.Path(path_type=Path), metavar="HTML|DIR", help="A report with plots goes here.")
@_metres("--buffer", 1.0, 0.1, 100.0, "Buffer of the go/no-go map.")
@_metres("--height", 3.0, 0.0, 120.0, "Height of drones for the go/no-go.")
@click.option("--valid-days", default=365, show_default=True, type=click.IntRange(1, 3650), help="How long it holds.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")
def commission(*, out: Path | None, report: Path | None, as_json: bool, **options: Any) -> None:
    """Find how far off each anchor's ranges are, how well that is known, and what the pad can verify with it.

    \b
    From a recording, without a live pad:
      wonderland pad commission --recording ranges.csv --anchors anchors.csv --out commissioning.json
      wonderland evaluate --recording other.csv --anchors anchors.csv --commissioning commissioning.json

    The recording has a row for each range: t, anchor, range, gt_x, gt_y, gt_z (s and m). Several recordings, of
    different days, also show what changes between them.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    try:
        from edge_agent.commissioning.errors import CommissioningError  # noqa: PLC0415 - needs the extra
        from edge_agent.commissioning.offline import calibrate, write_record  # noqa: PLC0415
        from edge_agent.commissioning.show import show  # noqa: PLC0415
    except ModuleNotFoundError as error:
        text = f"{error.name} is not installed; calibrating needs an extra: pip install 'wonderland-pol[commission]'"
        raise click.ClickException(text) from error
    try:
        found = calibrate(_offline(**options), time.time_ns() // 1_000_000)
        if out is not None:
            write_record(out, found.record)
        where = None if report is None else _report(report, found, options["anchors"].stem)
    except CommissioningError as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(found.document()))
        return
    show(found)
    for path, what in ((out, "The commissioning record"), (where, "The report")):
        if path is not None:
            click.echo(f"{what} is in {path}.")


def _offline(
    *,
    recordings: tuple[Path, ...],
    truth_shift: float | None,
    truth_raise: float,
    reference_sigma: float,
    installation_sigma: float,
    origin: str | None,
    buffer: float,
    height: float,
    **same: Any,
) -> OfflineSettings:
    from edge_agent.commissioning.fit import FitSettings  # noqa: PLC0415 - needs the extra
    from edge_agent.commissioning.offline import OfflineSettings  # noqa: PLC0415
    from edge_agent.commissioning.survey_files import parse_origin  # noqa: PLC0415

    if not recordings:
        raise click.UsageError("give at least one --recording")
    return OfflineSettings(
        recordings=recordings,
        truth_shift_s=truth_shift,
        truth_raise_m=truth_raise,
        fit=FitSettings(reference_sigma, installation_sigma),
        origin=None if origin is None else parse_origin(origin),
        buffer_m=buffer,
        height_m=height,
        **same,
    )


def _report(path: Path, found: Calibrated, name: str) -> Path:
    from edge_agent.commissioning.report import write_report  # noqa: PLC0415 - loads Matplotlib

    return write_report(path, found.fit, found.record, found.reaches, found.map, title=f"Calibration of {name}")
