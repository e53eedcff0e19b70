"""A bus of processes."""

from __future__ import annotations

import pytest
from kit.bus_processes import Bus


@pytest.fixture
async def bus(tmp_path):
    made = Bus(tmp_path)
    await made.router.start()
    await made.backend.start()
    yield made
    await made.backend.kill()
    await made.router.kill()
