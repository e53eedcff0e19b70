"""Groups of commands whose modules are imported when a command is asked for, and not to list them.

So a command's module may import at its top whatever it needs: `wonderland --help` and a group's own help load none of
it, and a running pad does not carry what calibrating it takes.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pkgutil import resolve_name
from typing import Any

import click


@contextmanager
def importing() -> Iterator[None]:
    """A thousand modules are no garbage: to look for some among them takes a third of a backend's start and end.

    They are put where the collector does not look, neither when it is turned on again nor when the process ends.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


class LazyGroup(click.Group):
    """`lazy`: name of a command, where it is (``package.module:attribute``), and its line in the group's help."""

    def __init__(self, *args: Any, lazy: Mapping[str, tuple[str, str]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.lazy = lazy

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return sorted({*super().list_commands(ctx), *self.lazy})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command; its module is imported now."""
        if cmd_name not in self.lazy:
            return super().get_command(ctx, cmd_name)
        with importing():
            found = resolve_name(self.lazy[cmd_name][0])
        assert isinstance(found, click.Command)
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list in the group's help, from the lines that stand in the table."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self._line(ctx, name)) for name in self.list_commands(ctx)])

    def _line(self, ctx: click.Context, name: str) -> str:
        if name in self.lazy:
            return self.lazy[name][1]
        command = self.get_command(ctx, name)
        return command.get_short_help_str(limit=100) if command is not None else ""


class LazyCommand(click.Command):
    """A command of ``wonderland`` itself whose module is imported when it is asked for; `line`: as it is listed."""

    def __init__(self, where: str, line: str) -> None:
        super().__init__(name=None, short_help=line)
        self._where = where

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of the command that is meant; it is what is invoked."""
        return self.meant().make_context(info_name, args, parent, **extra)

    def meant(self) -> click.Command:
        """The command itself; its module is imported now."""
        with importing():
            found = resolve_name(self._where)
        assert isinstance(found, click.Command)
        return found
