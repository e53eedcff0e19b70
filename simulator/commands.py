"""``wonderland demo``, ``simulate`` and ``reproduce``."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command()
@click.option("--headless", is_flag=True, help="No console in the browser; verdicts on the terminal only.")
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each verdict on standard output.")
@click.option("--until", type=click.IntRange(0), default=0, metavar="N", help="Stop after N verdicts (0: never).")
@click.option("--seed", type=int, default=1, show_default=True, help="Same seed, same noise.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the console; a free one unless given.")
@click.option(
    "--data",
    "directory",
    type=click.Path(file_okay=False, path_type=Path),
    help="Keep ledger, database and logs here; a temporary directory unless given.",
)
def demo(*, headless: bool, as_json: bool, until: int, seed: int, port: int, directory: Path | None) -> None:
    """Three landing pads, honest drones and liars, a ledger and a live map, all on this machine.

    Everything is real but the air: drones fly in a simulator, which speaks UCI on pseudo-terminals and broadcasts
    Remote ID on UDP. Among eight drones four lie: one whose GNSS is dragged away, one that broadcasts another place
    than it flies, one that replays an old session, and one whose maintenance lapsed.

    \b
    wonderland demo                              the map in your browser
    wonderland demo --headless --json --until 8  one JSON line for each of eight verdicts
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    from simulator.demo import DemoSettings, main  # noqa: PLC0415 - --help must not load the world

    sys.exit(main(DemoSettings(headless or as_json, as_json, until, seed, port, directory)))
