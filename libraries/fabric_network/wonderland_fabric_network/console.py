"""What all commands of ``wonderland network`` share: their options, and how they show what goes on."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from rich.console import Console

from wonderland_fabric_network import bringing_up
from wonderland_fabric_network.layout import NetworkDirectory

if TYPE_CHECKING:
    from collections.abc import Iterator

    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.network import Network

DEFAULT_DIRECTORY: Final = "wonderland-network"

dir_option = click.option(
    "--dir",
    "directory",
    default=DEFAULT_DIRECTORY,
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="The network's directory.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document.")


def open_at(directory: Path) -> Network:
    """The network of a directory. Raises `NetworkError`."""
    return bringing_up.open_network(NetworkDirectory(directory))


@contextlib.contextmanager
def progress(*, quiet: bool = False) -> Iterator[Report]:
    """Lines as things get done, and on a terminal a spinner with what goes on."""
    if quiet:
        yield lambda _step, _text: None
        return
    console = Console(stderr=True)
    begin = time.monotonic()
    with console.status("…") as spinner:

        def report(step: str, text: str) -> None:
            console.print(
                f"[dim]{time.monotonic() - begin:5.1f} s[/dim]  {step:<13} {text}", highlight=False, soft_wrap=True
            )
            spinner.update(f"{step} …")

        yield report
