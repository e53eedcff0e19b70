"""Fabric's own servers, brought up by us: what holds at the start, through crashes, and through changes.

One network for all of it, in the order of the file, since each further one would cost seconds; each test leaves the
network as it found it, or further on.
"""

import asyncio
import dataclasses
import datetime as dt
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from contextlib import AsyncExitStack

import grpc
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from fabric_protos.common import common_pb2
from fabric_protos.orderer import ab_pb2

from wonderland_fabric_gateway.ca.errors import AlreadyEnrolledError, CaRequestError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import RevocationListError
from wonderland_fabric_gateway.gateway import EndorseError, Gateway, GatewayError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_network import (
    agreement,
    bringing_up,
    certificates,
    contract,
    enrolment,
    expansion,
    renewal,
    revocations,
    upgrading,
)
from wonderland_fabric_network.config_update import update_channel
from wonderland_fabric_network.description import Organisation
from wonderland_fabric_network.errors import CertificateStateError, ChannelUpdateError, PortInUseError
from wonderland_fabric_network.layout import MSP_ADMIN
from wonderland_fabric_network.network import Network
from wonderland_fabric_network.status import network_status

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(120)]


def quiet(_step, _text):
    """Nobody listens."""


def _command(running, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "wonderland.cli", "network", *arguments, "--dir", str(running.network.directory.path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


async def _endorsers(running, submitted):
    """Who signed a transaction."""
    async with running.mirror() as network, network.blocks(start_block=submitted.block_number) as stream:
        block = await anext(aiter(stream))
    (transaction,) = [each for each in block.transactions if each.tx_id == submitted.tx_id]
    return {each.endorser.msp_id for each in transaction.invocation.endorsements}


async def _height(running):
    async with running.mirror() as network:
        return await network.height()


# --- as it starts


async def test_a_transaction_is_signed_by_both_organisations_that_must(running):
    done = await running.register_pad()
    assert json.loads(done.payload)["msp_id"] == "PadMSP"
    assert await _endorsers(running, done) == {"AuthorityMSP", "PadMSP"}


async def test_every_organisation_has_a_connection_of_its_own(running):
    done = await running.register_pad("pad_operator", "PadMSP")
    assert done.block_number > 0
    for msp_id, names in {
        "AuthorityMSP": {"admin", "inspector", "mirror"},
        "PadMSP": {"pad", "pad_operator"},
        "FleetMSP": {"fleet_operator", "uav"},
    }.items():
        connection = Connection.load(running.network.directory.organisation(msp_id).connection_file)
        assert set(connection.identities) == names
        assert connection.ledger.kind == "fabric"
        async with running.contract(next(iter(names)), msp_id) as contract_of:
            await contract_of.evaluate("ReadPolicy", '{"action":"land","pad_id":"pad-1"}')


async def test_identities_carry_role_and_id(running):
    for name, files in running.connection.identities.items():
        identity = Identity.from_file(files.msp_id, files.certificate)
        assert (identity.role, identity.node_ou, identity.common_name) == (name, "client", name)
        assert files.key.stat().st_mode & 0o077 == 0


async def test_the_contract_refuses_by_role_and_fabric_by_organisation(running):
    async with running.contract("uav") as contract_of:
        with pytest.raises(EndorseError) as raised:
            await contract_of.submit("RegisterPad", '{"pad_id":"x"}')
    assert raised.value.chaincode_response.status == 403


async def test_status_tells_heights_leader_contract_and_certificates(running):
    status = await network_status(running.network)
    assert status.healthy, status
    by_kind = {}
    for each in status.components:
        by_kind.setdefault(each.kind, []).append(each)
    assert {kind: len(each) for kind, each in by_kind.items()} == {"ca": 4, "orderer": 1, "peer": 3, "contract": 2}
    assert by_kind["orderer"][0].leader is True
    assert by_kind["orderer"][0].state == "active consenter"
    assert len({each.height for each in (*by_kind["peer"], *by_kind["orderer"])}) == 1
    agreed = agreement.load_agreement(running.network.directory.contract_file)  # other tests may have upgraded it
    assert all(f"(sequence {agreed.sequence})" in each.contract for each in by_kind["peer"])
    assert all(each.days_left > 300 for each in status.certificates)
    answer = _command(running, "status", "--json")
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["healthy"] is True
    assert "OrdererMSP.orderer0" in _command(running, "status").stdout


async def test_contract_servers_let_in_only_peers_of_their_organisation(running):
    """Mutual TLS: nobody without a certificate, and nobody with another organisation's."""
    network = running.network
    address = network.contract_address("PadMSP", "a")
    pad, fleet = (network.directory.organisation(each) for each in ("PadMSP", "FleetMSP"))
    root = pad.tls_root.read_bytes()
    peer, stranger = (each.node("peer0").tls for each in (pad, fleet))

    async def connects(tls):
        pair = (None, None) if tls is None else (tls.key.read_bytes(), tls.certificate.read_bytes())
        credentials = grpc.ssl_channel_credentials(root, *pair)
        options = [("grpc.ssl_target_name_override", "localhost")]
        async with grpc.aio.secure_channel(address, credentials, options=options) as channel:
            call = channel.stream_stream("/protos.Chaincode/Connect")()
            try:
                return bool(await asyncio.wait_for(call.read(), 5))
            except grpc.aio.AioRpcError:
                return False

    assert await connects(peer)
    assert not await connects(stranger)
    assert not await connects(None)


async def test_peers_let_in_only_clients_with_a_certificate(running):
    """Mutual TLS: nobody without one, whatever identity he signs with; and not one that a stranger made."""
    connection = running.connection
    roots = connection.gateway.tls_ca.read_bytes()
    shown = connection.client_tls
    stranger_key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "client")])
    now = dt.datetime.now(dt.UTC)
    stranger = (
        x509.CertificateBuilder(name, name, stranger_key.public_key(), 1, now - dt.timedelta(1), now + dt.timedelta(1))
        .sign(stranger_key, hashes.SHA256())
        .public_bytes(Encoding.PEM)
    )
    stranger_pem = stranger_key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

    async def evaluates(key, certificate):
        credentials = grpc.ssl_channel_credentials(roots, key, certificate)
        options = [("grpc.ssl_target_name_override", "localhost")]
        async with grpc.aio.secure_channel(connection.gateway.address, credentials, options=options) as channel:
            gateway = Gateway(channel, connection.identity("inspector"), connection.signer("inspector"))
            contract_of = gateway.network(connection.channel).contract(connection.chaincode)
            try:
                return await contract_of.evaluate("ReadPolicy", '{"action":"land","pad_id":"pad-1"}')
            except GatewayError as error:
                return error.status_code

    assert b"min_assurance" in await evaluates(shown.key_pem(), shown.certificate_pem())
    assert await evaluates(None, None) is grpc.StatusCode.UNAVAILABLE
    assert await evaluates(stranger_pem, stranger) is grpc.StatusCode.UNAVAILABLE


