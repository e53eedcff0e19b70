"""A commissioned pad and a drone on a real ledger; and both machines in virtual time."""

from __future__ import annotations

import asyncio
import shutil

import pytest
from kit.agents import ANCHORS, Flight, World, open_ledger
from kit.duo import Duo


@pytest.fixture(scope="session")
def prepared_ledger(tmp_path_factory):
    """A stopped ledger with the pad and the drone on it: making keys and certificates anew costs most of a second."""
    directory = tmp_path_factory.mktemp("prepared")

    async def prepare() -> None:
        ledger = open_ledger(directory)
        await ledger.start()
        async with ledger.connection.open_channel() as channel:
            await World(directory, ledger, channel).set_up()
        await ledger.stop()

    asyncio.run(prepare())
    return directory / "ledger"


@pytest.fixture
async def world(tmp_path, prepared_ledger):
    shutil.copytree(prepared_ledger, tmp_path / "ledger")
    ledger = open_ledger(tmp_path)
    await ledger.start()
    async with ledger.connection.open_channel() as channel:
        made = World(tmp_path, ledger, channel)
        for name in (*ANCHORS, "uav"):
            made.add_node(name)
        yield made
        made.close()
    await made.ledger.stop()


@pytest.fixture
def make_duo():
    return Duo


@pytest.fixture
def make_flight():
    return Flight
