"""``wonderland pad commission``: from recordings, or step by step at a live pad."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


def shift_of(_: click.Context, __: click.Parameter, value: str | None) -> float | str | None:
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
@click.option("--config", type=_FILE, metavar="TOML", help="The pad's settings (pad.toml).")
@click.option("--state", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", help="Live: kept steps.")
@click.option(
    "--reference",
    metavar="CSV|udp:…|natnet:…|ros2:…",
    help="The truth, where it is not in the recording: a file; live, positions that come to udp:HOST:PORT, a rigid "
    "body of Motive (natnet:HOST[#BODY]), or a PoseStamped (ros2:/TOPIC).",
)
@click.option("--truth-shift", callback=shift_of, metavar="S|auto", help="The truth of t is at t + S. Live: auto.")
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
@click.option("--identity", default="pad_operator", show_default=True, help="Who publishes (connection.json).")
@click.option("--register", default="", metavar="NAME", help="Register the pad by this name, if it is not yet.")
@click.option("--operator-id", default="", metavar="ID", help="With --register, who operates the pad.")
@click.option("--yes", is_flag=True, help="Publish without asking.")
@click.option("--dry-run", is_flag=True, help="Everything but the transaction.")
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
    anchor, blink, ticks) calibrate the clocks, too. With --config pad.toml the record is published for that pad.

    \b
    At a pad, step by step (survey, check, run, fit, publish); it goes on where it was interrupted:
      wonderland pad commission --config pad.toml --state ./commissioning --anchors survey.csv \\
          --origin 60.4503,22.2712,31.0 --reference udp:0.0.0.0:5490
    The reference is one JSON datagram for each position (x, y, z or lat, lon, height), or a file that is given
    afterwards: columns t, x, y, z or t, lat, lon, height, a ROS pose, or an export of Motive.
    DWM1001 boards are recorded (wonderland uwb record) and published from the recording.

    \b
    Exit code:
      0  go: the pad verifies --buffer, at some distances in every direction
      1  nothing was commissioned: what was given teaches nothing, or the ledger refused it
      2  options that mean nothing
      3  no-go: fitted (and published, with --config, if that was confirmed), but it verifies --buffer nowhere
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    try:
        from wonderland_edge_agent.commissioning.perform import perform  # noqa: PLC0415 - help is there without the extra
    except ModuleNotFoundError as error:
        text = f"{error.name} is not installed; calibrating needs it: pip install 'wonderland-edge-agent[commission]'"
        raise click.ClickException(text) from error
    perform(config, state, **options)
