"""What a start finds and leaves on disk."""

import asyncio
import datetime as dt
import json
import os
import stat

import pytest
from cryptography import x509

from wonderland_fabric_gateway.addresses import split_address
from wonderland_fabric_gateway.ca import Kind, LocalCa
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.contracts import check_contract, load_contract
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.embedded.errors import ContractLoadError, DirectoryError, LedgerLockedError
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.errors import AddressError, ConnectionFileError


@pytest.fixture
async def first(tmp_path, open_world):
    """A ledger on its first start."""
    async with open_world(tmp_path / "first", first_start=True) as running:
        yield running


async def test_a_first_start_enrols_every_role(first):
    world = first
    connection = Connection.load(world.ledger.directory.path)
    assert set(connection.identities) == set(orgs.ROLES)
    for name, role in orgs.ROLES.items():
        identity = connection.identity(name)
        assert (identity.msp_id, identity.role, identity.pol_id) == (role.msp_id, name, role.pol_id)
        assert identity.node_ou == "client"
    assert connection.identity("pad").pol_id == "pad-1"
    assert connection.identity("uav").pol_id == "uav-1"
    document = json.loads(world.ledger.directory.connection_file.read_text())
    assert document["ledger"] == {"kind": "embedded", "notice": NOTICE}
    assert document["gateway"]["tls_ca"] == "tls-ca.pem"


