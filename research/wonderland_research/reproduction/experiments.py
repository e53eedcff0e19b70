"""``wonderland reproduce paper``, ``hyu`` and ``everything``."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from wonderland.proofs.errors import ProofError
from wonderland_edge_agent.commissioning.errors import CommissioningError
from wonderland_research.paper import reproduce
from wonderland_research.reproduction import hyu_command, hyu_crossed, report
from wonderland_research.reproduction.report import ReportSettings
from wonderland_simulator.stage import ProcessError

_FILE = click.Path(dir_okay=False, path_type=Path)
_DATA = click.Path(exists=True, file_okay=False, path_type=Path)
_SEED = click.option(
    "--seed", type=click.IntRange(0, 2**31), default=1, show_default=True, help="Same seed, same noise."
)


@click.command("paper")
@_SEED
@click.option("--plot", type=_FILE, metavar="FILE", help="Draw both of its figures (.svg, .pdf or .png).")
@click.option("--sequence", type=_FILE, metavar="FILE", help="Draw its eight steps with their times.")
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each point on standard output.")
def paper(*, seed: int, plot: Path | None, sequence: Path | None, as_json: bool) -> None:
    """The paper's four points (Fu et al., figures 4 and 5), each sent the whole way.

    Its anchors and positions are taken from its figures; ranges are drawn with the noise that fits its error circles.
    Beside each verdict stand the Cramér–Rao bound for the rounds it took, the paper's circle and the paper's rule; and
    when each of its eight steps was done, from the request to the permission.
    """
    _checked(lambda: asyncio.run(reproduce(seed=seed, as_json=as_json, plot=plot, sequence=sequence)))


@click.command("hyu")
@click.option("--data", required=True, type=_DATA, metavar="DIR", help="The converted HYU recordings.")
@_SEED
@click.option("--rounds", type=click.IntRange(5, 160), default=20, show_default=True, help="Rounds of a window.")
@click.option("--quick", is_flag=True, help="Every twelfth window only.")
@click.option("--crossed", is_flag=True, help="Commission on each recording and judge the others, beside none.")
@click.option("--out", type=_FILE, metavar="FILE", help="Write a report with drawings (.html).")
@click.option("--json", "as_json", is_flag=True, help="One line of JSON for each row on standard output.")
def hyu(*, data: Path, seed: int, rounds: int, quick: bool, crossed: bool, out: Path | None, as_json: bool) -> None:
    """Real ranges with truth: how often the verdict is right, near and far, in sight and obstructed.

    Four DW1000 anchors on a car, a tag out to 50 m, RTK truth (cucudasluv/UWB-dataset, Apache-2.0). Anchors that nobody
    calibrated, anchors calibrated on one part and judged on the other, and a calibration used for another mounting; the
    paper's rule beside each. With --crossed: what a commissioning from another recording, or from a short piece of one,
    is worth beside none.
    """
    if crossed:
        _checked(lambda: hyu_crossed.run(data, rounds=rounds, quick=quick, as_json=as_json))

    _checked(lambda: hyu_command.run(data, seed=seed, rounds=rounds, quick=quick, out=out, as_json=as_json))


@click.command("all")
@click.option(
    "--data", type=_DATA, metavar="DIR", help="The converted HYU recordings; without them their section is left out."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("wonderland-report.html"),
    show_default=True,
    metavar="PATH",
    help="Where to write it: a file (.html), or a directory for report.html.",
)
@click.option(
    "--tries",
    type=click.IntRange(200, 10_000_000),
    default=20_000,
    show_default=True,
    help="Simulated drones for each figure; the goals are stated for 100000.",
)
@_SEED
@click.option("--without-paper", is_flag=True, help="Leave out what needs processes: the paper's points the whole way.")
@click.option("--without-attacks", is_flag=True, help="Leave out the attack lab.")
def everything(
    *, data: Path | None, out: Path, tries: int, seed: int, without_paper: bool, without_attacks: bool
) -> None:
    """The goals of the verdict, the paper's experiment, real recordings and attacks: one report, one HTML file.

    The page needs nothing else: drawings are in it, and so are seeds, versions and the machine.
    """
    page = out if out.suffix in {".html", ".htm"} else out / "report.html"
    settings = ReportSettings(data, page, tries, seed, paper=not without_paper, attacks=not without_attacks)
    _checked(lambda: report.run(settings))


def _checked(work: Callable[[], int]) -> None:
    """Run it; errors of files and processes as messages, and the exit code."""
    errors: tuple[Any, ...] = (CommissioningError, ProcessError, ProofError, OSError)
    try:
        sys.exit(work())
    except errors as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        sys.exit(130)