async def test_orderers_let_in_only_clients_with_a_certificate(running):
    """Mutual TLS there, too: an administrator's certificate leads to an answer, none to no connection at all."""
    network = running.network
    (orderer,) = network.orderers
    organisation = network.directory.organisation(orderer.msp_id)
    shown = organisation.tls_identity(MSP_ADMIN)

    async def answer(key, certificate):
        credentials = grpc.ssl_channel_credentials(organisation.tls_root.read_bytes(), key, certificate)
        async with grpc.aio.secure_channel(network.address(orderer), credentials) as channel:
            call = channel.stream_stream("/orderer.AtomicBroadcast/Broadcast")(iter([b""]), timeout=10)
            try:
                return ab_pb2.BroadcastResponse.FromString(await call.read()).status
            except grpc.aio.AioRpcError as error:
                return error.code()

    assert await answer(shown.key.read_bytes(), shown.certificate.read_bytes()) == common_pb2.BAD_REQUEST
    assert await answer(None, None) is grpc.StatusCode.UNAVAILABLE


# --- again, and after crashes


def test_up_again_changes_nothing(running):
    before = asyncio.run(network_status(running.network))
    running.up()
    after = asyncio.run(network_status(running.network))
    assert [(each.name, each.pid, each.height) for each in after.components] == [
        (each.name, each.pid, each.height) for each in before.components
    ]


