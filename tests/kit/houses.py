"""Fixtures of houses with a real ledger and backend; the conftest that takes them brings ``built_console``."""

from __future__ import annotations

from dataclasses import replace

import pytest

from kit.proof_actors import HERE, ROUNDS, Actors
from kit.proof_world import World
from kit.registry_house import House, new_house
from wonderland_fabric_gateway.connection import Connection

AWAY_MM = 4_200
HONEST, LIAR = "uav-0", "uav-1"


class Place:
    """The house's ledger as the scenarios' people see it."""

    def __init__(self, house):
        self.house = house
        self.connection_file = house.directory / "ledger" / "connection.json"

    def gateways(self):
        return [Connection.load(self.connection_file)]

    async def enrol(self, name, role, pol_id, msp_id=None):
        self.house.administration.enrol(name, role=role, pol_id=pol_id, msp_id=msp_id)


@pytest.fixture(scope="session")
def ledger_template(tmp_path_factory):
    """A ledger that has been started once and furnished: certificates and blocks are made a single time."""
    directory = tmp_path_factory.mktemp("template")
    house = House(directory)
    try:
        house.start()
        house.furnish()
    finally:
        house.close()
    return directory


@pytest.fixture
def house(tmp_path, ledger_template):
    running = new_house(tmp_path, ledger_template)
    yield running
    running.close()


@pytest.fixture
def demo_house(tmp_path, ledger_template):
    running = new_house(tmp_path, ledger_template, demo=True)
    yield running
    running.close()


@pytest.fixture
def console_house(tmp_path, ledger_template, built_console):
    """The same with the console, as a demo: keys at a click."""
    running = new_house(tmp_path, ledger_template, console=built_console, demo=True)
    yield running
    running.close()


@pytest.fixture
def with_liar(console_house):
    """An honest drone was verified, and one that is 4.2 m from where it says was refuted."""
    house = console_house
    for name, role in (("pad-0", "pad"), (HONEST, "uav"), (LIAR, "uav")):
        house.administration.enrol(name, role=role, pol_id=name)
    known = Connection.load(house.directory / "ledger" / "connection.json")
    actors = Actors(replace(house.connection, identities=known.identities), house.channel)
    world = World(seed=5)
    elsewhere = (HERE[0] + AWAY_MM, HERE[1], HERE[2])
    lie = world.evidence(lambda _: elsewhere, lambda _: HERE, rounds=ROUNDS, broadcast=lambda _: HERE)

    async def prove():
        await actors.register(house.now_ms(), pads=1, drones=2)
        first, second = await actors.prepare(2, pads=1, drones=2)
        await actors.prove(first, 0)
        actors.evidence = [lie]
        return await actors.prove(second, 0)

    _, verdict = house.run(prove(), 60)
    assert verdict["outcome"] == "refuted"
    house.wait_mirrored()
    return house
