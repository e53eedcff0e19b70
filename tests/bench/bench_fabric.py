"""Fabric networks for the benchmarks."""

from __future__ import annotations

import pytest

from wonderland_fabric_network import binaries, bringing_up, taking_down
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import BinaryError
from wonderland_fabric_network.layout import NetworkDirectory


def quiet(_step, _text):
    """Nobody listens."""


def needs_fabric():
    """Skip where Fabric's servers are missing."""
    try:
        binaries.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")


async def fabric_network(directory, **described):
    """A network that is up; without a description three organisations, one peer each, one orderer. Take it down!"""
    needs_fabric()
    servers = await binaries.check_binaries()
    network = bringing_up.new_network(NetworkDirectory(directory), NetworkDescription.parse(described))
    try:
        await bringing_up.bring_up(network, servers, quiet)
    except BaseException:
        await taking_down.take_down(network, quiet)
        raise
    return network