@pytest.mark.parametrize("victim", ["OrdererMSP.orderer0", "PadMSP.peer0", "PadMSP.contract-a", "AuthorityMSP.ca"])
def test_up_restarts_what_was_killed(running, victim):
    os.kill(running.network.processes.pid(victim), signal.SIGKILL)
    while running.network.processes.pid(victim) is not None:
        pass
    status = _command(running, "status")
    assert status.returncode == 3
    assert "down" in status.stdout
    running.up()
    assert running.network.processes.pid(victim) is not None
    asyncio.run(running.register_pad())


def test_down_and_up_keep_the_ledger(running):
    height = asyncio.run(_height(running))
    assert _command(running, "down").returncode == 0
    assert all(running.network.processes.pid(name) is None for name in running.network.processes.names())
    running.up()
    assert asyncio.run(_height(running)) == height
    asyncio.run(running.register_pad())


def test_a_lost_note_about_the_contract_is_asked_of_the_channel(running):
    note = running.network.directory.contract_file
    before = note.read_bytes()
    note.unlink()
    running.up()
    assert note.read_bytes() == before


def test_a_port_that_somebody_took_is_said_before_anything_starts(running):
    asyncio.run(running.network.processes.stop("FleetMSP.peer0"))
    port = running.network.port(running.network.first_peer("FleetMSP"))
    with (
        socket.create_server(("127.0.0.1", port)),
        pytest.raises(PortInUseError, match=rf"FleetMSP.peer0: port {port}"),
    ):
        running.up()
    running.up()


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        (dt.timedelta(days=400), r"expired on .*Next: `wonderland network renew`"),
        (-dt.timedelta(hours=1), r"valid only from .*Next: set the clock right"),
        (dt.timedelta(hours=1), r"\.ca: its clock says .*Next: set both clocks right"),
    ],
)
def test_an_expired_certificate_or_a_wrong_clock_is_said(running, shift, says):
    network = running.network
    shifted = Network(
        network.directory, network.description, network.ports, now=lambda: dt.datetime.now(dt.UTC) + shift
    )
    with pytest.raises(CertificateStateError, match=says):
        asyncio.run(bringing_up.bring_up(shifted, running.binaries, quiet))


def test_another_ca_in_the_place_of_the_old_one_is_said(running):
    """Its directory lost, the CA makes a new root at its next start: nobody on the channel would trust it."""
    network = running.network
    directory = network.directory.organisation("FleetMSP")
    lost = directory.path / "lost"
    asyncio.run(network.processes.stop("FleetMSP.ca"))
    directory.ca_home.rename(lost)
    try:
        with pytest.raises(CertificateStateError, match="another root than the one that the channel trusts"):
            running.up()
    finally:
        asyncio.run(network.processes.stop("FleetMSP.ca"))
        shutil.rmtree(directory.ca_home)
        lost.rename(directory.ca_home)
    running.up()


def test_logs_show_what_a_component_wrote(running):
    assert "PadMSP.peer0" in _command(running, "logs").stdout
    assert len(_command(running, "logs", "PadMSP.peer0", "-n", "3").stdout.splitlines()) == 3
    wrong = _command(running, "logs", "PadMSP.peer9")
    assert wrong.returncode == 1
    assert "there is no component 'PadMSP.peer9'" in wrong.stderr


# --- identities


