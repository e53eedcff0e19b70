"""The one command, ``wonderland``: it gathers the sub-commands of whatever is installed here.

Each package registers its own under the entry-point group ``wonderland.commands``, so nothing imports
upwards and a pad that installed only its agent shows only what it has. Whoever asks for more is told what to install.
"""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

import click

from wonderland import __version__, missing_parts
from wonderland.lazy_commands import importing

GROUP: Final = "wonderland.commands"


class InstalledCommands(click.Group):
    """Loads a sub-command only when it is asked for, so that one broken part breaks no other."""

    def _entries(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in entry_points(group=GROUP)}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the sub-commands whose packages are installed with what they need."""
        return sorted(name for name in self._entries() if self._is_whole(ctx, name))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - as click has it
        """The command; None where there is none of this name. Raises `ClickException` where it is not installed."""
        entry = self._entries().get(cmd_name)
        if entry is None:
            if (said := missing_parts.of_command(cmd_name)) is not None:
                raise click.ClickException(said)
            return None
        try:
            with importing():
                loaded = entry.load()
        except ModuleNotFoundError as error:
            raise self._missing(entry, error) from error
        return loaded if isinstance(loaded, click.Command) else None

    def invoke(self, ctx: click.Context) -> Any:
        """Run what was asked for. Raises `ClickException` where it needs a module that is not installed."""
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            entry = self._entries().get(ctx.invoked_subcommand or "")
            if entry is None:
                raise
            raise self._missing(entry, error) from error

    def _is_whole(self, ctx: click.Context, name: str) -> bool:
        try:
            return self.get_command(ctx, name) is not None
        except click.ClickException as error:
            if ctx.params.get("verbose"):
                click.echo(error.format_message(), err=True)
            return False

    @staticmethod
    def _missing(entry: EntryPoint, error: ModuleNotFoundError) -> click.ClickException:
        distribution = None if entry.dist is None else entry.dist.name
        said = missing_parts.of_module(error.name or str(error), distribution)
        return click.ClickException(f"wonderland {entry.name}: {said}")


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
