"""A network's directory: ports, locks, certificates, notes, and Fabric's programs."""

import datetime as dt
import json
import os
import socket
import stat

import pytest

from wonderland_fabric_gateway.ca import Kind, LocalCa
from wonderland_fabric_network import agreement, binaries, bringing_up, certificates, ports
from wonderland_fabric_network.contract import InstalledContract
from wonderland_fabric_network.description import NetworkDescription, Organisation
from wonderland_fabric_network.errors import (
    BinaryError,
    CertificateStateError,
    DescriptionError,
    DirectoryStateError,
    PortInUseError,
)
from wonderland_fabric_network.layout import IdentityPaths, NetworkDirectory

NOW = dt.datetime(2026, 6, 1, tzinfo=dt.UTC)


def _listener():
    listener = socket.create_server(("127.0.0.1", 0))
    return listener, listener.getsockname()[1]


def test_ports_are_chosen_once_and_kept(tmp_path, description):
    first = ports.allot(tmp_path / "ports.json", description, os.urandom)
    assert ports.allot(tmp_path / "ports.json", description, os.urandom) == first
    assert len(set(first.by_name.values())) == len(first.by_name)
    assert all(15_000 <= port < 32_000 for port in first.by_name.values())


def test_what_joins_later_gets_ports_of_its_own(tmp_path, description):
    first = ports.allot(tmp_path / "ports.json", description, os.urandom)
    more = description.with_organisation(Organisation(msp_id="Pad2MSP", kind="pads"))
    second = ports.allot(tmp_path / "ports.json", more, os.urandom)
    assert first.by_name.items() <= second.by_name.items()
    assert second["Pad2MSP/peer0/listen"] not in first.by_name.values()


def test_counted_ports_begin_where_the_description_says(tmp_path, description):
    count = len(ports.needed(description))
    first = next(
        base
        for base in range(20_000, 32_000, count)
        if all(ports.is_free("127.0.0.1", base + offset) for offset in range(count))
    )
    allotted = ports.allot(tmp_path / "ports.json", NetworkDescription(first_port=first), os.urandom)
    assert sorted(allotted.by_name.values()) == list(range(first, first + count))


def test_a_port_that_is_taken_is_named(tmp_path):
    listener, port = _listener()
    with listener, pytest.raises(PortInUseError, match=f"port {port} of 127.0.0.1 is in use") as raised:
        ports.allot(tmp_path / "ports.json", NetworkDescription(first_port=port), os.urandom)
    assert "Next: " in str(raised.value)


def test_an_address_of_another_machine_is_named():
    with pytest.raises(PortInUseError, match="cannot be listened on"):
        ports.is_free("192.0.2.1", 15_000)


@pytest.mark.parametrize("text", ["[1]", "{", '{"a": "b"}', '{"a": 0}', '{"a": 15000, "b": 15000}'])
def test_a_damaged_ports_file_is_named(tmp_path, description, text):
    (tmp_path / "ports.json").write_text(text)
    with pytest.raises(DirectoryStateError, match=r"ports\.json"):
        ports.allot(tmp_path / "ports.json", description, os.urandom)


def test_one_command_at_a_time(tmp_path):
    directory = NetworkDirectory(tmp_path)
    with (
        directory.lock(),
        pytest.raises(DirectoryStateError, match="another `wonderland network` command"),
        NetworkDirectory(tmp_path).lock(),
    ):
        pass
    with directory.lock():
        pass


def test_no_network_yet(tmp_path):
    with pytest.raises(DirectoryStateError, match="there is no network in"):
        bringing_up.open_network(NetworkDirectory(tmp_path))


def test_another_description_is_refused(tmp_path):
    bringing_up.new_network(NetworkDirectory(tmp_path / "net"), NetworkDescription())
    with pytest.raises(DirectoryStateError, match="holds a network of another description"):
        bringing_up.new_network(NetworkDirectory(tmp_path / "net"), NetworkDescription().with_ordering("bft"))
    again = bringing_up.new_network(NetworkDirectory(tmp_path / "net"), None)
    assert again.description == NetworkDescription()


def test_the_directory_is_private(tmp_path):
    directory = NetworkDirectory(tmp_path / "net")
    directory.prepare()
    assert stat.S_IMODE(directory.path.stat().st_mode) == 0o700