async def test_pads_and_drones_are_enrolled_side_by_side(running):
    requests = [enrolment.Request(f"pad-{n}", "pad", f"pad-{n}") for n in range(2)]
    requests += [enrolment.Request(f"uav-{n}", "uav", f"uav-{n}") for n in range(2)]
    enrolled = await enrolment.enrol(running.network, requests)
    assert [(each.name, each.msp_id) for each in enrolled] == [
        ("pad-0", "PadMSP"),
        ("pad-1", "PadMSP"),
        ("uav-0", "FleetMSP"),
        ("uav-1", "FleetMSP"),
    ]
    assert running.connection.identity("uav-1").pol_id == "uav-1"
    assert "pad-1" in Connection.load(running.network.directory.organisation("PadMSP").connection_file).identities
    async with running.contract("pad-0") as contract_of:
        await contract_of.evaluate("ReadPolicy", '{"action":"land","pad_id":"pad-1"}')
    with pytest.raises(AlreadyEnrolledError, match="network renew"):
        await enrolment.enrol(running.network, requests[:1])
    with pytest.raises(CaRequestError, match="belongs to the network itself"):
        await enrolment.enrol(running.network, [enrolment.Request("peer0", "pad", "x")])
    with pytest.raises(CaRequestError, match="is given by PadMSP, not by FleetMSP"):
        await enrolment.enrol(running.network, [enrolment.Request("p", "pad", "x", "FleetMSP")])


async def test_a_lost_pad_is_refused_by_every_peer_from_the_next_block_on(running):
    await enrolment.enrol(running.network, [enrolment.Request("op-lost", "pad_operator", "op-lost")])
    await running.register_pad("op-lost")
    done = await revocations.revoke(running.network, "PadMSP", name="op-lost", reason="keyCompromise")
    assert done.block is not None
    for msp_id in (None, "PadMSP"):  # by the authority's peer, and by the pad operator's own
        with pytest.raises(EndorseError, match=r"access denied|creator"):
            await running.register_pad("op-lost", msp_id)
    await running.register_pad()
    again = await revocations.revoke(running.network, "PadMSP", name="op-lost")
    assert (again.serials, again.block) == (done.serials, None)


async def test_one_certificate_of_several_is_revoked_by_its_serial_number(running):
    await enrolment.enrol(running.network, [enrolment.Request("op-twice", "pad_operator", "op-twice")])
    first = running.connection.identity("op-twice").certificate.serial_number
    async with running.network.authority("PadMSP") as authority:
        await authority.renew("op-twice", authority.directory.identity("op-twice"))
    assert running.connection.identity("op-twice").certificate.serial_number != first
    assert running.connection.identity("op-twice").pol_id == "op-twice"
    done = await revocations.revoke(running.network, "PadMSP", serial=f"{first:X}")
    assert done.serials == (f"{first:x}",)
    await running.register_pad("op-twice")


@pytest.mark.parametrize("name", [MSP_ADMIN, "peer0"])
async def test_a_list_that_locks_its_organisation_out_is_refused_before_it_is_sent(running, name):
    height = await _height(running)
    with pytest.raises(RevocationListError, match="lock the organisation out"):
        await revocations.revoke(running.network, "PadMSP", name=name)
    assert await _height(running) == height
    async with running.network.authority("PadMSP") as authority:  # not even the CA has got to know
        await authority.renew(MSP_ADMIN, authority.directory.identity(MSP_ADMIN))


async def test_a_list_of_another_ca_is_refused_before_it_is_sent(running):
    async with running.network.authority("FleetMSP") as authority:
        crl = await authority.ca.revocation_list(await authority.registrar())
    with pytest.raises(RevocationListError, match="is no CA of that organisation"):
        await revocations.set_revocation_list(running.network, "PadMSP", crl)


async def test_a_change_without_the_signatures_that_it_needs_is_refused_with_the_reason(running):
    network = running.network
    fleet = certificates.signing_identity("FleetMSP", network.directory.organisation("FleetMSP").identity(MSP_ADMIN))

    def change(root):
        del root.groups["Application"].groups["PadMSP"]

    async with AsyncExitStack() as stack:
        peers = await network.peer_admins(stack)
        with pytest.raises(ChannelUpdateError, match="refused the change"):
            await update_channel(network, peers, change, [fleet])


# --- changes of the network


