"""A contract service with a contract of toys, and a peer that is none."""

from __future__ import annotations

import pytest
from kit import contract_peer


@pytest.fixture
def toy():
    return contract_peer.ToyContract()


@pytest.fixture(name="serving")
def _serving():
    return contract_peer.serving


@pytest.fixture
async def world(toy):
    async with contract_peer.serving(toy) as running:
        yield running


@pytest.fixture(name="tools", scope="session")
def _tools():
    return contract_peer
