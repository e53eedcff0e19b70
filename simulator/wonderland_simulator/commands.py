"""``wonderland demo`` and ``simulate``."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

import click

# The demo starts processes while gRPC's threads run; its own fork handlers would only complain about it.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")


@click.command()
@click.option("--headless", is_flag=True, help="No console in the browser; verdicts on the terminal only.")
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each verdict on standard output.")
@click.option("--until", type=click.IntRange(0), default=0, metavar="N", help="Stop after N verdicts (0: never).")
@click.option("--seed", type=int, default=1, show_default=True, help="Same seed, same noise.")
@click.option(
    "--ledger",
    type=click.Choice(["embedded", "fabric"]),
    default="embedded",
    show_default=True,
    help="fabric: a real network of three organisations; needs Fabric's servers in FABRIC_BIN or on PATH.",
)
@click.option(
    "--scenario",
    type=click.Choice(["harbour", "turku"]),
    default="harbour",
    show_default=True,
    help="Where: a harbour town with its map (Monaco), or the Finnish sites.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the console; a free one unless given.")
@click.option(
    "--data",
    "directory",
    type=click.Path(file_okay=False, path_type=Path, resolve_path=True),
    help="Keep ledger, database and logs here; a temporary directory unless given.",
)
def demo(
    *,
    headless: bool,
    as_json: bool,
    until: int,
    seed: int,
    ledger: str,
    scenario: str,
    port: int,
    directory: Path | None,
) -> None:
    """Three landing pads, honest drones and liars, a ledger and a live map, all on this machine.

    Everything is real but the air: drones fly in a simulator, which speaks UCI on pseudo-terminals and broadcasts
    Remote ID on UDP. Of eleven drones six are not to land: one whose GNSS is dragged away, one that broadcasts another
    place than it flies, one that replays an old session, one whose radio falsifies its time stamps, one that lies in
    two of five claims, and one whose maintenance lapsed. One of the five that land is being impersonated.

    \b
    wonderland demo                              the map in your browser
    wonderland demo --headless --json --until 8  one JSON line for each of eight verdicts
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    from wonderland_simulator.demo import DemoSettings, main  # noqa: PLC0415 - --help must not load the world

    sys.exit(main(DemoSettings(headless or as_json, as_json, until, seed, port, directory, ledger, scenario)))


@click.command()
@click.option(
    "--recording",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="CSV",
    help="Ranges with truth: columns t, anchor, range, gt_x, gt_y, gt_z (s, m).",
)
@click.option(
    "--anchors",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="CSV",
    help="Anchors: columns anchor, x, y, z (m).",
)
@click.option(
    "--claim",
    default="truth",
    show_default=True,
    metavar="truth|offset:E,N,U",
    help="What the drone claims: the truth, or the truth and an error in metres.",
)
@click.option("--truth-shift", default=0.0, metavar="S", help="The truth of a range at t is the one at t + S seconds.")
@click.option("--truth-raise", default=0.0, metavar="M", help="Metres to add to the truth's height.")
@click.option("--rounds", default=20, show_default=True, type=click.IntRange(10, 160), help="Rounds of a window.")
@click.option("--windows", default=0, type=click.IntRange(0), metavar="N", help="Stop after N windows (0: never).")
@click.option(
    "--commissioning",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="JSON",
    help="Commissioning record of these anchors; otherwise what is known of uncalibrated DW1000 anchors.",
)
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each window on standard output.")
def simulate(
    *,
    recording: Path,
    anchors: Path,
    claim: str,
    truth_shift: float,
    truth_raise: float,
    rounds: int,
    windows: int,
    commissioning: Path | None,
    as_json: bool,
) -> None:
    """Play recorded UWB ranges the whole way, and print the verdict of each window.

    The recording is the air: virtual nodes speak it on serial ports, agents range and sign, the contract on an
    embedded ledger judges, the mirror reads the blocks. A window is one session of --rounds rounds.

    \b
    wonderland simulate --recording ranges.csv --anchors anchors.csv
    wonderland simulate --recording ranges.csv --anchors anchors.csv --claim offset:3,0,0 --json
    """  # noqa: D301
    from wonderland_simulator.recording import RecordingError  # noqa: PLC0415
    from wonderland_simulator.simulate import SimulateSettings, run  # noqa: PLC0415
    from wonderland_simulator.stage import ProcessError  # noqa: PLC0415

    settings = SimulateSettings(
        recording, anchors, claim, truth_shift, truth_raise, rounds, windows, commissioning, as_json
    )
    try:
        sys.exit(asyncio.run(run(settings)))
    except (RecordingError, ProcessError) as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        sys.exit(130)