def test_a_file_where_the_directory_should_be(tmp_path):
    (tmp_path / "net").write_text("")
    with pytest.raises(DirectoryStateError, match="cannot be used as a network's directory"):
        NetworkDirectory(tmp_path / "net").prepare()


class TestCertificates:
    @pytest.fixture
    def ca(self, tmp_path):
        return LocalCa.create(tmp_path / "ca", "PadMSP", now=lambda: NOW)

    @pytest.fixture
    def paths(self, ca, tmp_path):
        enrolment = ca.enrol("peer0", node_ou="peer")
        enrolment.write(tmp_path / "peer", "peer0")
        return IdentityPaths(tmp_path / "peer" / "peer0.pem", tmp_path / "peer" / "peer0.key")

    @pytest.fixture
    def root(self, ca, tmp_path):
        (tmp_path / "root.pem").write_bytes(ca.root_pem(Kind.IDENTITY))
        return certificates.load(tmp_path / "root.pem")

    def test_a_pair_fits(self, paths, root):
        assert certificates.fits(paths)
        certificates.require_usable(paths.certificate, root, NOW, "PadMSP/peer0")

    def test_a_write_that_was_interrupted_does_not_fit(self, paths, ca, tmp_path):
        ca.enrol("other").write(tmp_path / "other", "other")
        paths.key.write_bytes((tmp_path / "other" / "other.key").read_bytes())
        assert not certificates.fits(paths)
        paths.key.write_bytes(b"half a key")
        assert not certificates.fits(paths)
        paths.key.unlink()
        assert not certificates.fits(paths)

    def test_an_expired_certificate_says_what_to_do(self, paths, root):
        with pytest.raises(CertificateStateError, match=r"PadMSP/peer0: .* expired on 2027-06-01.*network renew"):
            certificates.require_usable(paths.certificate, root, NOW + dt.timedelta(days=400), "PadMSP/peer0")

    def test_a_clock_that_is_an_hour_slow_is_said(self, paths, root):
        with pytest.raises(CertificateStateError, match=r"valid only from .* set the clock right"):
            certificates.require_usable(paths.certificate, root, NOW - dt.timedelta(hours=1), "PadMSP/peer0")

    def test_a_certificate_of_another_ca_is_said(self, paths, tmp_path):
        other = LocalCa.create(tmp_path / "other-ca", "PadMSP", now=lambda: NOW)
        (tmp_path / "root.pem").write_bytes(other.root_pem(Kind.IDENTITY))
        root = certificates.load(tmp_path / "root.pem")
        with pytest.raises(CertificateStateError, match="not by its organisation's CA"):
            certificates.require_usable(paths.certificate, root, NOW, "PadMSP/peer0")

    def test_keys_are_for_their_owner_only(self, tmp_path):
        paths = IdentityPaths(tmp_path / "a" / "x.pem", tmp_path / "b" / "x.key")
        key = certificates.ec.generate_private_key(certificates.ec.SECP256R1())
        certificates.store(paths, b"certificate", key)
        assert stat.S_IMODE(paths.key.stat().st_mode) == 0o600
        assert stat.S_IMODE(paths.key.parent.stat().st_mode) == 0o700
        assert certificates.load_key(paths.key).private_numbers() == key.private_numbers()

    def test_what_is_no_certificate_or_key_is_named(self, tmp_path):
        (tmp_path / "x").write_bytes(b"rubbish")
        with pytest.raises(CertificateStateError, match="no PEM certificate"):
            certificates.load(tmp_path / "x")
        with pytest.raises(CertificateStateError, match="no unencrypted PEM private key"):
            certificates.load_key(tmp_path / "x")
        with pytest.raises(CertificateStateError, match="cannot read"):
            certificates.load(tmp_path / "none")


