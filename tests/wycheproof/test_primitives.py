"""Wycheproof through the functions that the product itself calls: what it verifies, derives and opens.

Each test says how many vectors it went through, so that a file that was renamed or emptied does not pass for a success.
"""

import dataclasses

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from kit import wycheproof

from wonderland.proofs import keys
from wonderland.proofs.errors import KeyAgreementError
from wonderland.uwb.link import cipher as link_cipher
from wonderland.uwb.link.cipher import FrameCipher, LinkKeys
from wonderland.uwb.link.segments import FrameKind
from wonderland_chaincode.contract.signatures import is_point, signature_holds
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import P256_ORDER, der_from_raw, raw_from_der, verify
from wonderland_remote_id.drip.formats import verify as drip_verify

HALF_ORDER = P256_ORDER // 2


def octets(text):
    return bytes.fromhex(text)


def point_of(group):
    return octets(group["publicKey"]["uncompressed"])


def key_of(group):
    return ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), point_of(group))


def holds(key, message, signature):
    try:
        verify(key, message, signature)
    except SignatureError:
        return False
    return True


def test_ledger_signatures_are_strict_der_low_s_and_right():
    """signing.verify: transactions, sign-ins, endorsements and blocks."""
    seen = {True: 0, False: 0}
    twins = 0
    for group, tests in wycheproof.groups("ecdsa_secp256r1_sha256_test"):
        key = key_of(group)
        for test in tests:
            message, signature = octets(test["msg"]), octets(test["sig"])
            expected = test["result"] == "valid"
            if expected:
                r, s = decode_dss_signature(signature)
                twin = encode_dss_signature(r, P256_ORDER - s)
                expected = s <= HALF_ORDER
                # The other form of a signature that is mathematically right: exactly one of the two counts.
                assert holds(key, message, twin) is not expected, test
                twins += 1
            assert holds(key, message, signature) is expected, test
            seen[expected] += 1
    assert seen[True] > 70
    assert seen[False] > 300
    assert twins > 150


def test_no_spelling_of_a_signature_but_one_is_taken():
    """What is not DER is refused by its form already, whatever the numbers in it."""
    spellings = 0
    for group, tests in wycheproof.groups("ecdsa_secp256r1_sha256_test"):
        key = key_of(group)
        for test in tests:
            if not {"BerEncodedSignature", "InvalidEncoding", "MissingZero"} & set(test["flags"]):
                continue
            signature = octets(test["sig"])
            with pytest.raises(SignatureError):
                verify(key, octets(test["msg"]), signature)
            try:
                raw = raw_from_der(signature)
            except SignatureError:
                pass
            else:
                assert der_from_raw(raw) == signature, test
            spellings += 1
    assert spellings > 80


def test_the_contract_takes_raw_signatures_of_64_bytes_low_s_and_right():
    """signature_holds: the drone's countersignature in the contract."""
    seen = {True: 0, False: 0}
    for group, tests in wycheproof.groups("ecdsa_secp256r1_sha256_p1363_test"):
        point = point_of(group)
        assert is_point(point)
        for test in tests:
            signature = octets(test["sig"])
            low = int.from_bytes(signature[32:], "big") <= HALF_ORDER
            expected = test["result"] == "valid" and low
            assert signature_holds(point, octets(test["msg"]), signature) is expected, test
            seen[expected] += 1
    assert seen[True] > 50
    assert seen[False] > 100


def test_pad_and_contract_agree_on_every_countersignature():
    """A pad submits what it takes; the contract must take the same, or the drone's session is lost."""
    for group, tests in wycheproof.groups("ecdsa_secp256r1_sha256_p1363_test"):
        key, point = key_of(group), point_of(group)
        for test in tests:
            signature, message = octets(test["sig"]), octets(test["msg"])
            try:
                at_the_pad = holds(key, message, der_from_raw(signature))
            except SignatureError:
                at_the_pad = False
            assert at_the_pad is signature_holds(point, message, signature), test


