"""The command ``wonderland evaluate``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

_CSV = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.option("--recording", required=True, type=_CSV, metavar="CSV", help="Ranges with truth, as for simulate.")
@click.option("--anchors", required=True, type=_CSV, metavar="CSV", help="Anchors: columns anchor, x, y, z (m).")
@click.option(
    "--commissioning",
    type=_CSV,
    metavar="JSON",
    help="Commissioning record of these anchors; otherwise what is known of uncalibrated DW1000 anchors.",
)
@click.option(
    "--claim",
    default="truth",
    show_default=True,
    metavar="truth|offset:E,N,U|csv:FILE",
    help="What the drone claims: the truth, the truth and an error (m), or a file with columns t, x, y, z.",
)
@click.option("--truth-shift", default=0.0, metavar="S", help="The truth of a range at t is the one at t + S seconds.")
@click.option("--truth-raise", default=0.0, metavar="M", help="Metres to add to the truth's height.")
@click.option("--rounds", default=20, show_default=True, type=click.IntRange(1, 500), help="Rounds of a window.")
@click.option("--windows", default=0, type=click.IntRange(0), metavar="N", help="Stop after N windows (0: never).")
@click.option(
    "--buffer", default=1.0, show_default=True, type=click.FloatRange(0.1, 100.0), metavar="M", help="Buffer."
)
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each window on standard output.")
def evaluate(
    *,
    recording: Path,
    anchors: Path,
    commissioning: Path | None,
    claim: str,
    truth_shift: float,
    truth_raise: float,
    rounds: int,
    windows: int,
    buffer: float,
    as_json: bool,
) -> None:
    """Judge a recording with the contract's own function, window by window; no radio and no ledger takes part.

    \b
    wonderland evaluate --recording ranges.csv --anchors anchors.csv
    wonderland evaluate --recording ranges.csv --anchors anchors.csv --claim offset:2,0,0 --json

    \b
    Exit code:
      0  at least one window has an estimate, whatever the outcomes
      1  files or options that cannot be read, or not one whole window
      3  windows were judged, and none has an estimate (no ranges at the times of the claims, a claim far away, …)
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    from simulator.evaluate import EvaluateSettings, run  # noqa: PLC0415 - --help must not load the world
    from simulator.recording import RecordingError  # noqa: PLC0415

    settings = EvaluateSettings(
        recording, anchors, commissioning, claim, truth_shift, truth_raise, rounds, windows, buffer, as_json
    )
    try:
        sys.exit(run(settings))
    except RecordingError as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        sys.exit(130)
