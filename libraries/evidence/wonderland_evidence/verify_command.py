"""``wonderland evidence verify``: the steps, one after the other."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Final

import click
from rich.console import Console

from wonderland_evidence import bundle as bundles
from wonderland_evidence import trust as trusts
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.verify import FAILS, HOLDS, NOT_CHECKED, verify

FAILED: Final = 1
UNREADABLE: Final = 3
NOT_WHOLE: Final = 4
_MARKS: Final = {HOLDS: "[green]✓[/green]", FAILS: "[red]✗[/red]", NOT_CHECKED: "[yellow]–[/yellow]"}


@click.command(name="verify")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--trust", "trust_file", required=True, type=click.Path(path_type=Path), help="The pinned facts.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a step.")
def verify_command(*, file: Path, trust_file: Path, as_json: bool) -> None:
    """Check a file step by step, without a connection.

    Exit code 0: all steps hold. 1: one does not. 3: the file or the trust file cannot be read. 4: none fails, but one
    that evidence may not lack was not checked (for example, another version of the contract).
    """
    try:
        pins = trusts.Pins.decode(bundles.read_file(trust_file, trusts.MAX_BYTES))
        report = verify(bundles.read_file(file), pins)
    except UnreadableError as cause:
        if as_json:
            click.echo(
                json.dumps({"step": 0, "name": "file", "status": "fails", "code": cause.code, "text": str(cause)})
            )
        else:
            click.echo(f"step 0, file: {cause}", err=True)
        sys.exit(UNREADABLE)
    if as_json:
        for each in report.findings:
            click.echo(json.dumps(each.to_json(), ensure_ascii=False))
    else:
        console = Console(highlight=False, soft_wrap=True)
        for each in report.findings:
            console.print(f"{_MARKS[each.status]} {each.number:2} [bold]{each.step.name}[/bold]: ", end="")
            console.print(each.text, markup=False)
            if each.status == HOLDS:
                console.print(f"     proves: {each.proves}", style="dim", markup=False)
            console.print(f"     does not prove: {each.step.does_not_prove}", style="dim", markup=False)
    if report.failed is not None:
        sys.exit(FAILED)
    if not report.is_whole:
        sys.exit(NOT_WHOLE)
