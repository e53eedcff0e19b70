"""A running embedded ledger with a small contract, and the means to say untrue things to it."""

from __future__ import annotations

import pytest
from kit.embedded import ToyContract, high_s, make_proposal, open_world


@pytest.fixture(name="open_world", scope="session")
def _open_world():
    return open_world


@pytest.fixture
async def world(tmp_path, open_world):
    async with open_world(tmp_path / "ledger") as running:
        yield running


@pytest.fixture(name="make_proposal")
def _make_proposal():
    return make_proposal


@pytest.fixture(name="high_s")
def _high_s():
    return high_s


@pytest.fixture(name="toy_contract")
def _toy_contract():
    return ToyContract()
