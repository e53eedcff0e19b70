"""A machine gets its certificates and its keys never leave it: on the embedded ledger, on SoftHSM, and files that lie."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from wonderland.cli import main
from wonderland.enrolment.machine import Place, accept, make_request, renew
from wonderland.enrolment.records import Admission, EnrolmentError, EnrolmentRequest, code
from wonderland.proofs import encoding
from wonderland.proofs.errors import RecordError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway

WONDERLAND = Path(sys.executable).with_name("wonderland")
NOW = dt.datetime(2026, 11, 1, tzinfo=dt.UTC)


def run(*arguments, exit_code=0):
    done = CliRunner().invoke(main, list(map(str, arguments)))
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    assert done.exit_code == exit_code, done.output
    return done.output


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The directory of an embedded ledger that runs."""
    directory = tmp_path_factory.mktemp("ledger")
    command = [WONDERLAND, "ledger", "start", "--data", directory, "--listen", "127.0.0.1:0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline()
        yield directory
        process.terminate()


async def registered(place, identity, pad_id):
    """A transaction as that identity, by the connection.json that the machine wrote."""
    where = Connection.load(place)
    async with where.open_channel() as channel:
        network = Gateway(channel, where.identity(identity), where.signer(identity)).network(where.channel)
        pad = {"pad_id": pad_id, "name": "Roof", "operator_id": "op", "lat_e7": 1, "lon_e7": 1, "height_mm": 0}
        await network.contract(where.chaincode).submit_with_retry("RegisterPad", json.dumps(pad))


def test_from_a_request_to_a_transaction_and_no_key_travels(data, tmp_path):
    place = tmp_path / "machine"
    asked = run("enrol", "request", "roof-operator", "--role", "pad_operator", "--dir", place)
    shown = re.search(r"its code   (\S+)", asked)[1]
    request = place / "roof-operator.request"
    assert run("enrol", "request", "roof-operator", "--role", "pad_operator", "--dir", place) == asked, "once more"
    carried = tmp_path / "carried.request"
    carried.write_bytes(request.read_bytes())
    admitted = run("enrol", "admit", carried, "--data", data, "--yes")
    assert re.findall(r"its code   (\S+)", admitted)[0] == shown
    admission = tmp_path / "roof-operator.admission"
    for file in (carried, admission):
        assert "PRIVATE" not in file.read_text()
    answer = run("enrol", "accept", admission, "--dir", place, "--yes")
    assert re.search(r"its code   (\S+)", answer)[1] == re.findall(r"its code   (\S+)", admitted)[1]
    assert not request.exists()
    for key in place.glob("*.key"):
        assert key.stat().st_mode & 0o077 == 0
        load_pem_private_key(key.read_bytes(), None)
    asyncio.run(registered(place, "roof-operator", "enrolled-1"))
    run("enrol", "request", "pad-20", "--role", "pad", "--dir", place)
    run("enrol", "admit", place / "pad-20.request", "--data", data, "--yes")
    again = run("enrol", "accept", place / "pad-20.admission", "--dir", place, "--yes", exit_code=1)
    assert "is that of roof-operator already" in again
    assert not list(data.rglob("*roof-operator*key*")), "the ledger's directory never had it"


def test_one_that_was_admitted_gets_a_newer_certificate_and_none_for_another_role(data, tmp_path):
    for name, role, says in (
        ("twice", "pad", ""),
        ("twice", "pad", ""),
        ("twice", "pad_operator", "another role or id"),
    ):
        place = tmp_path / f"{role}-{os.urandom(4).hex()}"
        run("enrol", "request", name, "--role", role, "--dir", place)
        file = place / f"{name}.request"
        said = run("enrol", "admit", file, "--data", data, "--yes", exit_code=1 if says else 0)
        assert says in said
    place = tmp_path / "node"
    run("enrol", "request", "msp-admin", "--role", "pad", "--dir", place)
    assert "belongs to the ledger itself" in run(
        "enrol", "admit", place / "msp-admin.request", "--data", data, "--yes", exit_code=1
    )


def test_nobody_is_admitted_who_was_not_looked_at(data, tmp_path):
    run("enrol", "request", "pad-8", "--role", "pad", "--dir", tmp_path)
    said = run("enrol", "admit", tmp_path / "pad-8.request", "--data", data, exit_code=1)  # no answer
    assert "Does the machine show the same code?" in said
    assert not (tmp_path / "pad-8.admission").exists()


@pytest.fixture
def asked(tmp_path):
    """A place whose request waits, and the request."""
    place = Place(tmp_path / "asked")
    return place, make_request(place, "pad-9", "pad", "pad-9", key=None, now=NOW, random_bytes=os.urandom)


def test_a_request_with_anothers_key_or_name_is_refused(asked, tmp_path):
    _, request = asked
    other = make_request(Place(tmp_path / "x"), "pad-10", "pad", "pad-10", key=None, now=NOW, random_bytes=os.urandom)
    for lie, says in (
        ({"request": other.request}, "request: is for 'pad-10', not for 'pad-9'"),
        ({"tls_request": request.request}, "has the identity's key"),
        ({"name": "../../etc/x"}, "does not match"),
        ({"role": "king"}, "role"),
        ({"request": request.request.replace("A", "B")}, "request"),
        ({"key": "kept"}, "unknown field"),
    ):
        with pytest.raises(EnrolmentError, match=re.escape(says)):
            EnrolmentRequest.read(encoding.encode(request.to_json() | lie), "a.request")
    with pytest.raises(EnrolmentError, match=r"a\.request: no request"):
        EnrolmentRequest.read(b"\x00", "a.request")


def admission_for(request, certificate, **fields):
    document = {
        "request_sha256": request.sha256,
        "msp_id": "PadMSP",
        "certificate": certificate,
        "channel": "wonderland",
        "chaincode": "pol",
        "gateways": [{"address": "127.0.0.1:7051", "server_name": "localhost"}],
        "tls_root": certificate,
    }
    return Admission.parse(document | fields)


def test_an_admission_of_another_request_or_key_is_refused(data, asked, tmp_path):
    place, request = asked
    run("enrol", "request", "pad-11", "--role", "pad", "--dir", tmp_path / "o")
    run("enrol", "admit", tmp_path / "o" / "pad-11.request", "--data", data, "--yes")
    theirs = Admission.read((tmp_path / "o" / "pad-11.admission").read_bytes(), "x")
    with pytest.raises(EnrolmentError, match="answers another request"):
        accept(place, theirs)
    for field in ("certificate", "tls_certificate"):
        lie = replace(theirs, request_sha256=request.sha256, **{field: theirs.certificate})
        with pytest.raises(EnrolmentError, match="for another key than the one of here"):
            accept(place, lie)
    assert not place.connection.exists()
    with pytest.raises(EnrolmentError, match="no request waits here"):
        accept(Place(tmp_path / "empty"), theirs)
    with pytest.raises(RecordError, match="address"):
        admission_for(request, theirs.certificate, gateways=[{"address": "peer", "server_name": "x"}])
    assert len(code(request.sha256)) == 24


def test_without_a_ca_renewal_says_what_to_do(data, tmp_path):
    place = tmp_path / "machine"
    run("enrol", "request", "pad-12", "--role", "pad", "--dir", place)
    run("enrol", "admit", place / "pad-12.request", "--data", data, "--yes")
    run("enrol", "accept", place / "pad-12.admission", "--dir", place, "--yes")
    assert "nothing ends within 30 days" in run("enrol", "renew", "--dir", place)
    said = run("enrol", "renew", "--dir", place, "--days", 3_650, exit_code=1)
    assert "names no CA of PadMSP to renew with" in said
    connection = Connection.load(place)
    with pytest.raises(EnrolmentError, match="names no CA"):
        asyncio.run(renew(connection, "pad-12", within=dt.timedelta(days=3_650), now=dt.datetime.now(dt.UTC)))
