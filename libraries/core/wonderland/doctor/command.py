"""``wonderland doctor``: looks at every part that has settings here."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final

import click
from rich.console import Console
from rich.markup import escape

from wonderland.doctor import gather
from wonderland.doctor.checks import Check, Status, worst

GROUP: Final = "wonderland.checks"
"""Entry points: a part's name → its checks, by its settings file and the time (Unix, ms)."""
Checks = Callable[[Path, int], Iterator[Check]]
SETTINGS: Final = Path("/etc/wonderland")
EXIT: Final[dict[Status, int]] = {"ok": 0, "not_checked": 0, "warning": 3, "failed": 1}
_MARKS: Final[dict[Status, str]] = {
    "ok": "[green]ok         [/green]",
    "warning": "[yellow]warning    [/yellow]",
    "failed": "[red]failed     [/red]",
    "not_checked": "[dim]not checked[/dim]",
}


@click.command()
@click.option(
    "--config",
    "configs",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="backend.toml, pad.toml or uav.toml, by their names; several times. Usual: those in /etc/wonderland.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
def doctor(configs: tuple[Path, ...], *, as_json: bool) -> None:
    """Check this machine and its parts, and say what to do. Nothing is changed.

    Exit code 0: nothing is wrong; 3: something will be; 1: something is. What could not be checked counts as neither.
    """
    parts = {entry.name: entry for entry in entry_points(group=GROUP)}
    given = configs or tuple(path for name in parts if (path := SETTINGS / f"{name}.toml").exists())
    unknown = [str(path) for path in given if path.stem not in parts]
    if unknown:
        known = ", ".join(f"{name}.toml" for name in sorted(parts)) or "none"
        raise click.UsageError(f"--config: {', '.join(unknown)}: no part that is installed here has it; those: {known}")
    found = list(_looked(given, {path.stem: parts[path.stem].load() for path in given}, as_json=as_json))
    if not given and not as_json:
        click.echo(f"No settings in {SETTINGS}: give --config to check a part.")
    sys.exit(EXIT[worst(found)])


def _whole(part: str, checks: Iterator[Check]) -> Iterator[Check]:
    """A part's checks; what this user may not look at is said, and the other parts go on."""
    try:
        yield from checks
    except OSError as error:
        step = "run this as root, or as the user of the service"
        yield Check(part, "files", "not_checked", f"{error.filename or part}: {error.strerror or error}", step)


def _looked(given: tuple[Path, ...], parts: dict[str, Checks], *, as_json: bool) -> Iterator[Check]:
    console = Console(highlight=False, soft_wrap=True)
    looked_at = (_whole(path.stem, parts[path.stem](path, gather.now_ms())) for path in given)
    for checks in (gather.machine(), *looked_at):
        for each in checks:
            if as_json:
                click.echo(json.dumps(each.to_json(), ensure_ascii=False))
            else:
                console.print(f"{_MARKS[each.status]} {each.part}, {each.what}: {escape(each.text)}")
                if each.next_step:
                    console.print(f"            → {escape(each.next_step)}")
            yield each
