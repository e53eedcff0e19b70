"""Writes the reference of every command from its own help (``make docs``)."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import click
from pages import prose, table, write

from wonderland.cli import main
from wonderland.lazy_commands import LazyCommand

NAME = "wonderland"


def page() -> str:
    """The whole page in Markdown. Raises ValueError for a command or an option that says nothing of itself."""
    root = click.Context(main, info_name=NAME)
    lines = [
        "# Commands",
        "",
        "Made by `make docs` from the commands’ own help; do not edit. Each answers to `--help`. An option that names",
        "an environment variable takes it from there unless given.",
        "",
    ]
    for name in main.list_commands(root):
        command = main.get_command(root, name)
        assert command is not None
        lines += _described(command, [NAME, name], 2)
    return "\n".join(lines).rstrip() + "\n"


def _described(command: click.Command, path: list[str], level: int) -> Iterator[str]:
    if isinstance(command, LazyCommand):
        command = command.meant()
    if command.hidden:
        return
    words = " ".join(path)
    if not command.help:
        raise ValueError(f"{words}: no help")
    ctx = click.Context(command, info_name=words)
    yield f"{'#' * level} `{words}`"
    yield ""
    yield from _text(command.help)
    arguments = command.collect_usage_pieces(ctx)
    if not isinstance(command, click.Group):
        yield "```text"
        yield " ".join([words, *arguments])
        yield "```"
        yield ""
    yield from _options(command, ctx, words)
    if isinstance(command, click.Group):
        for name in command.list_commands(ctx):
            inner = command.get_command(ctx, name)
            assert inner is not None
            yield from _described(inner, [*path, name], min(level + 1, 4))


def _text(text: str) -> Iterator[str]:
    """A help text: paragraphs; what click is told not to wrap stands as it does."""
    for part in inspect.cleandoc(text).split("\n\n"):
        first, _, rest = part.partition("\n")
        if first.strip() != "\b":
            yield _prose(" ".join(part.split()))
            yield ""
            continue
        body = rest.splitlines()
        while body and body[0].endswith((":", "…")) and not body[0].startswith((" ", "wonderland")):
            yield _prose(body.pop(0).strip())
            yield ""
        if body:
            yield "```text"
            yield from inspect.cleandoc("\n".join(["", *body])).splitlines()
            yield "```"
            yield ""


def _options(command: click.Command, ctx: click.Context, words: str) -> Iterator[str]:
    rows = []
    for option in command.params:
        if not isinstance(option, click.Option) or option.hidden or option.name == "help":
            continue
        record = option.get_help_record(ctx)
        if record is None or not option.help:
            raise ValueError(f"{words}: option {option.name} says nothing")
        extra = option.get_help_extra(ctx)
        notes = [f"`{extra['default']}` unless given"] if extra.get("default") else []
        notes += ["needed"] if "required" in extra else []
        notes += [f"`{extra['range']}`"] if extra.get("range") else []
        envvar = [option.envvar] if isinstance(option.envvar, str) else list(option.envvar or ())
        notes += [f"`{name}`" for name in envvar]
        notes += (
            [", ".join(f"`{each}`" for each in option.type.choices)] if isinstance(option.type, click.Choice) else []
        )
        says = option.help.split("\f")[0].strip()
        rows.append((_name(option, record[0]), _prose(says), "; ".join(notes)))
    if rows:
        yield from table(("Option", "", ""), rows)
        yield ""


def _name(option: click.Option, shown: str) -> str:
    """As help has it, but what it may be stands beside it, where it can be wrapped."""
    if isinstance(option.type, click.Choice) and option.metavar is None:
        shown = shown.partition(" [")[0]
    return f"`{shown.replace('INTEGER RANGE', 'NUMBER').replace('FLOAT RANGE', 'NUMBER')}`"


def _prose(text: str) -> str:
    """Options are code, also where the text does not mark them."""
    parts = text.replace("``", "`").split("`")
    parts[::2] = [re.sub(r"(?<![\w-])--[a-z][a-z0-9-]*", r"`\g<0>`", part) for part in parts[::2]]
    return prose("`".join(parts))


if __name__ == "__main__":
    write(page)
