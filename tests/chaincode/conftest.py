"""The contract on a ledger in memory."""

from __future__ import annotations

import pytest
from kit.contract import Scene


@pytest.fixture
def empty() -> Scene:
    return Scene()


@pytest.fixture
def scene() -> Scene:
    """Everything ready for a landing."""
    return Scene().ready()


@pytest.fixture(scope="session")
def make_scene() -> type[Scene]:
    return Scene
