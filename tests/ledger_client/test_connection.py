"""connection.json: read, written, and every wrong field named."""

from __future__ import annotations

import contextlib
import hashlib
import json
import stat

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.connection import ClientTls, Connection, GatewayAddress, IdentityFiles, LedgerKind
from wonderland_fabric_gateway.errors import ConnectionFileError, FileWriteError
from wonderland_fabric_gateway.export import export_identities


@pytest.fixture
def document():
    return {
        "channel": "wonderland",
        "chaincode": "pol",
        "gateway": {"address": "127.0.0.1:7051", "tls_ca": "tls-ca.pem", "server_name": "localhost"},
        "identities": {"pad": {"msp_id": "PadMSP", "certificate": "ids/pad.pem", "key": "ids/pad.key"}},
        "ledger": {"kind": "embedded", "notice": "No multi-party trust."},
        "a later field": [1, 2, None],
    }


@pytest.fixture
def write(tmp_path):
    def apply(document):
        path = tmp_path / "connection.json"
        path.write_text(json.dumps(document))
        return path

    return apply


def test_it_is_read(document, write, tmp_path):
    connection = Connection.load(write(document))
    assert (connection.channel, connection.chaincode) == ("wonderland", "pol")
    assert connection.gateway == GatewayAddress("127.0.0.1:7051", tmp_path / "tls-ca.pem", "localhost")
    assert connection.identities["pad"].key == tmp_path / "ids" / "pad.key"
    assert connection.ledger == LedgerKind("embedded", "No multi-party trust.")
    assert Connection.load(tmp_path) == connection


def test_further_gateways_and_a_client_certificate(document, write, tmp_path):
    other = {"address": "127.0.0.1:7052", "tls_ca": "tls-ca.pem", "server_name": "peer1"}
    document["gateways"] = [other]
    document["client_tls"] = {"certificate": "client.pem", "key": "client.key"}
    connection = Connection.load(write(document))
    assert connection.others == (GatewayAddress("127.0.0.1:7052", tmp_path / "tls-ca.pem", "peer1"),)
    assert connection.client_tls == ClientTls(tmp_path / "client.pem", tmp_path / "client.key")
    (tmp_path / "sub").mkdir()
    connection.save(tmp_path / "sub" / "connection.json")
    written = json.loads((tmp_path / "sub" / "connection.json").read_text())
    assert written["gateways"] == [{**other, "tls_ca": "../tls-ca.pem"}]
    assert written["client_tls"] == {"certificate": "../client.pem", "key": "../client.key"}


async def test_channels_to_all_gateways_show_the_certificate(document, write, tmp_path, ca):
    enrolment = ca.enrol("client")
    (tmp_path / "client.pem").write_bytes(enrolment.identity.certificate_pem)
    (tmp_path / "client.key").write_bytes(enrolment.private_key_pem)
    (tmp_path / "tls-ca.pem").write_bytes(ca.root_pem())
    document["gateways"] = [{"address": "127.0.0.1:7052", "tls_ca": "tls-ca.pem", "server_name": "peer1"}]
    document["client_tls"] = {"certificate": "client.pem", "key": "client.key"}
    async with Connection.load(write(document)).open_channel() as gateways:
        assert [gateways.address(index) for index in range(len(gateways))] == ["127.0.0.1:7051", "127.0.0.1:7052"]
        assert gateways.tls_certificate_sha256 == hashlib.sha256(enrolment.identity.certificate_der).digest()
    (tmp_path / "client.pem").write_text("nonsense")
    with pytest.raises(ConnectionFileError, match=r"client_tls\.certificate"):
        Connection.load(write(document)).open_channel()