async def test_every_certificate_is_renewed_and_the_network_goes_on(running):
    before = {owner: path.read_bytes() for owner, path in running.network.certificate_files()}
    key = running.network.node(running.network.orderers[0]).tls.key.read_bytes()
    done = await renewal.renew(running.network, running.binaries, renewal.Wanted(everything=True), quiet)
    after = {owner: path.read_bytes() for owner, path in running.network.certificate_files()}
    same = {owner for owner in before if before[owner] == after[owner]}
    assert {each for each in same if "root" not in each} == {"PadMSP/op-lost"}  # revoked: stays as it is
    assert len(done) >= 20
    assert running.network.node(running.network.orderers[0]).tls.key.read_bytes() == key
    await bringing_up.bring_up(running.network, running.binaries, quiet)
    await running.register_pad()
    assert await renewal.renew(running.network, running.binaries, renewal.Wanted(days=30), quiet) == []


async def test_a_new_version_of_the_contract_is_agreed_on_without_downtime(running, monkeypatch):
    network = running.network
    installed = contract.installed_contract("pol")
    newer = dataclasses.replace(installed, sha256="0" * 64)
    failures = []
    submitted = []
    stop = asyncio.Event()

    async def load():
        while not stop.is_set():
            try:
                submitted.append(await running.register_pad())
            except GatewayError as error:
                failures.append(error)

    with monkeypatch.context() as patched:
        for module in (bringing_up, upgrading):
            patched.setattr(module, "installed_contract", lambda _package: newer)
        with pytest.raises(agreement.ContractDiffersError, match="network upgrade"):
            await bringing_up.bring_up(network, running.binaries, quiet)
        task = asyncio.create_task(load())
        _, done = await upgrading.upgrade(network, quiet)
        before_end = len(submitted)
        while len(submitted) < before_end + 3 and not failures:
            await asyncio.sleep(0.02)
        stop.set()
        await task
        assert failures == []
        assert (done.changed, done.agreement.slot) == (True, "b")
        assert network.processes.pid("PadMSP.contract-a") is None
        assert network.processes.pid("PadMSP.contract-b") is not None
        _, again = await upgrading.upgrade(network, quiet)
        assert (again.changed, again.agreement) == (False, done.agreement)
    _, back = await upgrading.upgrade(network, quiet)
    assert (back.changed, back.agreement.slot, back.agreement.sequence) == (True, "a", done.agreement.sequence + 1)
    await running.register_pad()


async def test_a_second_operator_of_pads_joins_and_endorses(running):
    policy = "AND('AuthorityMSP.peer', OR('PadMSP.peer', 'Pad2MSP.peer'))"
    organisation = Organisation(msp_id="Pad2MSP", kind="pads")
    joined = await expansion.add_organisation(running.network, running.binaries, organisation, quiet)
    running.reopen()
    assert joined.block is not None
    assert joined.upgrade.changed
    assert running.network.description.contract.endorsement == policy
    done = await running.register_pad("pad_operator@Pad2MSP")
    assert json.loads(done.payload)["msp_id"] == "Pad2MSP"
    own = await running.register_pad("pad_operator", "Pad2MSP")
    signed = await _endorsers(running, own)
    assert "AuthorityMSP" in signed
    # With the first operator's peer gone the second one's signature does.
    await running.network.processes.stop("PadMSP.peer0")
    try:
        async with asyncio.timeout(30):
            while True:
                try:
                    alone = await running.register_pad("pad_operator", "Pad2MSP")
                    break
                except EndorseError:
                    await asyncio.sleep(0.2)
        assert await _endorsers(running, alone) == {"AuthorityMSP", "Pad2MSP"}
    finally:
        await bringing_up.bring_up(running.network, running.binaries, quiet)
    again = await expansion.add_organisation(running.network, running.binaries, organisation, quiet, endorsement=policy)
    assert (again.block, again.upgrade.changed) == (None, False)
    assert (await expansion.add_organisation(running.network, running.binaries, organisation, quiet)).upgrade is None
