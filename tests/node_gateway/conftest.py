"""The same ledger and contract as in tests/ledger_embedded."""

from __future__ import annotations

import pytest
from kit.embedded import open_world


@pytest.fixture(name="open_world")
def _open_world():
    return open_world


@pytest.fixture
async def world(tmp_path):
    async with open_world(tmp_path / "ledger") as running:
        yield running
