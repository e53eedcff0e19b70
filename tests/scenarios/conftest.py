"""The ledgers that each scenario runs on, one after the other."""

from __future__ import annotations

import contextlib
import uuid

import pytest
from kit.node_client import Bridge, NodePeople
from kit.scenario_world import PLACES, Site, people_at

from wonderland_fabric_network import binaries
from wonderland_fabric_network.errors import BinaryError


@pytest.fixture(scope="session")
def places(tmp_path_factory):
    """Starts the ledger of a kind at its first scenario; all of them run to the end, whatever order files come in."""
    begun = {}
    with contextlib.ExitStack() as endings:

        def of(kind):
            if kind not in begun:
                place = PLACES[kind](tmp_path_factory.mktemp(kind))
                endings.callback(place.stop)
                place.start()
                begun[kind] = place
            return begun[kind]

        yield of


@pytest.fixture(scope="session", params=[pytest.param("embedded"), pytest.param("fabric", marks=pytest.mark.fabric)])
def ledger(request, places):
    """A ledger that runs, for all scenarios; they leave it running and tread on nobody's pads."""
    if request.param == "fabric":
        try:
            binaries.find_binaries()
        except BinaryError as error:
            pytest.skip(f"Fabric's servers are needed: {error}")
    return places(request.param)


def pytest_generate_tests(metafunc):
    """Chosen scenarios are played twice: by our client, and by the official one for Node.js."""
    if getattr(metafunc.function, "also_with_the_node_client", False):
        metafunc.parametrize("client", ["python", pytest.param("node", marks=pytest.mark.node)])


@pytest.fixture
def client():
    """Which client the people use."""
    return "python"


@pytest.fixture
async def people(ledger, client):
    if client == "python":
        async with people_at(ledger) as people:
            yield people
        return
    async with people_at(ledger, NodePeople) as people:
        people.bridge = await Bridge.start(ledger.connection_file)
        try:
            yield people
        finally:
            await people.bridge.close()


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
