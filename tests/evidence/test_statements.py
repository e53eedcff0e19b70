"""Answers that a server signs: what they prove, and what is none."""

from __future__ import annotations

import asyncio
import json
from base64 import b64decode, b64encode
from functools import cache

import httpx
import pytest
from click.testing import CliRunner
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key
from cryptography.x509 import load_der_x509_certificate
from joserfc import jws
from joserfc.errors import JoseError
from joserfc.jwk import ECKey
from kit import PLAIN
from kit.backend_process import ledger, ready, start, stop
from sqlalchemy import select

from wonderland.cli import main
from wonderland.proofs import encoding
from wonderland_backend.db.tables.ledger import VerdictRow
from wonderland_backend.errors import LedgerAway, RowsDiffer
from wonderland_backend.ledger.contents import require_committed
from wonderland_evidence.errors import StatementError, UnreadableError
from wonderland_evidence.statements import compose, verify_statement
from wonderland_evidence.trust import Pins, root_sha256
from wonderland_fabric_gateway.ca import LocalCa
from wonderland_fabric_gateway.signing import key_signer

__all__ = ["ledger"]
CONTENT = {"proof_id": "5e" * 32, "outcome": "verified", "assurance": 2, "text": "näytetty"}


@pytest.fixture(scope="module")
def ca(tmp_path_factory):
    return LocalCa.create(tmp_path_factory.mktemp("ca") / "AuthorityMSP", "AuthorityMSP")


@pytest.fixture(scope="module")
def pins(ca):
    return Pins("wonderland", bytes(32), {"AuthorityMSP": frozenset({root_sha256(ca.root_pem())})})


@cache
def enrolled(ca, name, role):
    enrolment = ca.enrol(name, attributes={"pol.role": role, "pol.id": name})
    return enrolment.identity, key_signer(load_pem_private_key(enrolment.private_key_pem, None))


def said_by(ca, name="mirror", role="mirror", *, issued_s=None, channel="wonderland", content=CONTENT):
    identity, sign = enrolled(ca, name, role)
    begins = int(identity.certificate.not_valid_before_utc.timestamp())
    return compose(
        "proof",
        content,
        channel=channel,
        identity=identity,
        authorities=(ca.root_pem(),),
        issued_s=begins + 60 if issued_s is None else issued_s,
        sign=sign,
    )


def parts_of(text):
    header, payload, signature = text.split(".")
    return json.loads(encoding.from_base64url(header)), json.loads(encoding.from_base64url(payload)), signature


def joined(header, payload, signature):
    return ".".join([*(encoding.to_base64url(json.dumps(each).encode()) for each in (header, payload)), signature])


def test_what_a_server_said_is_read_again(ca, pins):
    found = verify_statement(said_by(ca), pins)
    assert (found.about, found.content, found.msp_id, found.common_name) == ("proof", CONTENT, "AuthorityMSP", "mirror")


