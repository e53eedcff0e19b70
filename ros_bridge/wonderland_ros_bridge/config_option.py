"""The one option that every command of the bridge takes."""

from __future__ import annotations

from pathlib import Path

import click

config = click.option(
    "--config",
    "path",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="ros1.toml or ros2.toml.",
)
