"""The one command, ``wonderland``: it gathers the sub-commands of whatever is installed here.

Each package registers its own under the entry-point group ``wonderland.commands``, so nothing imports
upwards and a pad that installed only the ``edge`` extra shows only what it has.
"""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Final

import click

from wonderland import __version__
from wonderland.lazy_commands import importing

GROUP: Final = "wonderland.commands"


class InstalledCommands(click.Group):
    """Loads a sub-command only when it is asked for, so that one broken part breaks no other."""

    def _entries(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in entry_points(group=GROUP)}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the sub-commands whose packages are installed with what they need."""
        return sorted(name for name in self._entries() if self.get_command(ctx, name) is not None)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command, or None when it, or an extra that it needs, is not installed."""
        entry = self._entries().get(cmd_name)
        if entry is None:
            return None
        try:
            with importing():
                loaded = entry.load()
        except ModuleNotFoundError as error:
            if ctx.params.get("verbose"):
                click.echo(f"{cmd_name}: not installed here ({error})", err=True)
            return None
        return loaded if isinstance(loaded, click.Command) else None


@click.command(
    cls=InstalledCommands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(__version__, prog_name="wonderland")
@click.option("-v", "--verbose", is_flag=True, help="Say more, for example which commands are missing an extra.")
def main(*, verbose: bool) -> None:
    """Proving where a drone really is.

    Start with `wonderland demo`: three landing pads, honest drones and liars, a ledger and a live map, all on
    this machine. Every command explains itself with --help; those that a machine might read have --json.
    """
    del verbose


if __name__ == "__main__":
    sys.exit(main())