def test_key_agreement_takes_uncompressed_points_of_the_curve_and_nothing_else():
    """keys.shared_secret at both ends; is_point in the contract, before any key is on the ledger."""
    seen = {True: 0, False: 0}
    for _, tests in wycheproof.groups("ecdh_secp256r1_ecpoint_test"):
        for test in tests:
            private = ec.derive_private_key(int(test["private"], 16), ec.SECP256R1())
            public = octets(test["public"])
            expected = test["result"] == "valid"  # "acceptable" are compressed points, of which a record has no room
            assert is_point(public) is expected, test
            if expected:
                assert keys.shared_secret(private, public) == octets(test["shared"]), test
            else:
                with pytest.raises(KeyAgreementError):
                    keys.shared_secret(private, public)
            seen[expected] += 1
    assert seen[True] > 300
    assert seen[False] > 20


def test_key_derivation(monkeypatch):
    """keys._extract and _expand, without the label that stands before each of ours."""
    monkeypatch.setattr(keys, "_LABEL", b"")
    seen = 0
    for _, tests in wycheproof.groups("hkdf_sha256_test"):
        for test in tests:
            if test["result"] != "valid" or test["size"] > 32:
                continue  # no output of ours is longer
            root = keys._extract(octets(test["salt"]), octets(test["ikm"]))
            assert keys._expand(root, octets(test["info"]), test["size"]).hex() == test["okm"], test
            seen += 1
    assert seen > 20


def test_frames_of_the_link(monkeypatch):
    """FrameCipher with AES-128, 13-octet nonces and, since no vector has our 8, 16-octet tags."""
    monkeypatch.setattr(link_cipher, "TAG_OCTETS", 16)
    seen = {True: 0, False: 0}
    for group, tests in wycheproof.groups("aes_ccm_test"):
        if (group["keySize"], group["ivSize"], group["tagSize"]) != (128, 104, 128):
            continue
        for test in tests:
            sealed = octets(test["ct"]) + octets(test["tag"])
            cipher = _cipher(octets(test["key"]), octets(test["iv"]))
            opened = cipher.open(FrameKind.DATA, 0, sealed, octets(test["aad"]))
            expected = test["result"] == "valid"
            assert opened == (octets(test["msg"]) if expected else None), test
            if expected:
                assert cipher.seal(FrameKind.DATA, 0, octets(test["msg"]), octets(test["aad"])) == sealed, test
            seen[expected] += 1
    assert seen[True] > 5
    assert sum(seen.values()) > 5


def test_frames_of_the_link_as_in_rfc_3610():
    """The RFC's packet vector 1 has our very parameters: 13-octet nonce, 8-octet tag. It needs nothing fetched."""
    cipher = _cipher(bytes(range(0xC0, 0xD0)), octets("00000003020100a0a1a2a3a4a5"))
    header, text = bytes(range(8)), bytes(range(8, 31))
    sealed = octets("588c979a61c663d2f066d0c2c0f989806d5f6b61dac38417e8d12cfdf926e0")
    assert cipher.seal(FrameKind.DATA, 0, text, header) == sealed
    assert cipher.open(FrameKind.DATA, 0, sealed, header) == text
    assert cipher.open(FrameKind.DATA, 1, sealed, header) is None
    assert cipher.open(FrameKind.DATA, 0, sealed[:-1] + b"\x00", header) is None


def test_answers_in_blinks():
    """SessionKeys.answer: HMAC-SHA-256, its first eight octets."""
    base = keys.derive(b"s" * 32, b"t" * 32)
    seen = 0
    for group, tests in wycheproof.groups("hmac_sha256_test"):
        if group["tagSize"] != 256:
            continue
        for test in tests:
            if test["result"] == "valid":
                answering = dataclasses.replace(base, answer_key=octets(test["key"]))
                assert answering.answer(octets(test["msg"])) == octets(test["tag"])[:8], test
                seen += 1
    assert seen > 30


def test_drip_signatures():
    """drip.formats.verify: what a drone broadcasts about itself."""
    seen = {True: 0, False: 0}
    for group, tests in wycheproof.groups("ed25519_test"):
        for test in tests:
            expected = test["result"] == "valid"
            public = octets(group["publicKey"]["pk"])
            assert drip_verify(public, octets(test["sig"]), octets(test["msg"])) is expected, test
            seen[expected] += 1
    assert seen[True] > 50
    assert seen[False] > 50


def _cipher(key, iv):
    """The pad's direction, whose octet is zero, with the associated data of a vector in place of direction and header."""
    other = bytes(octet ^ 0xFF for octet in key)
    cipher = FrameCipher(LinkKeys(b"\x00" * 4, key, other, iv, iv), "pad")
    cipher._label = b""
    return cipher
