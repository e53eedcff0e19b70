"""Networks whose servers something else runs: what is written, what is waited for, what is refused."""

import asyncio
import dataclasses
import stat

import pytest
import yaml
from click.testing import CliRunner

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import ConnectionFileError, FileWriteError
from wonderland_fabric_gateway.export import export_identities
from wonderland_fabric_network import bringing_up
from wonderland_fabric_network.agreement import ContractDiffersError, load_agreement
from wonderland_fabric_network.binaries import BY_NAME
from wonderland_fabric_network.commands import network as commands
from wonderland_fabric_network.contract import build_package, installed_contract
from wonderland_fabric_network.description import EACH, NetworkDescription
from wonderland_fabric_network.elsewhere import Elsewhere
from wonderland_fabric_network.errors import ComponentError, DirectoryStateError
from wonderland_fabric_network.hosts import CONTRACT, Hosts
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.processes import Launch


@pytest.fixture
def made(tmp_path):
    return bringing_up.new_network(NetworkDirectory(tmp_path / "net"), NetworkDescription().with_hosts(EACH))


def _run(tmp_path, *arguments):
    return CliRunner().invoke(commands, [*arguments, "--dir", str(tmp_path / "net")])


def test_every_component_has_a_name_of_its_own():
    here, each = Hosts(NetworkDescription()), Hosts(NetworkDescription().with_hosts(EACH))
    assert (here.of("PadMSP", "peer0"), here.bind) == ("127.0.0.1", "127.0.0.1")
    assert (each.of("PadMSP", "peer0"), each.bind) == ("peer0.padmsp", "0.0.0.0")
    assert each.names("PadMSP", CONTRACT) == ("contract-a.padmsp", "contract-b.padmsp", "localhost", "127.0.0.1")


def test_ports_are_the_usual_ones_and_need_no_file(made, tmp_path):
    assert made.address(made.first_peer("PadMSP")) == "peer0.padmsp:7051"
    assert made.ca_address("PadMSP") == "ca.padmsp:7054"
    assert made.contract_address("PadMSP", "b") == "contract-b.padmsp:9999"
    assert not (tmp_path / "net" / "ports.json").exists()


def test_prepare_writes_what_the_cas_need_and_keeps_their_secrets(tmp_path):
    (tmp_path / "my.yaml").write_text("channel: helsinki")
    assert _run(tmp_path, "prepare", "--file", str(tmp_path / "my.yaml")).exit_code == 0
    home = tmp_path / "net" / "organisations" / "PadMSP" / "ca"
    file = home / "fabric-ca-server-config.yaml"
    first = yaml.safe_load(file.read_text())
    assert (first["address"], first["port"]) == ("0.0.0.0", 7054)
    assert "ca.padmsp" in first["csr"]["hosts"]
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert _run(tmp_path, "prepare", "--file", str(tmp_path / "my.yaml")).exit_code == 0
    assert yaml.safe_load(file.read_text()) == first
    described = NetworkDescription.load(tmp_path / "net" / "network.yaml")
    assert (described.channel, described.hosts) == ("helsinki", EACH)


def test_what_needs_our_own_processes_is_refused_with_the_next_step(made, tmp_path, monkeypatch):
    for name in ("peer", "orderer", "fabric-ca-server"):
        (tmp_path / name).write_text("#!/bin/sh\necho ' Version: v3.1.0'")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "fabric-ca-server").write_text("#!/bin/sh\necho ' Version: v1.5.0'")
    monkeypatch.setenv("FABRIC_BIN", str(tmp_path))
    with pytest.raises(DirectoryStateError, match=r"something else starts and stops them. Next: see docs/operate"):
        made.require_here()
    answer = _run(tmp_path, "up")
    assert answer.exit_code == 1
    assert "something else starts and stops" in " ".join(answer.output.split())


def test_a_server_that_does_not_answer_is_named_with_where_to_look(tmp_path):
    elsewhere = Elsewhere(tmp_path, tmp_path)
    launch = Launch("PadMSP.ca", ("fabric-ca-server",), {}, (("127.0.0.1", 1),))
    with pytest.raises(ComponentError, match=r"PadMSP.ca: does not listen on 127.0.0.1:1.*\nNext: start it.*its log"):
        asyncio.run(elsewhere.wait_ready(launch, timeout_s=0))


def test_commands_are_those_of_the_images(made):
    peer = made.launch_peer(made.first_peer("PadMSP"), BY_NAME)
    assert peer.arguments[-3:] == ("peer", "node", "start")
    assert made.launch_contract("PadMSP", "a").arguments[0] == "wonderland"
    assert peer.listens == (("peer0.padmsp", 7051), ("peer0.padmsp", 9443))


class TestExport:
    @pytest.fixture
    def connection(self, tmp_path):
        source = tmp_path / "source"
        source.mkdir()
        for name in ("tls.pem", "pad.pem", "pad.key"):
            (source / name).write_text(name)
        (source / "connection.json").write_text(
            '{"channel":"c","chaincode":"pol","gateway":{"address":"h:1","tls_ca":"tls.pem","server_name":"h"},'
            '"identities":{"pad":{"msp_id":"PadMSP","certificate":"pad.pem","key":"pad.key"}}}'
        )
        return Connection.load(source)

    def test_one_machine_gets_its_own_and_no_more(self, connection, tmp_path):
        export_identities(connection, ["pad"], tmp_path / "out")
        moved = Connection.load(tmp_path / "out")
        assert moved.files("pad").key.read_text() == "pad.key"
        assert moved.gateway.tls_ca.read_text() == "tls.pem"
        assert stat.S_IMODE(moved.files("pad").key.stat().st_mode) == 0o600
        with pytest.raises(FileWriteError, match="is not empty"):
            export_identities(connection, ["pad"], tmp_path / "out")
        export_identities(connection, ["pad"], tmp_path / "out", again=True)

    def test_an_unknown_name_writes_nothing(self, connection, tmp_path):
        with pytest.raises(ConnectionFileError, match=r"identities\.nobody"):
            export_identities(connection, ["nobody"], tmp_path / "out")
        assert not (tmp_path / "out").exists()


@pytest.mark.fabric
@pytest.mark.timeout(180)
async def test_join_agrees_on_another_contract_only_when_it_is_told_to(running, monkeypatch):
    """As with a new image: its contract servers serve another package, and nothing is agreed on by accident."""
    network = running.network
    slot = load_agreement(network.directory.contract_file).slot
    ours = installed_contract("pol")
    other = dataclasses.replace(ours, sha256="0" * 64)

    async def served(contract):
        package = build_package("pol", contract, slot)
        for msp_id in network.endorsers:
            network.configure_contract(msp_id, package)
            launch = network.launch_contract(msp_id, slot)
            await network.processes.stop(launch.name)
            network.processes.start(launch)
            await network.processes.wait_ready(launch)

    steps = bringing_up.BringUp(network, running.binaries, lambda _step, _text: None)
    sequence = load_agreement(network.directory.contract_file).sequence
    for number, contract in enumerate((other, ours), 1):
        monkeypatch.setattr(bringing_up, "installed_contract", lambda _package, contract=contract: contract)
        await served(contract)
        with pytest.raises(ContractDiffersError, match="the organisations agreed on contract version"):
            await steps.join()
        await steps.join(agree=True)
        agreed = load_agreement(network.directory.contract_file)
        assert (agreed.sequence, agreed.sha256, agreed.slot) == (sequence + number, contract.sha256, slot)
        await running.register_pad()
    await steps.join()
