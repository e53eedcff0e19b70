"""The conftest.py of another folder of tests, for what is shared by few: its tools, and its fixtures to hand on."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]


@pytest.fixture
def _any():
    """What a fixture looks like."""


def tools_of(folder, name=None, *, file="conftest.py"):
    """The module, loaded once under `name`; tests import it by that. With a name of one's own it is one's own copy."""
    name = name or f"{folder}_conftest"
    if name not in sys.modules:
        specification = importlib.util.spec_from_file_location(name, TESTS / folder / file)
        module = importlib.util.module_from_spec(specification)
        sys.modules[name] = module
        try:
            specification.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def fixtures_of(module):
    """Its fixtures by the names that it has for them: `globals().update(fixtures_of(module))`."""
    return {name: value for name, value in vars(module).items() if isinstance(value, type(_any))}