async def test_keys_are_private(first):
    world = first
    for path in world.ledger.directory.path.rglob("*.key"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600, path
    assert stat.S_IMODE(world.ledger.directory.path.stat().st_mode) == 0o700


async def test_a_second_start_keeps_all_identities(tmp_path, open_world):
    def contents():
        return {each: each.read_bytes() for each in (tmp_path / "l").rglob("*") if each.suffix in {".pem", ".key"}}

    async with open_world(tmp_path / "l") as world:
        first = world.connection
    before = contents()
    async with open_world(tmp_path / "l") as world:
        assert world.connection.identities == first.identities
    assert contents() == before


async def test_two_ledgers_in_one_directory(tmp_path, open_world, toy_contract):
    async with open_world(tmp_path / "l"):
        second = EmbeddedLedger(tmp_path / "l", {"pol": toy_contract})
        with pytest.raises(LedgerLockedError, match=rf"already runs in .*process {os.getpid()}"):
            await second.start()
        assert LedgerDirectory(tmp_path / "l").running_pid() == os.getpid()
    assert LedgerDirectory(tmp_path / "l").running_pid() is None
    async with second:
        pass


async def test_a_port_that_is_taken(tmp_path, open_world, toy_contract):
    async with open_world(tmp_path / "a") as world:
        other = EmbeddedLedger(
            tmp_path / "b", {"pol": toy_contract}, LedgerSettings(listen=world.connection.gateway.address)
        )
        with pytest.raises(DirectoryError, match="cannot listen"):
            await other.start()
        assert LedgerDirectory(tmp_path / "b").running_pid() is None


@pytest.mark.parametrize("interrupted_after", range(0, 70, 3))
async def test_a_first_start_that_was_interrupted_is_completed(tmp_path, open_world, monkeypatch, interrupted_after):
    """The first start dies at its n-th durable file; whatever is there by then, the next one serves."""
    from wonderland_fabric_gateway import files

    class Killed(BaseException):
        pass

    count = 0
    real = os.fsync

    def fsync(handle):
        nonlocal count
        count += 1
        if count > interrupted_after:
            raise Killed
        real(handle)

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fsync", fsync)
        with pytest.raises(Killed):
            async with open_world(tmp_path / "l", first_start=True):
                pass
    async with open_world(tmp_path / "l", first_start=True) as world:
        assert set(world.connection.identities) == set(orgs.ROLES)
        for name in orgs.ROLES:
            assert (await world.contract(name).submit("put", name, "v")).payload == b"v"


async def test_a_certificate_whose_key_was_not_written_is_replaced(tmp_path, open_world):
    async with open_world(tmp_path / "l"):
        pass
    node = tmp_path / "l" / "node"
    (node / "peer-PadMSP.key").write_bytes((node / "peer-AuthorityMSP.key").read_bytes())
    (node / "tls.key").unlink()
    async with open_world(tmp_path / "l") as world:
        assert (await world.contract().submit("put", "k", "v")).block_number == 1


async def test_node_certificates_are_renewed_before_they_expire(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        old = world.chain.settings.signers.orderer.identity.certificate_sha256
        clock = world.clock
    clock.offset = dt.timedelta(days=5 * 365 - 10)
    async with open_world(tmp_path / "l", clock=clock) as world:
        assert world.chain.settings.signers.orderer.identity.certificate_sha256 != old


async def test_a_node_certificate_that_was_revoked_is_replaced(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        world.ledger.directory.ca(orgs.PAD).revoke(name="peer")
    async with open_world(tmp_path / "l") as world:
        assert (await world.contract().submit("put", "k", "v")).payload == b"v"


async def test_the_tls_certificate_names_where_the_ledger_is_reached(tmp_path, open_world):
    async with open_world(tmp_path / "l", advertise="ledger.example") as world:
        assert world.connection.gateway.server_name == "ledger.example"
        assert world.connection.gateway.address.startswith("ledger.example:")
        pem = (world.ledger.directory.path / "node" / "tls.pem").read_bytes()
        names = x509.load_pem_x509_certificate(pem).extensions.get_extension_for_class(x509.SubjectAlternativeName)
        assert {"localhost", "ledger.example"} <= set(names.value.get_values_for_type(x509.DNSName))
        assert "127.0.0.1" in {str(each) for each in names.value.get_values_for_type(x509.IPAddress)}
    async with open_world(tmp_path / "l") as world:
        assert world.connection.gateway.server_name == "localhost"
        assert (await world.contract().evaluate("get", "k")) == b"<none>"


async def test_ipv6(tmp_path, open_world):
    try:
        async with open_world(tmp_path / "l", listen="[::1]:0") as world:
            assert world.connection.gateway.address.startswith("[::1]:")
            assert (await world.contract().evaluate("get", "k")) == b"<none>"
    except DirectoryError:
        pytest.skip("this machine has no IPv6 loopback")


async def test_a_client_that_trusts_another_root_does_not_connect(tmp_path, world):
    from dataclasses import replace

    from wonderland_fabric_gateway.gateway import EvaluateError, Gateway

    other = tmp_path / "other.pem"
    other.write_bytes(LocalCa.create(tmp_path / "otherca", "OtherMSP").root_pem(Kind.TLS))
    connection = replace(world.connection, gateway=replace(world.connection.gateway, tls_ca=other))
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        with pytest.raises(EvaluateError):
            await asyncio.wait_for(gateway.network("wonderland").contract("pol").evaluate("get", "k"), 5)


async def test_a_broken_connection_file_is_not_overwritten(tmp_path, open_world):
    async with open_world(tmp_path / "l"):
        pass
    (tmp_path / "l" / "connection.json").write_text("{")
    with pytest.raises(ConnectionFileError):
        async with open_world(tmp_path / "l"):
            pass


def test_a_directory_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(DirectoryError, match="cannot be used"):
        LedgerDirectory(tmp_path / "file" / "l").prepare()


@pytest.mark.parametrize("address", ["", "localhost", "localhost:", ":7051", "localhost:x", "localhost:65536", "h:-1"])
def test_addresses_that_are_none(address):
    with pytest.raises(AddressError, match="HOST:PORT"):
        split_address(address)


def test_contracts_are_found_by_name_and_checked():
    with pytest.raises(ContractLoadError, match="no contract 'nix' is installed"):
        load_contract("nix")

    class NotAsync:
        version = "1"

        def invoke(self, stub, function, args):
            return b""

    for wrong in (object(), NotAsync(), None):
        with pytest.raises(ContractLoadError, match="lacks"):
            check_contract("x", wrong)
