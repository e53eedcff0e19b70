"""The command ``wonderland evaluate``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import click

from wonderland_edge_agent.commissioning.commands import shift_of

_T = TypeVar("_T")
_CSV = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.option(
    "--recording", "recordings", required=True, multiple=True, type=_CSV, metavar="CSV", help="Ranges; may be repeated."
)
@click.option(
    "--anchors",
    required=True,
    multiple=True,
    type=_CSV,
    metavar="CSV",
    help="Anchors: columns anchor, x, y, z (m). One for all recordings, or one for each.",
)
@click.option(
    "--commissioning",
    "commissionings",
    multiple=True,
    type=_CSV,
    metavar="JSON",
    help="Commissioning record of these anchors, one for all or each; without: what is known of uncalibrated DW1000.",
)
@click.option(
    "--claim",
    "claims",
    default=("truth",),
    show_default=True,
    multiple=True,
    metavar="truth|offset:E,N,U|csv:FILE",
    help="What the drone claims: the truth, the truth and an error (m), or a file with columns t, x, y, z; for each.",
)
@click.option(
    "--reference",
    "references",
    multiple=True,
    type=_CSV,
    metavar="CSV",
    help="The truth, where it is not in the recording: a track as `pad commission --reference` and [truth] record have "
    "it, one for all or each.",
)
@click.option(
    "--truth-shift",
    default="0",
    callback=shift_of,
    metavar="S|auto",
    help="The truth of a range at t is the one at t + S seconds; auto: found from the ranges.",
)
@click.option("--truth-raise", default=0.0, metavar="M", help="Metres to add to the truth's height.")
@click.option("--rounds", default=20, show_default=True, type=click.IntRange(1, 500), help="Rounds of a window.")
@click.option("--windows", default=0, type=click.IntRange(0), metavar="N", help="Stop after N windows (0: never).")
@click.option(
    "--buffer", default=1.0, show_default=True, type=click.FloatRange(0.1, 100.0), metavar="M", help="Buffer."
)
@click.option("--report", type=click.Path(path_type=Path), metavar="DIR", help="Drawings (PNG) and a page go here.")
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each window on standard output.")
def evaluate(
    *,
    recordings: tuple[Path, ...],
    anchors: tuple[Path, ...],
    commissionings: tuple[Path, ...],
    claims: tuple[str, ...],
    references: tuple[Path, ...],
    truth_shift: float | str | None,
    truth_raise: float,
    rounds: int,
    windows: int,
    buffer: float,
    report: Path | None,
    as_json: bool,
) -> None:
    """Judge recordings with the contract's own function, window by window; no radio and no ledger takes part.

    \b
    wonderland evaluate --recording ranges.csv --anchors anchors.csv
    wonderland evaluate --recording ranges.csv --anchors anchors.csv --claim offset:2,0,0 --json
    wonderland evaluate --recording ranges.csv --anchors anchors.csv --claim csv:claims.csv --report DIR
    wonderland evaluate --recording ranges.csv --anchors anchors.csv --reference track.csv --truth-shift auto
    A recording needs no truth (gt_x, gt_y, gt_z, or --reference) where the claims are in a file of their own.

    \b
    Exit code:
      0  at least one window has an estimate, whatever the outcomes
      1  files or options that cannot be read, or not one whole window
      3  windows were judged, and none has an estimate (no ranges at the times of the claims, a claim far away, …)
      4  no window was settled, and nobody calibrated the anchors: commission first (the command is told)
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    from wonderland_research.evaluate import EvaluateSettings  # noqa: PLC0415 - --help must not load the world
    from wonderland_research.evaluate_output import run  # noqa: PLC0415
    from wonderland_simulator.recording import RecordingError  # noqa: PLC0415

    count = len(recordings)
    shift_s = None if truth_shift == "auto" else float(truth_shift or 0.0)
    settings = [
        EvaluateSettings(one, places, record, claim, shift_s, truth_raise, rounds, windows, buffer, reference)
        for one, places, record, claim, reference in zip(
            recordings,
            _each("anchors", anchors, count),
            _each("commissioning", commissionings or (None,), count),
            _each("claim", claims, count),
            _each("reference", references or (None,), count),
            strict=True,
        )
    ]
    try:
        sys.exit(run(settings, as_json=as_json, report=report))
    except RecordingError as error:
        raise click.ClickException(str(error)) from error
    except ModuleNotFoundError as error:
        text = f"{error.name} is not installed; a report needs it: pip install 'wonderland-edge-agent[commission]'"
        raise click.ClickException(text) from error
    except KeyboardInterrupt:
        sys.exit(130)


def _each(name: str, given: Sequence[_T], count: int) -> Sequence[_T]:
    """One for every recording, where one was given for all."""
    if len(given) == 1:
        return [given[0]] * count
    if len(given) != count:
        raise click.UsageError(f"{len(given)} --{name} for {count} recordings: give one for all, or one for each")
    return given
