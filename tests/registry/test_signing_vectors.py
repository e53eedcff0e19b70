"""The console's vectors for signing are what Python's libraries make and read. `python <this file>` makes them anew."""

from __future__ import annotations

import asyncio
import base64
import json
import secrets
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from wonderland.proofs import encoding
from wonderland_fabric_gateway.ca import CertificateRequest, LocalCa
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import P256_ORDER, key_signer, verify

PATH = Path(__file__).resolve().parents[2] / "frontend" / "src" / "shared" / "signing" / "vectors.json"
ARGUMENT = {"uav_id": "OH-DRN-0417", "status": "suspended", "reason": 'Ä "quoted" \u2028 line, 漢, 🛸\\'}


def raw(number_r, number_s):
    return (number_r.to_bytes(32, "big") + number_s.to_bytes(32, "big")).hex()


def signatures():
    """r ‖ s and the DER that Fabric takes: high and low s, short numbers, first bit set."""
    pairs = [(1, 1), (P256_ORDER - 1, P256_ORDER // 2), (2**255, P256_ORDER // 2 + 1), (5, P256_ORDER - 1), (127, 128)]
    pairs += [(secrets.randbelow(P256_ORDER - 1) + 1, secrets.randbelow(P256_ORDER - 1) + 1) for _ in range(20)]
    return [{"raw": raw(r, s), "der": encode_dss_signature(r, min(s, P256_ORDER - s)).hex()} for r, s in pairs]


def canonical():
    values = [ARGUMENT, {"b": [1, -2, True, False], "a": {}, "é": "", "ꙁ": 0, "𐐷": 2**53 - 1}, ["\x00\x1f\x7f/<>"], {}]
    return [{"value": value, "text": encoding.encode(value).decode()} for value in values]


async def transactions(directory):
    """A proposal and what a real ledger endorsed of it."""
    from wonderland_chaincode.contract import CONTRACT
    from wonderland_fabric_gateway.embedded.node import EmbeddedLedger
    from wonderland_fabric_gateway.gateway import Gateway

    async with (
        EmbeddedLedger(directory / "ledger", {"pol": CONTRACT}) as ledger,
        ledger.connection.open_channel() as channel,
    ):
        connection = ledger.connection
        fleet = Gateway(channel, connection.identity("fleet_operator"), connection.signer("fleet_operator"))
        drone = {"uav_id": "OH-DRN-0417", "operator_id": "x", "model": "m"}
        await fleet.network(connection.channel).contract("pol").submit("RegisterUav", json.dumps(drone))
        key = ec.generate_private_key(ec.SECP256R1())
        ca = ledger.directory.ca("AuthorityMSP")
        enrolment = ca.enrol(
            "anna", attributes={"pol.role": "inspector", "pol.id": "anna"}, public_key=key.public_key()
        )
        anna = Identity("AuthorityMSP", enrolment.certificate_pem)
        contract = Gateway(channel, anna, None).network(connection.channel).contract("pol")
        proposal = contract.propose("SetUavStatus", encoding.encode(ARGUMENT))
        other = contract.propose("SetUavStatus", encoding.encode(ARGUMENT | {"reason": "another"}))
        prepared = await proposal.signed(key_signer(key)(proposal.message)).endorse()
        return {
            "intent": {
                "tx_id": proposal.tx_id,
                "channel": "wonderland",
                "chaincode": "pol",
                "msp_id": "AuthorityMSP",
                "certificate": enrolment.certificate_pem.decode(),
                "name": "SetUavStatus",
            },
            "argument": ARGUMENT,
            "proposal": base64.b64encode(proposal.message).decode(),
            "other_proposal": base64.b64encode(other.message).decode(),
            "other_tx_id": other.tx_id,
            "prepared": base64.b64encode(prepared.message).decode(),
            "endorsers": [each.endorser.msp_id for each in prepared.invocation.endorsements],
        }


def keys():
    key = ec.generate_private_key(ec.SECP256R1())
    public = key.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return {
        "pkcs8": key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode(),
        "sec1": key.private_bytes(Encoding.PEM, PrivateFormat.TraditionalOpenSSL, NoEncryption()).decode(),
        "spki": public.hex(),
    }


def make(directory):
    vectors = {"signatures": signatures(), "canonical": canonical(), "keys": keys()}
    vectors["transaction"] = asyncio.run(transactions(directory))
    return vectors


def test_the_signatures_are_what_python_takes():
    for each in json.loads(PATH.read_text())["signatures"]:
        r, s = decode_dss_signature(bytes.fromhex(each["der"]))
        assert s <= P256_ORDER // 2
        given = bytes.fromhex(each["raw"])
        assert (r, s) == (
            int.from_bytes(given[:32]),
            min(int.from_bytes(given[32:]), P256_ORDER - int.from_bytes(given[32:])),
        )


def test_the_canonical_texts_are_those_of_the_records():
    for each in json.loads(PATH.read_text())["canonical"]:
        assert encoding.encode(each["value"]).decode() == each["text"]


def test_the_transaction_is_one_that_fabrics_own_messages_read():
    from fabric_protos.peer import chaincode_pb2, proposal_pb2

    found = json.loads(PATH.read_text())["transaction"]
    proposal = proposal_pb2.Proposal.FromString(base64.b64decode(found["proposal"]))
    payload = proposal_pb2.ChaincodeProposalPayload.FromString(proposal.payload)
    args = chaincode_pb2.ChaincodeInvocationSpec.FromString(payload.input).chaincode_spec.input.args
    assert [bytes(each) for each in args] == [b"SetUavStatus", encoding.encode(found["argument"])]


def test_the_keys_are_one_key():
    found = json.loads(PATH.read_text())["keys"]
    first, second = (load_pem_private_key(found[name].encode(), None) for name in ("pkcs8", "sec1"))
    assert first.private_numbers() == second.private_numbers()


def test_a_request_made_in_the_browser_is_read_here(browser, tmp_path):
    """WebCrypto, the console's own DER, and Python's reader: whatever one of them got wrong, this would show."""
    import subprocess

    root = PATH.parents[3]
    bundle = tmp_path / "keys.js"
    bundler = root / "node_modules" / ".bin" / "rolldown"
    if not bundler.exists():
        pytest.skip("the console's packages are not installed (make setup)")
    source = PATH.parent / "keys.ts"
    done = subprocess.run(
        [str(bundler), str(source), "--format", "esm", "--file", str(bundle)],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    page = browser.new_page()
    page.route("https://vectors.test/**", lambda route: route.fulfill(body="<!doctype html>", content_type="text/html"))
    page.goto("https://vectors.test/")
    script = bundle.read_text()
    made = page.evaluate(
        """async (script) => {
            const url = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
            const { newKey, requestFor, sign, imported } = await import(url);
            const pair = await newKey();
            const message = new TextEncoder().encode("a message");
            let readable = true;
            try { await crypto.subtle.exportKey("pkcs8", pair.privateKey); } catch { readable = false; }
            const signatures = [];
            for (let i = 0; i < 20; i++) signatures.push(Array.from(await sign(pair.privateKey, message)));
            return { request: await requestFor("anna", pair), signatures, readable };
        }""",
        script,
    )
    page.close()
    assert made["readable"] is False
    request = CertificateRequest.parse(made["request"])
    assert request.name == "anna"
    for signature in made["signatures"]:
        verify(request.public_key, b"a message", bytes(signature))  # low S among what it checks
    ca = LocalCa.create(tmp_path / "ca", "PadMSP")
    assert ca.enrol("anna", public_key=request.public_key).certificate_pem
    assert x509.load_pem_x509_csr(made["request"].encode()).is_signature_valid


if __name__ == "__main__":
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as place:
        PATH.write_text(json.dumps(make(Path(place)), indent=1, ensure_ascii=False) + "\n")
