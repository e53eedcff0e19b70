"""``wonderland ros2 interfaces``: the package of messages and actions, for colcon."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

import click

from wonderland_rmw_zenoh.interfaces import SHARE

DIRECTORIES: Final = (SHARE, Path(__file__).parent / "interfaces")
"""As ``Interfaces`` reads them: our own, and those of Open-RMF."""
PACKAGE: Final = "wonderland_msgs"


@click.command()
@click.argument("directory", type=click.Path(file_okay=False, path_type=Path))
def interfaces(*, directory: Path) -> None:
    """Write wonderland_msgs into DIRECTORY, a workspace's src: colcon builds it there."""
    target = directory / PACKAGE
    if target.exists():
        raise click.ClickException(f"{target} is there already; remove it first, or name another directory")
    try:
        shutil.copytree(SHARE / PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as cause:
        raise click.ClickException(f"{target}: cannot be written ({cause.strerror or cause})") from cause
    click.echo(f"{target} is written: colcon build --packages-select {PACKAGE}")
