"""Commands are listed without being loaded, and every one of them is where its table says."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import entry_points

import click
import pytest

from wonderland.cli import GROUP
from wonderland.lazy_commands import LazyGroup

GROUPS = [group for entry in entry_points(group=GROUP) if isinstance(group := entry.load(), LazyGroup)]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.name)
def test_each_command_is_where_its_table_says(group):
    context = click.Context(group)
    for name in group.list_commands(context):
        assert group.get_command(context, name).name == name


def test_a_group_has_its_commands_in_its_help_and_no_others():
    group = LazyGroup("group", lazy={"resolved": ("pkgutil:resolve_name", "What it does.")})
    group.add_command(click.Command("added", help="What else there is."))
    text = group.get_help(click.Context(group))
    assert "resolved  What it does." in text
    assert "added     What else there is." in text
    assert group.get_command(click.Context(group), "other") is None


@pytest.mark.parametrize("arguments", [[], ["backend"], ["pad"], ["uav"], ["reproduce"], ["world"]])
def test_help_loads_neither_the_web_stack_nor_numbers(arguments):
    program = (
        "import sys; from wonderland.cli import main; main([*sys.argv[1:], '--help'], standalone_mode=False);"
        "print(sorted({'fastapi','sqlalchemy','numpy','scipy','uvicorn','pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_what_a_command_imports_is_not_looked_through_and_what_it_makes_is():
    """Neither when the collector is turned on again nor at the end of the process; garbage is found as ever."""
    program = (
        "import gc, weakref; import wonderland.cli, click;"
        "context = click.Context(wonderland.cli.main); wonderland.cli.main.get_command(context, 'ledger');"
        "Knot = type('Knot', (), {}); knot = Knot(); knot.self = knot; seen = weakref.ref(knot); del knot;"
        "frozen = gc.get_freeze_count();"
        "print(gc.isenabled(), frozen > 20 * len(gc.get_objects()), gc.collect() > 0 and seen() is None)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "True"]
