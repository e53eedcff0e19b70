"""The command ``wonderland attack``."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console

    from wonderland_research.attack_lab import LabResult, LabSettings

_DEFAULT_TRIES = 1_000
# The wire starts processes while gRPC's threads run; its own fork handlers would only complain about it.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")


@click.command()
@click.option("--list", "only_list", is_flag=True, help="Say what attacks there are, and end.")
@click.option("--attack", "attacks", multiple=True, metavar="NAME", help="Only this one; may be repeated.")
@click.option(
    "--tries",
    type=click.IntRange(1, 10_000_000),
    default=_DEFAULT_TRIES,
    show_default=True,
    help="Tries of each attack and way of ranging.",
)
@click.option(
    "--level", "levels", multiple=True, type=click.IntRange(0, 4), metavar="0..4", help="Only this assurance level."
)
@click.option("--seed", type=int, default=1, show_default=True, help="Same seed, same counts.")
@click.option("--exact", is_flag=True, help="Screen nothing: the contract's function decides every look (slow).")
@click.option("--processes", type=click.IntRange(0, 256), default=0, help="Processes; as many as cores unless given.")
@click.option(
    "--keep",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Keep what is played here, and go on from it: a long run can be ended and taken up again.",
)
@click.option(
    "--report",
    "directory",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write attacks.json, attacks.md and plots (SVG) here; with --wire: wire.json and wire.md.",
)
@click.option(
    "--wire",
    is_flag=True,
    help="One of each through real agents, radio bytes and a ledger instead of many on the core (minutes).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
def attack(
    *,
    only_list: bool,
    attacks: tuple[str, ...],
    tries: int,
    levels: tuple[int, ...],
    seed: int,
    exact: bool,
    processes: int,
    keep: Path | None,
    directory: Path | None,
    wire: bool,
    as_json: bool,
) -> None:
    """Attack the verdict, many thousand times, and count the permissions won.

    Each class of attack says what the attacker controls, what that costs, and from which assurance on it wins
    nothing. Tries are judged by the contract's own function; looks whose answer is beyond doubt are screened in bulk,
    and every run compares a sample of them with that function. The exit code is 1 where an attack does not come out as
    it is documented.

    \b
    wonderland attack --list                           what there is
    wonderland attack                                  a thousand tries of each
    wonderland attack --tries 100000 --report out      as in docs/threat-model.md
    wonderland attack --attack gnss-drag --level 2     one of them
    wonderland attack --wire                           one of each through agents and ledger
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    from wonderland.consoles import for_people  # noqa: PLC0415 - --help must not load the lab
    from wonderland_research.attack_lab import LabError, LabSettings, UnknownAttackError  # noqa: PLC0415

    console = for_people(stderr=as_json)
    settings = LabSettings(
        attacks=attacks,
        levels=tuple(sorted(set(levels))) or LabSettings.levels,
        tries=tries,
        seed=seed,
        exact=exact,
        processes=processes,
        keep=keep,
    )
    try:
        if only_list:
            _list(console, as_json=as_json)
        elif wire:
            sys.exit(_wire(settings, directory, as_json=as_json))
        else:
            result = _run(settings, console)
            if as_json:
                print(json.dumps(result.to_json()))  # noqa: T201 - the product of --json
            _show(result, console, directory, as_json=as_json)
            sys.exit(0 if result.as_documented else 1)
    except (UnknownAttackError, LabError) as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        sys.exit(130)


def _run(settings: LabSettings, console: Console) -> LabResult:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    from wonderland_research.attack_lab import run, total_tries  # noqa: PLC0415

    totals = total_tries(settings)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        overall = progress.add_task("all attacks", total=sum(totals.values()))
        tasks = {name: progress.add_task(name, total=total, visible=False) for name, total in totals.items()}

        def advance(name: str, tries: int) -> None:
            progress.advance(overall, tries)
            progress.update(tasks[name], advance=tries, visible=True)
            if progress.tasks[tasks[name]].finished:
                progress.update(tasks[name], visible=False)

        return run(settings, advance)


def _show(result: LabResult, console: Console, directory: Path | None, *, as_json: bool) -> None:
    from wonderland_research.attack_lab import report  # noqa: PLC0415

    if not as_json:
        report.show(result, console)
    if directory is not None:
        for path in report.write(result, directory):
            console.print(f"Wrote {path}")


def _list(console: Console, *, as_json: bool) -> None:
    from wonderland_research.attack_lab import ATTACKS  # noqa: PLC0415

    if as_json:
        said = [
            {
                "name": each.name,
                "family": str(each.family),
                "title": each.title,
                "controls": each.controls,
                "cost": each.cost,
                "wins": each.wins,
                "stops": each.stops,
                "stopped_from": each.stopped_from,
                "levels": list(each.levels),
                "wire": each.wire,
            }
            for each in ATTACKS.values()
        ]
        print(json.dumps(said))  # noqa: T201
        return
    for each in ATTACKS.values():
        from_level = "at no level" if each.stopped_from is None else f"from assurance {each.stopped_from} on"
        console.print(f"[bold]{each.name}[/bold]  {each.title}", soft_wrap=True)
        console.print(f"    Controls: {each.controls} Cost: {each.cost}", soft_wrap=True)
        console.print(f"    Stopped {from_level}: {each.stops}\n", soft_wrap=True)


def _wire(settings: LabSettings, directory: Path | None, *, as_json: bool) -> int:
    import asyncio  # noqa: PLC0415

    from wonderland_research.attack_lab.wire import run_wire  # noqa: PLC0415
    from wonderland_simulator.stage import ProcessError  # noqa: PLC0415

    try:
        return asyncio.run(
            run_wire(settings.attacks, seed=settings.seed, as_json=as_json, levels=settings.levels, report=directory)
        )
    except ProcessError as error:
        raise click.ClickException(str(error)) from error
