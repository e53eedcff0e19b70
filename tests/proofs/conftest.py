from __future__ import annotations

import pytest
from kit.proof_world import START_MS, World


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def make_world():
    return World


@pytest.fixture
def now_ms() -> int:
    return START_MS + 20_000
