"""The fixtures that several folders share come from the kit; what is one folder's own stands in that folder."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest

pytest.register_assert_rewrite("kit")

TESTS = Path(__file__).parent

pytest_plugins = [
    "kit.backend",
    "kit.browser",
    "kit.chain",
    "kit.console",
    "kit.databases",
    "kit.facts",
    "kit.houses",
    "kit.postgres",
    "kit.routes",
]

LONGEST_FIRST = (
    "system",
    "network",
    "scenarios",
    "console",
    "simulator",
    "registry",
    "people",
    "backend",
    "api",
)
"""Folders of tests that take long: with them first, both processes come to their end at about the same time."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    order = {name: rank for rank, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: order.get(item.path.relative_to(TESTS).parts[0], len(order)))


gc.set_threshold(20_000, 20, 50)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """What was imported lives as long as the run: a collector that keeps looking through it costs a fifth of the time."""
    gc.collect()
    gc.freeze()
