"""The ledgers that each scenario runs on, one after the other."""

from __future__ import annotations

import sys
import uuid
from pathlib import Path

import pytest

from wonderland.ledger.network import binaries
from wonderland.ledger.network.errors import BinaryError

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))
from scenario_world import PLACES, Site, people_at


@pytest.fixture(scope="session", params=[pytest.param("embedded"), pytest.param("fabric", marks=pytest.mark.fabric)])
def ledger(request, tmp_path_factory):
    """A ledger that runs, for all scenarios; they leave it running and tread on nobody's pads."""
    if request.param == "fabric":
        try:
            binaries.find()
        except BinaryError as error:
            pytest.skip(f"Fabric's servers are needed: {error}")
    place = PLACES[request.param](tmp_path_factory.mktemp(request.param))
    try:
        place.start()
        yield place
    finally:
        place.stop()


@pytest.fixture
async def people(ledger):
    async with people_at(ledger) as people:
        yield people


@pytest.fixture
def tag():
    """A new name in each test."""
    return uuid.uuid4().hex[:12]


@pytest.fixture
def site_of(people, tag):
    """Makes a pad of that organisation, surveyed and with prekeys, and a drone that may land there."""

    async def make(msp_id="PadMSP", **more):
        return await Site(people, f"{tag}-{msp_id.lower()}", msp_id).ready(**more)

    return make


@pytest.fixture
async def site(site_of):
    return await site_of()
