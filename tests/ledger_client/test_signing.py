"""Signatures: low-S, P-256, DER and raw."""

from __future__ import annotations

import hashlib

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, NoEncryption, PrivateFormat
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import (
    P256_ORDER,
    der_from_raw,
    key_file_signer,
    key_signer,
    raw_from_der,
    verify,
)

KEY = ec.derive_private_key(0x1234567, ec.SECP256R1())
MODERATE = settings(max_examples=60, deadline=None)


@MODERATE
@given(st.binary(max_size=200))
def test_every_signature_is_low_s_and_verifies(message):
    signature = key_signer(KEY)(message)
    assert decode_dss_signature(signature)[1] <= P256_ORDER // 2
    verify(KEY.public_key(), message, signature)
    KEY.public_key().verify(signature, message, ec.ECDSA(hashes.SHA256()))  # also by the library alone


def test_the_high_s_twin_is_refused():
    r, s = decode_dss_signature(key_signer(KEY)(b"m"))
    twin = encode_dss_signature(r, P256_ORDER - s)
    KEY.public_key().verify(twin, b"m", ec.ECDSA(hashes.SHA256()))  # it is a valid ECDSA signature
    with pytest.raises(SignatureError, match="high-S"):
        verify(KEY.public_key(), b"m", twin)


def test_another_message_or_key_is_refused():
    signature = key_signer(KEY)(b"m")
    with pytest.raises(SignatureError, match="not made by this key"):
        verify(KEY.public_key(), b"n", signature)
    with pytest.raises(SignatureError, match="not made by this key"):
        verify(ec.derive_private_key(99, ec.SECP256R1()).public_key(), b"m", signature)


def test_another_curve_is_refused():
    other = ec.generate_private_key(ec.SECP384R1())
    with pytest.raises(SignatureError, match="P-256"):
        key_signer(other)
    with pytest.raises(SignatureError, match="P-256"):
        verify(other.public_key(), b"m", key_signer(KEY)(b"m"))
    with pytest.raises(SignatureError, match="P-256"):
        verify(ed25519.Ed25519PrivateKey.generate().public_key(), b"m", b"")


@MODERATE
@given(st.binary(max_size=100))
def test_garbage_is_a_typed_error(data):
    with pytest.raises(SignatureError):
        verify(KEY.public_key(), b"m", data)


@MODERATE
@given(st.integers(1, P256_ORDER - 1), st.integers(1, P256_ORDER - 1))
def test_raw_and_der_are_the_same_numbers(r, s):
    der = encode_dss_signature(r, s)
    raw = raw_from_der(der)
    assert raw == r.to_bytes(32, "big") + s.to_bytes(32, "big")
    assert der_from_raw(raw) == der


@pytest.mark.parametrize("raw", [b"", bytes(63), bytes(65), bytes(64), b"\xff" * 64])
def test_raw_that_is_no_signature(raw):
    with pytest.raises(SignatureError):
        der_from_raw(raw)


@pytest.mark.parametrize("numbers", [(0, 1), (1, 0), (P256_ORDER, 1), (1, P256_ORDER), (1 << 255, 1 << 255)])
def test_der_numbers_out_of_range(numbers):
    der = encode_dss_signature(*numbers)
    if numbers == (1 << 255, 1 << 255):
        assert len(raw_from_der(der)) == 64
    else:
        with pytest.raises(SignatureError):
            raw_from_der(der)


def test_der_with_something_behind_it_is_refused():
    with pytest.raises(SignatureError):
        verify(KEY.public_key(), b"m", key_signer(KEY)(b"m") + b"\0")


@pytest.mark.parametrize("form", [PrivateFormat.PKCS8, PrivateFormat.TraditionalOpenSSL])
def test_a_key_file_of_either_form(tmp_path, form):
    path = tmp_path / "key.pem"
    path.write_bytes(KEY.private_bytes(Encoding.PEM, form, NoEncryption()))
    verify(KEY.public_key(), b"m", key_file_signer(path)(b"m"))


def test_key_files_that_cannot_be_used(tmp_path):
    path = tmp_path / "key.pem"
    with pytest.raises(SignatureError, match="cannot read"):
        key_file_signer(path)
    path.write_bytes(b"-----BEGIN PRIVATE KEY-----\nsecret\n-----END PRIVATE KEY-----\n")
    with pytest.raises(SignatureError) as caught:
        key_file_signer(path)
    assert "secret" not in str(caught.value)
    path.write_bytes(KEY.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"x")))
    with pytest.raises(SignatureError, match="unencrypted"):
        key_file_signer(path)
    other = rsa.generate_private_key(65537, 2048)
    path.write_bytes(other.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    with pytest.raises(SignatureError, match="elliptic"):
        key_file_signer(path)
    path.write_bytes(b"x" * (2 << 20))
    with pytest.raises(SignatureError, match="larger"):
        key_file_signer(path)


def test_the_message_is_hashed_with_sha256():
    prehashed = ec.ECDSA(hashes.SHA256())
    digest = hashlib.sha256(b"m").digest()
    assert len(digest) == 32
    KEY.public_key().verify(key_signer(KEY)(b"m"), b"m", prehashed)
