"""Enrolling through the running ledger, and transactions that their sender signs elsewhere."""

from __future__ import annotations

import json

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.gateway import EvaluateError, Gateway, UnsignedError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import key_signer


def request(name, key):
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    signed = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, hashes.SHA256())
    return signed.public_bytes(Encoding.PEM).decode()


async def enrol(world, msp_id, pem, secret):
    argument = json.dumps({"msp_id": msp_id, "request": pem, "secret": secret})
    answer = await world.contract("mirror", "_ledger").evaluate("Enrol", argument)
    return json.loads(answer)["certificate"]


def invite(world, name="anna", role="inspector"):
    return DirectoryAdministration(world.ledger.directory).invite(name, role=role, pol_id=name)


async def test_an_invited_key_signs_elsewhere_and_another_asks_for_the_outcome(world):
    key = ec.generate_private_key(ec.SECP256R1())
    invited = invite(world)
    certificate = await enrol(world, invited.msp_id, request("anna", key), invited.secret)
    anna = Identity(invited.msp_id, certificate.encode())
    assert (anna.role, anna.common_name) == ("inspector", "anna")
    gateway = Gateway(world.channel, anna, None)
    proposal = gateway.network(world.connection.channel).contract("pol").propose("put", "k", "v")
    with pytest.raises(UnsignedError):
        await proposal.endorse()
    sign = key_signer(key)
    transaction = await proposal.signed(sign(proposal.message)).endorse()
    status = await world.network("mirror").settle(transaction.signed(sign(transaction.message)))
    assert status.is_valid
    assert await world.contract().evaluate("get", "k") == b"v"
    again = await world.network("mirror").settle(transaction.signed(sign(transaction.message)))
    assert (again.tx_id, again.block_number, again.is_valid) == (status.tx_id, status.block_number, True)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"secret": "guess"}, 403),
        ({"msp_id": "PadMSP"}, 403),
        ({"msp_id": "NoMSP"}, 400),
        ({"request": "nothing"}, 400),
        ({"request": 7}, 400),
    ],
)
async def test_what_does_not_fit_is_refused(world, change, status):
    invited = invite(world)
    asked = {"msp_id": invited.msp_id, "secret": invited.secret}
    asked["request"] = request("anna", ec.generate_private_key(ec.SECP256R1()))
    with pytest.raises(EvaluateError) as refused:
        await world.contract("mirror", "_ledger").evaluate("Enrol", json.dumps(asked | change))
    assert refused.value.chaincode_response.status == status


@pytest.mark.parametrize("argument", ["", "[]", "{}", "[" * 100_000])
async def test_what_is_no_request_at_all(world, argument):
    with pytest.raises(EvaluateError) as refused:
        await world.contract("mirror", "_ledger").evaluate("Enrol", argument)
    assert refused.value.chaincode_response.status == 400
