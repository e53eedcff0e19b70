"""Networks of their own: one that is interrupted while it comes up, one with BFT, one with two peers; and Fabric's CLI."""

import asyncio
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

from wonderland_fabric_gateway.gateway import GatewayError
from wonderland_fabric_network import bringing_up, settings
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.layout import CLIENT, MSP_ADMIN
from wonderland_fabric_network.status import network_status

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(180)]


@pytest.fixture
def another(fabric, tmp_path, network_class):
    """Starts a network of the test's own, and ends it."""
    started = []

    def start(description):
        started.append(network_class.start(tmp_path / "net", description))
        return started[-1]

    yield start
    for each in started:
        each.down()


def test_up_goes_on_wherever_it_was_killed(fabric, tmp_path, network_class):
    """Killed again and again, each time later, until it gets through; then the network works."""
    path = tmp_path / "net"
    command = [sys.executable, "-m", "wonderland.cli", "network", "up", "--json", "--dir", str(path)]
    died = 0
    try:
        for patience_s in (0.7, 1.2, 1.9, 2.8, 4.0, 120.0):
            with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
                try:
                    out, err = child.communicate(timeout=patience_s)
                except subprocess.TimeoutExpired:
                    child.send_signal(signal.SIGKILL)
                    child.communicate()
                    died += 1
                    continue
            assert child.returncode == 0, err
            break
        answer = json.loads(out)
        assert answer["ready"] is True
        assert died >= 2
        network = bringing_up.open_network(bringing_up.NetworkDirectory(path))
        asyncio.run(network_class(network, None).register_pad())
        assert asyncio.run(network_status(network)).healthy
    finally:
        subprocess.run([*command[:4], "destroy", "--yes", "--dir", str(path)], timeout=60, check=False)
    assert not path.exists()


def test_four_orderers_bear_the_loss_of_their_leader_again_and_again(another):
    running = another(NetworkDescription().with_ordering("bft"))
    asyncio.run(running.register_pad())

    async def until_valid():
        begin = time.monotonic()
        while True:
            try:
                async with asyncio.timeout(10):
                    await running.register_pad()
                    return time.monotonic() - begin
            except (GatewayError, TimeoutError):
                assert time.monotonic() - begin < 60
                await asyncio.sleep(0.1)

    async def until_orderers_are_level():
        async with asyncio.timeout(30):
            while True:
                status = await network_status(running.network)
                orderers = [each for each in status.components if each.kind == "orderer"]
                if len({each.height for each in orderers}) == 1:
                    return status
                await asyncio.sleep(0.2)

    # The second time the orderer that was away must take part: without what it missed it could not, and three of four
    # have to agree.
    killed = set()
    for _ in range(2):
        status = asyncio.run(network_status(running.network))
        # Until there is traffic again, one that led before and was away believes that it still does.
        (leader,) = [each for each in status.components if each.leader and each.name not in killed]
        killed.add(leader.name)
        os.kill(leader.pid, signal.SIGKILL)
        assert asyncio.run(until_valid()) < 30  # Fabric's own times: more than two minutes
        asyncio.run(running.register_pad())
        running.up()
        status = asyncio.run(until_orderers_are_level())
    assert status.healthy
    assert len({each.height for each in status.components if each.kind == "peer"}) == 1


def test_an_organisation_may_have_two_peers(another):
    described = NetworkDescription.parse(
        {
            "organisations": [
                {"msp_id": "AuthorityMSP", "kind": "authority"},
                {"msp_id": "PadMSP", "kind": "pads", "peers": 2},
                {"msp_id": "FleetMSP", "kind": "fleet"},
            ],
            "channel": "helsinki",
        }
    )
    running = another(described)
    asyncio.run(running.register_pad())
    asyncio.run(running.network.processes.stop("PadMSP.peer0"))

    async def until_valid():
        async with asyncio.timeout(30):
            while True:
                try:
                    return await running.register_pad()
                except GatewayError:
                    await asyncio.sleep(0.2)

    assert asyncio.run(until_valid()).block_number > 0


def test_fabrics_own_cli_reads_our_channel(running, tmp_path):
    """Fabric's peer CLI with the administrator that our CA made."""
    network = running.network
    organisation = network.directory.organisation("PadMSP")
    admin = organisation.identity(MSP_ADMIN)
    msp = tmp_path / "msp"
    for source, target in (
        (admin.certificate, "signcerts/cert.pem"),
        (admin.key, "keystore/key.pem"),
        (organisation.root, "cacerts/ca.pem"),
        (organisation.tls_root, "tlscacerts/tls.pem"),
    ):
        (msp / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, msp / target)
    (msp / "config.yaml").write_text(yaml.safe_dump(settings.NODE_OUS))
    peer = network.first_peer("PadMSP")
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(tmp_path),
        "FABRIC_CFG_PATH": str(network.node(peer).path),
        "CORE_PEER_LOCALMSPID": "PadMSP",
        "CORE_PEER_MSPCONFIGPATH": str(msp),
        "CORE_PEER_ADDRESS": network.address(peer),
        "CORE_PEER_TLS_ENABLED": "true",
        "CORE_PEER_TLS_ROOTCERT_FILE": str(organisation.tls_root),
        "CORE_PEER_TLS_CLIENTAUTHREQUIRED": "true",
        "CORE_PEER_TLS_CLIENTCERT_FILE": str(organisation.tls_identity(CLIENT).certificate),
        "CORE_PEER_TLS_CLIENTKEY_FILE": str(organisation.tls_identity(CLIENT).key),
    }

    def cli(*arguments):
        command = [str(running.binaries.peer), *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=30, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    info = json.loads(cli("channel", "getinfo", "-c", "wonderland").partition("Blockchain info: ")[2])
    assert info["height"] == asyncio.run(_height(running))
    committed = json.loads(
        cli("lifecycle", "chaincode", "querycommitted", "-C", "wonderland", "-n", "pol", "--output", "json")
    )
    assert committed["approvals"] == {each.msp_id: True for each in network.organisations}
    assert (committed["sequence"], committed["version"]) == asyncio.run(_definition(network, peer))


async def _definition(network, peer):
    async with network.peer_admin(peer) as admin:
        found = await admin.definition(network.channel, "pol")
    return found.sequence, found.version


async def _height(running):
    async with running.mirror() as network:
        return await network.height()