class TestAgreement:
    NOTE = agreement.Agreement(3, "1.0", "ab" * 32, "b", "pol_1.0:" + "cd" * 32)

    def test_a_note_reads_back(self, tmp_path):
        assert agreement.load_agreement(tmp_path / "contract.json") is None
        agreement.save_agreement(tmp_path / "contract.json", self.NOTE)
        assert agreement.load_agreement(tmp_path / "contract.json") == self.NOTE

    @pytest.mark.parametrize("change", [{"sequence": "x"}, {"slot": "c"}, {"version": None, "slot": None}])
    def test_a_damaged_note_is_named(self, tmp_path, change):
        agreement.save_agreement(tmp_path / "contract.json", self.NOTE)
        document = json.loads((tmp_path / "contract.json").read_text())
        (tmp_path / "contract.json").write_text(json.dumps({**document, **change}))
        with pytest.raises(DirectoryStateError, match="delete it"):
            agreement.load_agreement(tmp_path / "contract.json")

    def test_another_contract_than_agreed_is_refused(self):
        agreement.require_installed(self.NOTE, InstalledContract("pol", "1.0", "ab" * 32))
        for other in (InstalledContract("pol", "1.1", "ab" * 32), InstalledContract("pol", "1.0", "ef" * 32)):
            with pytest.raises(agreement.ContractDiffersError, match="network upgrade"):
                agreement.require_installed(self.NOTE, other)


class TestBinaries:
    @pytest.fixture
    def fake(self, tmp_path):
        def make(name, text, code=0):
            path = tmp_path / name
            path.write_text(f"#!/bin/sh\nprintf '%b' {text!r}\nexit {code}\n")
            path.chmod(0o755)
            return path

        return make

    def test_all_that_is_missing_is_named_with_where_to_get_it(self, tmp_path):
        with pytest.raises(BinaryError) as raised:
            binaries.find_binaries({"FABRIC_BIN": str(tmp_path), "PATH": str(tmp_path)})
        text = str(raised.value)
        assert "peer, orderer, fabric-ca-server not found" in text
        assert f"FABRIC_BIN={tmp_path}" in text
        assert "github.com/hyperledger/fabric/releases" in text
        with pytest.raises(BinaryError, match="FABRIC_BIN is not set"):
            binaries.find_binaries({"PATH": str(tmp_path)})

    async def test_fabric_bin_comes_before_path(self, tmp_path, fake):
        for name in binaries.SERVERS:
            fake(name, f"{name}:\n Version: 3.1.5\n" if name != "fabric-ca-server" else " Version: v1.5.15\n")
        found = await binaries.check_binaries({"FABRIC_BIN": str(tmp_path), "PATH": "/usr/bin"})
        assert found.peer == tmp_path / "peer"
        assert found.versions == {"peer": "3.1.5", "orderer": "3.1.5", "fabric-ca-server": "1.5.15"}

    @pytest.mark.parametrize(
        ("version", "fine"),
        [("3.1.0", True), ("3.2.7", True), ("latest", True), ("2.5.12", False), ("3.0.0", False), ("4.0.0", False)],
    )
    def test_the_version_must_do(self, tmp_path, version, fine):
        if fine:
            binaries.require_version("peer", tmp_path, version)
        else:
            with pytest.raises(BinaryError, match=f"is version {version}; needed is 3.1"):
                binaries.require_version("peer", tmp_path, version)

    async def test_what_is_no_fabric_server_is_said(self, tmp_path, fake):
        for name in binaries.SERVERS:
            fake(name, "hello")
        with pytest.raises(BinaryError, match="does not say its version"):
            await binaries.check_binaries({"FABRIC_BIN": str(tmp_path)})

    async def test_what_cannot_be_run_is_said(self, tmp_path, fake):
        for name in binaries.SERVERS:
            fake(name, "x").write_bytes(b"\x7fELF not really")
        with pytest.raises(BinaryError, match="cannot be run"):
            await binaries.check_binaries({"FABRIC_BIN": str(tmp_path)})


def test_a_contract_that_is_not_installed_leaves_nothing_behind(tmp_path):
    described = NetworkDescription.parse({"contract": {"package": "nothing"}})
    with pytest.raises(Exception, match="no contract 'nothing' is installed"):
        bringing_up.new_network(NetworkDirectory(tmp_path / "net"), described)
    assert not (tmp_path / "net" / "network.yaml").exists()


def test_description_errors_have_the_file(tmp_path):
    (tmp_path / "network.yaml").write_text("nonsense: 1")
    with pytest.raises(DescriptionError, match=r"network\.yaml: nonsense"):
        bringing_up.open_network(NetworkDirectory(tmp_path))
