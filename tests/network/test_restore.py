"""Restoring: a peer's ledger lost, or put back from a copy that is older than the channel."""

import asyncio
import shutil

import pytest

from wonderland_fabric_gateway.gateway import GatewayError
from wonderland_fabric_network import recovery
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import ComponentError
from wonderland_fabric_network.status import network_status

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(180)]


@pytest.fixture
def three(fabric, tmp_path, network_class):
    running = network_class.start(tmp_path / "net", NetworkDescription().with_ordering("raft", 3))
    yield running
    running.down()


def test_an_orderer_that_lost_everything_joins_again_only_while_the_others_have_all(three, monkeypatch):
    """What it voted on is lost with it: were another one behind, a committed block could be missing."""
    asyncio.run(three.register_pad())
    lost, behind = "OrdererMSP.orderer1", "OrdererMSP.orderer2"
    for name in (lost, behind):
        asyncio.run(three.network.processes.stop(name))
    shutil.rmtree(_data(three, lost))
    monkeypatch.setattr(recovery, "EQUAL_S", 0.5)
    kept = _data(three, behind).rename(_data(three, behind).parent / "kept")  # it, too, has nothing now
    with pytest.raises(ComponentError, match=r"has lost its ledger, and may join again only while all others"):
        three.up()
    for name in (lost, behind):
        asyncio.run(three.network.processes.stop(name))
    shutil.rmtree(_data(three, behind))
    kept.rename(_data(three, behind))
    monkeypatch.setattr(recovery, "EQUAL_S", 60.0)
    three.up()
    asyncio.run(_register_soon(three, "pad_operator", "PadMSP"))

    async def until_equal():
        async with asyncio.timeout(60):
            while True:
                status = await network_status(three.network)
                heights = {each.height for each in status.components if each.kind == "orderer"}
                if status.healthy and len(heights) == 1:
                    return
                await asyncio.sleep(0.2)

    asyncio.run(until_equal())


def test_the_only_orderer_without_its_ledger_is_not_made_anew(running):
    """It would begin another channel of the same name beside the peers' one."""
    data = _data(running, "OrdererMSP.orderer0")
    asyncio.run(running.network.processes.stop("OrdererMSP.orderer0"))
    kept = data.rename(data.parent / "kept")
    with pytest.raises(ComponentError, match=r"it is the only orderer.*\nNext: put .* back from a backup"):
        running.up()
    asyncio.run(running.network.processes.stop("OrdererMSP.orderer0"))
    shutil.rmtree(data)
    kept.rename(data)
    running.up()
    asyncio.run(_register_soon(running, "pad_operator", "PadMSP"))


def _heights(running):
    status = asyncio.run(network_status(running.network))
    assert status.healthy, status
    return {each.name: each.height for each in status.components if each.kind == "peer"}


async def _register_soon(running, name, msp_id):
    """Until a peer that has just been restored has caught up."""
    async with asyncio.timeout(60):
        while True:
            try:
                return await running.register_pad(name, msp_id)
            except GatewayError:
                await asyncio.sleep(0.2)


def _data(running, component):
    msp_id, _, name = component.partition(".")
    return running.network.directory.organisation(msp_id).node(name).data


def _caught_up(running):
    async def until():
        async with asyncio.timeout(60):
            while True:
                status = await network_status(running.network)
                heights = {each.height for each in status.components if each.kind == "peer"}
                if status.healthy and len(heights) == 1:
                    return
                await asyncio.sleep(0.2)

    asyncio.run(until())


@pytest.mark.parametrize("component", ["FleetMSP.peer0", "PadMSP.peer0"])
def test_a_peer_that_lost_everything_joins_anew_and_endorses(running, component):
    """PadMSP's only peer: what its organisation approved is in its private data, and lost with it."""
    asyncio.run(running.register_pad())
    height = max(_heights(running).values())
    asyncio.run(running.network.processes.stop(component))
    shutil.rmtree(_data(running, component))
    running.up()
    _caught_up(running)
    assert _heights(running)[component] >= height
    asyncio.run(_register_soon(running, "pad_operator", "PadMSP"))
    running.up()


def test_a_peer_goes_on_from_an_older_copy(running, tmp_path):
    asyncio.run(running.network.processes.stop("PadMSP.peer0"))
    shutil.copytree(_data(running, "PadMSP.peer0"), tmp_path / "copy")
    running.up()
    asyncio.run(_register_soon(running, "pad_operator", "PadMSP"))
    after = max(_heights(running).values())
    asyncio.run(running.network.processes.stop("PadMSP.peer0"))
    shutil.rmtree(_data(running, "PadMSP.peer0"))
    (tmp_path / "copy").rename(_data(running, "PadMSP.peer0"))
    running.up()
    _caught_up(running)
    assert _heights(running)["PadMSP.peer0"] >= after
    asyncio.run(_register_soon(running, "pad_operator", "PadMSP"))


def test_a_ca_goes_on_from_a_copy(running, tmp_path):
    """With its directory back, nobody has to enrol anew, and new ones can."""
    from wonderland_fabric_network import enrolment

    home = running.network.directory.organisation("PadMSP").ca_home
    asyncio.run(running.network.processes.stop("PadMSP.ca"))
    shutil.copytree(home, tmp_path / "copy")
    shutil.rmtree(home)
    shutil.copytree(tmp_path / "copy", home)
    running.up()
    (enrolled,) = asyncio.run(enrolment.enrol(running.network, [enrolment.Request("restored", "pad", "restored")]))
    assert enrolled.msp_id == "PadMSP"
