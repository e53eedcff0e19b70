"""A network of real Fabric servers, brought up once for all the tests that need one; and what tests of parts share."""

from __future__ import annotations

import asyncio
import json
import os
import time
from contextlib import asynccontextmanager

import pytest

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import bringing_up, taking_down
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import BinaryError
from wonderland_fabric_network.layout import NetworkDirectory


def quiet(_step, _text):
    """Nobody listens."""


def pad(pad_id):
    """What RegisterPad takes."""
    return json.dumps(
        {
            "pad_id": pad_id,
            "name": "Roof",
            "operator_id": "skyport",
            "lat_e7": 604_500_000,
            "lon_e7": 222_600_000,
            "height_mm": 12_000,
        }
    )


class RunningNetwork:
    """A network of the tests, and its use as a client."""

    def __init__(self, network, binaries):
        self.network = network
        self.binaries = binaries
        self.seconds = 0.0

    @classmethod
    def start(cls, path, description=None):
        begin = time.monotonic()
        network = bringing_up.new_network(NetworkDirectory(path), description)
        running = cls(network, asyncio.run(servers.check_binaries()))
        try:
            running.up()
        except BaseException:
            running.down()
            raise
        running.seconds = time.monotonic() - begin
        return running

    def up(self):
        asyncio.run(bringing_up.bring_up(self.network, self.binaries, quiet))

    def down(self):
        asyncio.run(taking_down.take_down(self.network, quiet))

    def reopen(self):
        self.network = bringing_up.open_network(self.network.directory)

    @property
    def connection(self):
        return Connection.load(self.network.directory.connection_file)

    @asynccontextmanager
    async def contract(self, name, msp_id=None):
        """The contract as that identity, through the combined connection or one organisation's own."""
        directory = self.network.directory
        path = directory.connection_file if msp_id is None else directory.organisation(msp_id).connection_file
        connection = Connection.load(path)
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity(name), connection.signer(name))
            yield gateway.network(connection.channel).contract(connection.chaincode)

    @asynccontextmanager
    async def mirror(self):
        """The channel as the mirror reads it."""
        connection = self.connection
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
            yield gateway.network(connection.channel)

    async def register_pad(self, name="pad_operator", msp_id=None):
        async with self.contract(name, msp_id) as contract:
            return await contract.submit_with_retry("RegisterPad", pad(f"pad-{os.urandom(6).hex()}"))


@pytest.fixture(scope="session")
def fabric():
    """Fabric's servers; a test that needs them is skipped, with the reason, where they are missing."""
    try:
        servers.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")


@pytest.fixture(scope="session")
def network_class():
    return RunningNetwork


@pytest.fixture(scope="session")
def running(fabric, tmp_path_factory):
    """Three organisations, one orderer: what `wonderland network up` makes without a description."""
    network = RunningNetwork.start(tmp_path_factory.mktemp("fabric") / "net")
    yield network
    network.down()


@pytest.fixture
def description():
    return NetworkDescription()
