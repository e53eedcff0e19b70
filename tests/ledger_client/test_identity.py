"""Identities: what a certificate says, and what is refused."""

from __future__ import annotations

import base64
import hashlib
import json
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID
from fabric_protos.msp import identities_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.attributes import ATTRIBUTES_OID, decode_attributes, encode_attributes
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.identity import Identity

MODERATE = settings(max_examples=60, deadline=None)


def certificate(subject, extension=None, curve=None) -> bytes:
    key = ec.generate_private_key(curve or ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(oid, value) for oid, value in subject])
    builder = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(7)
        .not_valid_before(datetime(2026, 1, 1, tzinfo=UTC))
        .not_valid_after(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=1))
    )
    if extension is not None:
        builder = builder.add_extension(x509.UnrecognizedExtension(ATTRIBUTES_OID, extension), critical=False)
    return builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM)


def test_a_creator_and_back(pad):
    identity = pad.identity
    message = identities_pb2.SerializedIdentity.FromString(identity.creator)
    assert (message.mspid, message.id_bytes) == ("PadMSP", identity.certificate_pem)
    back = Identity.from_creator(identity.creator)
    assert back == identity
    assert back.creator == identity.creator
    assert back is Identity.from_creator(bytes(bytearray(identity.creator)))  # parsed once


def test_what_it_says_of_itself(pad):
    identity = pad.identity
    der = identity.certificate.public_bytes(Encoding.DER)
    assert identity.certificate_sha256 == hashlib.sha256(der).hexdigest()
    assert identity.public_key_bytes[0] == 4
    assert len(identity.public_key_bytes) == 65
    assert (
        ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), identity.public_key_bytes) == identity.public_key
    )


def test_the_bytes_that_were_signed_stand(pad):
    # A field that we do not know, behind the ones that we do.
    unusual = pad.identity.creator + b"\x7a\x01x"
    assert Identity.from_creator(unusual).creator == unusual


def test_a_certificate_that_says_little():
    identity = Identity("X", certificate([(NameOID.COUNTRY_NAME, "FI")]))
    assert (identity.common_name, identity.node_ou, identity.role, identity.pol_id) == ("", "", "", "")
    assert identity.attributes == {}


@pytest.mark.parametrize(
    ("units", "expected"), [(["client"], "client"), (["a", "peer"], "peer"), (["client", "admin"], ""), (["a"], "")]
)
def test_the_node_ou(units, expected):
    subject = [(NameOID.ORGANIZATIONAL_UNIT_NAME, unit) for unit in units]
    assert Identity("X", certificate(subject)).node_ou == expected


def test_another_curve_is_refused():
    with pytest.raises(IdentityError, match="P-256"):
        _ = Identity("X", certificate([], curve=ec.SECP384R1())).public_key


@pytest.mark.parametrize(
    "value",
    [
        b"",
        b"{",
        b"[]",
        b"{}",
        b'{"attrs":[]}',
        b'{"attrs":{"a":1}}',
        b'{"attrs":{"a":"1","a":"2"}}',
        b"\xff",
        b"x" * 20000,
        b'{"attrs":{"a":"\\ud800"}}',
        b"[" * 15000,
    ],
)
def test_attributes_that_cannot_be_read(value):
    identity = Identity("X", certificate([], extension=value))
    with pytest.raises(IdentityError, match="attribute"):
        _ = identity.attributes


@MODERATE
@given(
    st.dictionaries(
        st.text(st.characters(codec="utf-8"), max_size=10), st.text(st.characters(codec="utf-8"), max_size=20)
    )
)
def test_attributes_and_back(attributes):
    data = encode_attributes(attributes)
    assert decode_attributes(data) == attributes
    assert json.loads(data) == {"attrs": attributes}


@MODERATE
@given(st.binary(max_size=300))
def test_garbage_attributes_are_a_typed_error(data):
    try:
        decode_attributes(data)
    except IdentityError:
        return
    assert json.loads(data)["attrs"] is not None


@MODERATE
@given(st.binary(max_size=300))
def test_garbage_creators_are_a_typed_error(data):
    with pytest.raises(IdentityError):
        Identity.from_creator(data)


@MODERATE
@given(st.data())
def test_damaged_creators_are_a_typed_error_or_readable(pad, data):
    creator = bytearray(pad.identity.creator)
    for _ in range(data.draw(st.integers(1, 4))):
        creator[data.draw(st.integers(0, len(creator) - 1))] = data.draw(st.integers(0, 255))
    try:
        identity = Identity.from_creator(bytes(creator))
        _ = (identity.attributes, identity.common_name, identity.node_ou, identity.public_key_bytes)
    except IdentityError:
        pass


def test_limits(pad):
    with pytest.raises(IdentityError, match="limit"):
        Identity.from_creator(bytes(70_000))
    nobody = identities_pb2.SerializedIdentity(id_bytes=pad.identity.certificate_pem).SerializeToString()
    with pytest.raises(IdentityError, match="no MSP"):
        Identity.from_creator(nobody)
    long = identities_pb2.SerializedIdentity(mspid="x" * 200, id_bytes=pad.identity.certificate_pem).SerializeToString()
    with pytest.raises(IdentityError, match="200 characters"):
        Identity.from_creator(long)


def test_a_certificate_file(pad, tmp_path):
    path = tmp_path / "cert.pem"
    path.write_bytes(pad.identity.certificate_pem)
    assert Identity.from_file("PadMSP", path) == pad.identity
    path.write_bytes(b"no certificate")
    with pytest.raises(IdentityError, match="PEM"):
        Identity.from_file("PadMSP", path)


def test_a_certificate_of_no_known_version_is_a_typed_error(pad):
    der = pad.identity.certificate_der
    version = bytes.fromhex("a003020102")  # [0] EXPLICIT INTEGER 2: version 3
    assert der.count(version) == 1
    of_version_6 = base64.encodebytes(der.replace(version, version[:-1] + b"\x05")).decode()
    pem = f"-----BEGIN CERTIFICATE-----\n{of_version_6}-----END CERTIFICATE-----\n".encode()
    creator = identities_pb2.SerializedIdentity(mspid="PadMSP", id_bytes=pem).SerializeToString()
    with pytest.raises(IdentityError, match="5 is not a valid X509 version"):
        _ = Identity.from_creator(creator).certificate