def test_an_export_takes_everything_along(document, write, tmp_path):
    for name in ("tls-ca.pem", "client.pem", "client.key", "ids/pad.pem", "ids/pad.key"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    document["gateways"] = [{"address": "127.0.0.1:7052", "tls_ca": "tls-ca.pem", "server_name": "peer1"}]
    document["client_tls"] = {"certificate": "client.pem", "key": "client.key"}
    export_identities(Connection.load(write(document)), ["pad"], tmp_path / "machine")
    moved = Connection.load(tmp_path / "machine")
    assert moved.others[0].tls_ca.read_text() == "tls-ca.pem"
    assert (moved.client_tls.certificate_pem(), moved.client_tls.key_pem()) == (b"client.pem", b"client.key")
    assert all(each.parent == tmp_path / "machine" for each in (moved.client_tls.key, moved.others[0].tls_ca))


def test_ledger_and_identities_are_optional(document, write):
    del document["ledger"], document["identities"]
    connection = Connection.load(write(document))
    assert connection.ledger is None
    assert connection.identities == {}


def test_written_and_read_back(document, write, tmp_path):
    connection = Connection.load(write(document)).with_identity(
        "uav", IdentityFiles("FleetMSP", tmp_path / "elsewhere" / "uav.pem", tmp_path / "uav.key")
    )
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / "connection.json"
    connection.save(path)
    written = json.loads(path.read_text())
    assert written["identities"]["uav"]["certificate"] == "../elsewhere/uav.pem"
    assert written["gateway"]["tls_ca"] == "../tls-ca.pem"
    again = Connection.load(path)
    assert {name: files.key.resolve() for name, files in again.identities.items()} == {
        name: files.key.resolve() for name, files in connection.identities.items()
    }
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert set(again.without_identity("uav").identities) == {"pad"}


def test_writing_where_nothing_can_be_written(document, write, tmp_path):
    connection = Connection.load(write(document))
    with pytest.raises(FileWriteError, match="not written"):
        connection.save(tmp_path / "missing" / "connection.json")


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["channel"], None, "channel is missing"),
        (["channel"], 3, "channel is not"),
        (["channel"], "", "channel is not"),
        (["chaincode"], "x" * 5000, "chaincode has 5000"),
        (["gateway"], None, "gateway is missing"),
        (["gateway"], [], "gateway is not a JSON object"),
        (["gateway", "address"], "localhost", "gateway.address"),
        (["gateway", "address"], "localhost:0", "gateway.address"),
        (["gateway", "address"], "localhost:65536", "gateway.address"),
        (["gateway", "address"], ":7051", "gateway.address"),
        (["gateway", "address"], "h:７０５１", "gateway.address"),
        (["gateway", "tls_ca"], None, "gateway.tls_ca is missing"),
        (["gateway", "tls_ca"], "a\0b", "gateway.tls_ca"),
        (["gateway", "server_name"], None, "gateway.server_name is missing"),
        (["gateways"], {}, "gateways is not a list"),
        (["gateways"], [{}] * 21, "gateways is not a list of at most 20"),
        (["gateways"], [3], r"gateways\[0\] is not a JSON object"),
        (["gateways"], [{"address": "x"}], r"gateways\[0\].address is 'x'"),
        (["client_tls"], None, "client_tls is missing"),
        (["client_tls"], {"certificate": "a"}, "client_tls.key is missing"),
        (["identities"], [], "identities is not"),
        (["identities", "pad"], "x", "identities.pad is not"),
        (["identities", "pad", "key"], None, "identities.pad.key is missing"),
        (["identities", "pad", "msp_id"], 1, "identities.pad.msp_id is not"),
        (["ledger"], 1, "ledger is not"),
        (["ledger", "kind"], None, "ledger.kind is missing"),
        (["ledger", "notice"], 1, "ledger.notice is not"),
    ],
)
def test_what_is_wrong_is_named(document, write, path, value, words):
    place = document
    for name in path[:-1]:
        place = place[name]
    place[path[-1]] = value
    with pytest.raises(ConnectionFileError, match=words):
        Connection.load(write(document))


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"[]", b"3", b"[" * 100_000])
def test_no_document(tmp_path, content):
    (tmp_path / "connection.json").write_bytes(content)
    with pytest.raises(ConnectionFileError):
        Connection.load(tmp_path)


def test_no_file(tmp_path):
    with pytest.raises(ConnectionFileError, match="cannot read"):
        Connection.load(tmp_path / "connection.json")


def test_identities_and_signers(document, write, tmp_path, pad):
    connection = Connection.load(write(document))
    with pytest.raises(ConnectionFileError, match=r"identities\.pad\.certificate"):
        connection.identity("pad")
    with pytest.raises(ConnectionFileError, match=r"identities\.pad\.key"):
        connection.signer("pad")
    with pytest.raises(ConnectionFileError, match="there are: pad"):
        connection.identity("uav")
    pad.enrolment.write(tmp_path / "ids", "pad")
    assert connection.identity("pad") == pad.identity
    assert connection.signer("pad")(b"m")


async def test_a_channel_needs_its_root(document, write):
    with pytest.raises(ConnectionFileError, match=r"gateway\.tls_ca"):
        Connection.load(write(document)).open_channel()


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(["channel", "gateway", "identities", "chaincode", "ledger", "address"]), inner
            )
        ),
        max_leaves=12,
    )
)
def test_any_json_is_a_typed_error_or_a_connection(write, document):
    with contextlib.suppress(ConnectionFileError):
        Connection.load(write(document))