def test_a_library_of_others_verifies_it(ca):
    """joserfc, with the key of the first certificate of `x5c`: it is JWS as anybody's."""
    text = said_by(ca)
    header, _, _ = parts_of(text)
    registry = jws.JWSRegistry(algorithms=["ES256"])
    registry.max_header_length = 16_384  # it takes half a kilobyte; two certificates are more
    leaf = load_der_x509_certificate(b64decode(header["x5c"][0]))
    key = ECKey.import_key(leaf.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    assert json.loads(jws.deserialize_compact(text, key, registry=registry).payload)["content"] == CONTENT
    with pytest.raises(JoseError):
        jws.deserialize_compact(text[:-8] + "AAAAAAAA", key, registry=registry)


def test_one_changed_character_anywhere_is_found(ca, pins):
    text = said_by(ca)
    for place in range(0, len(text), 7):
        other = "A" if text[place] != "A" else "B"
        with pytest.raises((UnreadableError, StatementError)):
            verify_statement(text[:place] + other + text[place + 1 :], pins)


@pytest.mark.parametrize("role", ["uav", "pad", "inspector", ""])
def test_members_who_are_no_server_make_none(ca, pins, role):
    with pytest.raises(StatementError, match="only a server's identity"):
        verify_statement(said_by(ca, f"somebody-{role}", role), pins)


def test_another_organisation_does_not_speak_for_this_one(ca, pins, tmp_path):
    other = LocalCa.create(tmp_path / "FleetMSP", "FleetMSP")
    with pytest.raises(StatementError, match="no root that is pinned for 'FleetMSP'"):
        verify_statement(said_by(other), pins)
    both = Pins("wonderland", bytes(32), pins.roots | {"FleetMSP": frozenset({root_sha256(other.root_pem())})})
    assert verify_statement(said_by(other), both).msp_id == "FleetMSP"
    # Its own certificate under the authority's name, and the authority's root beside it.
    identity, sign = enrolled(other, "mirror", "mirror")
    header, payload, _ = parts_of(said_by(other))
    payload["iss"] = "AuthorityMSP"
    header["x5c"].append(parts_of(said_by(ca))[0]["x5c"][1])
    signed = joined(header, payload, "")[:-1]
    r, s = decode_dss_signature(sign(signed.encode()))
    header["x5c"][0] = b64encode(identity.certificate.public_bytes(Encoding.DER)).decode()
    forged = f"{signed}.{encoding.to_base64url(r.to_bytes(32, 'big') + s.to_bytes(32, 'big'))}"
    with pytest.raises(StatementError):
        verify_statement(forged, both)


def test_the_certificate_was_valid_when_it_was_said(ca, pins):
    with pytest.raises(StatementError, match="has expired"):
        verify_statement(said_by(ca, issued_s=4_102_444_800), pins)
    with pytest.raises(StatementError, match="not valid yet"):
        verify_statement(said_by(ca, issued_s=0), pins)
    with pytest.raises(StatementError, match="about channel 'other'"):
        verify_statement(said_by(ca, channel="other"), pins)


def test_headers_that_lead_elsewhere_are_refused(ca, pins):
    header, payload, signature = parts_of(said_by(ca))
    for changed in (
        header | {"alg": "none"},
        header | {"alg": "HS256"},
        header | {"typ": "JWT"},
        header | {"jku": "https://evil.example/keys"},
        {name: value for name, value in header.items() if name != "x5c"},
    ):
        with pytest.raises(UnreadableError, match="the header is none of"):
            verify_statement(joined(changed, payload, signature), pins)
    for chain in ([], header["x5c"][:1], [1, 2], ["AAAA", "AAAA"], header["x5c"] * 9, "x5c"):
        with pytest.raises((UnreadableError, StatementError)):
            verify_statement(joined(header | {"x5c": chain}, payload, signature), pins)


@pytest.mark.parametrize("text", ["", "a.b", "....", "é.é.é", "e30.e30.", "W10.W10.AAAA", "A" * 300_000])
def test_what_is_no_statement_says_why(pins, text):
    with pytest.raises(UnreadableError):
        verify_statement(text, pins)


async def test_a_server_signs_its_answer_and_the_command_checks_it(ledger, tmp_path):
    """A backend as a process on a real embedded ledger; the trust file comes from the ledger, not from it."""
    process = await start(tmp_path, database=f"sqlite:///{tmp_path}/signs.db")
    try:
        told = await ready(process)
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False, verify=PLAIN) as http:
            assert (await http.post("/api/v1/session", json={"token": told["token"]})).status_code == 200
            asked = {"serial": "OH-DRN-9999"}
            plain = (await http.get("/api/v1/conformance", params=asked)).json()
            answer = await http.get("/api/v1/conformance", params=asked, headers={"Accept": "application/jose"})
        assert answer.headers["content-type"] == "application/jose"
        connection = str(tmp_path / "ledger" / "connection.json")
        run = CliRunner().invoke
        made = await asyncio.to_thread(
            run, main, ["evidence", "trust", "--connection", connection, "--out", str(tmp_path / "trust.json")]
        )
        assert made.exit_code == 0, made.output
    finally:
        await stop(process)
    file = tmp_path / "answer.jose"
    file.write_text(answer.text)
    arguments = ["evidence", "statement", str(file), "--trust", str(tmp_path / "trust.json")]
    checked = run(main, [*arguments, "--json"])
    assert checked.exit_code == 0, checked.output
    found = json.loads(checked.output)
    assert (found["about"], found["common_name"]) == ("conformance", "mirror")
    assert found["content"] | {"t_ms": 0} == plain | {"t_ms": 0}
    assert "said at 20" in run(main, arguments).output
    file.write_text(answer.text[:-4])
    assert run(main, arguments).exit_code in {1, 3}
    file.write_text(answer.text.replace(".", "", 1))
    assert run(main, arguments).exit_code == 3


async def test_a_server_without_an_identity_says_so(running):
    answer = await running.get("/conformance?serial=OH-DRN-9999", headers={"Accept": "application/jose"})
    assert answer.status_code == 406
    assert answer.json()["type"] == "urn:wonderland:problem:not-acceptable"
    assert "audit_identity" in answer.json()["detail"]


async def test_what_the_ledgers_block_does_not_say_is_not_signed(running):
    """Somebody edits the row for a moment: no check of all rows comes by in time, and the signature would stay."""
    async with running.context.database.read() as session:
        rows = (await session.scalars(select(VerdictRow))).all()
        session.expunge_all()
    source = running.parts.source
    for row in rows:
        await require_committed(source, row)
    row, other = rows[0], rows[1]
    whole = {name: getattr(row, name) for name in ("record", "tx_id", "tx_index", "block")}
    edits = (
        {"record": whole["record"].replace('"permission":"none"', '"permission":"granted"', 1) + " "},
        {"record": other.record},
        {"tx_id": other.tx_id},
        {"tx_index": 99},
        {"block": whole["block"] - 1},
    )
    for edit in edits:
        for name, value in (whole | edit).items():
            setattr(row, name, value)
        with pytest.raises(RowsDiffer):
            await require_committed(source, row)
    for name, value in (whole | {"block": 10**6}).items():
        setattr(row, name, value)
    with pytest.raises(LedgerAway):
        await require_committed(source, row)
