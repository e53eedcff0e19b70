"""The exchange, to the octet: the code still makes the frozen vectors, and who has the README alone can read them."""

import hashlib
import hmac
import json
import struct
from pathlib import Path

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.ciphers.aead import AESCCM
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from vectors import make_exchange

from wonderland.proofs import encoding, keys
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.transcript import transcript_of
from wonderland.uwb.link import Link, LinkKeys
from wonderland_chaincode.contract.signatures import signature_holds
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import der_from_raw, verify

VECTORS = json.loads((Path(__file__).parent.parent / "vectors" / "exchange" / "exchange.json").read_text())
LABELS = {
    "code_pad": ("code pad", 16),
    "code_uav": ("code uav", 16),
    "key_pad_to_uav": ("aead pad to uav", 16),
    "key_uav_to_pad": ("aead uav to pad", 16),
    "iv_pad_to_uav": ("iv pad to uav", 13),
    "iv_uav_to_pad": ("iv uav to pad", 13),
    "sts_key": ("sts", 16),
    "sts_key_blinks": ("sts blinks", 16),
    "answer_key": ("answer", 32),
    "confirmation": ("confirmation", 32),
}


def test_the_code_still_makes_them():
    assert make_exchange.exchange() == VECTORS


@pytest.mark.parametrize(("session", "side"), [("plain", "pad"), ("whole", "pad"), ("whole", "witness")])
def test_secrets_are_rfc_5869s_by_another_hand(session, side):
    found = VECTORS["sessions"][session]
    digest = bytes.fromhex(found["transcript_sha256"])
    secrets = found[side]
    assert hashlib.sha256(found["transcript"].encode()).digest() == digest
    for name, (label, size) in LABELS.items():
        made = HKDF(hashes.SHA256(), size, digest, f"wonderland/1 {label}".encode())
        assert made.derive(bytes.fromhex(secrets["shared_secret"])).hex() == secrets[name], name
    names = HKDF(hashes.SHA256(), 14, digest, b"wonderland/1 names").derive(bytes.fromhex(secrets["shared_secret"]))
    first, third = struct.unpack(">II", names[:8])
    assert (secrets["session_a"], secrets["session_b"]) == (first & 0x7FFFFFFE or 2, first & 0x7FFFFFFE | 1)
    assert secrets["session_c"] == third | 0x80000000
    assert secrets["link_session"] == names[8:12].hex()
    assert secrets["uav_mac"] == 0xB000 | int.from_bytes(names[12:], "big") & 0xFFF


def test_both_ends_come_to_the_same_secret():
    for pad, session, side in (("pad one-time", "plain", "pad"), ("witness one-time", "whole", "witness")):
        drone = ec.derive_private_key(int(VECTORS["keys"]["uav one-time"]["private"], 16), ec.SECP256R1())
        public = encoding.from_base64url(VECTORS["keys"][pad]["public"])
        assert keys.shared_secret(drone, public).hex() == VECTORS["sessions"][session][side]["shared_secret"]


def test_a_transcript_follows_from_its_session():
    for found in VECTORS["sessions"].values():
        session = Session.parse(found["session"])
        assert encoding.encode(transcript_of(session, VECTORS["channel"]).to_json()).decode() == found["transcript"]
        assert transcript_of(session, VECTORS["channel"]).digest().hex() == session.transcript_sha256


def test_frames_are_aes_ccm_by_another_hand():
    secrets = VECTORS["sessions"]["whole"]["pad"]
    types = []
    for word in VECTORS["link"]["words"]:
        text = b""
        way = ("pad_to_uav", 0) if word["from"] == "pad" else ("uav_to_pad", 1)
        for frame in map(bytes.fromhex, word["frames"]):
            header, sealed = frame[:13], frame[13:]
            assert header[0] == 0x10
            assert header[1] == len(frame)
            assert header[2] == (0 if word["from"] == "pad" else 1)
            assert header[3:7].hex() == secrets["link_session"]
            iv = int.from_bytes(bytes.fromhex(secrets[f"iv_{way[0]}"]), "big")
            nonce = (iv ^ (way[1] << 96 | int.from_bytes(header[7:11], "big"))).to_bytes(13, "big")
            aead = AESCCM(bytes.fromhex(secrets[f"key_{way[0]}"]), tag_length=8)
            text += aead.decrypt(nonce, sealed, bytes((way[1],)) + header)
        types.append(text[0])
        assert text[1:].hex() == word["payload"]
    assert types == [1, 2, 3, 3, 5, 6, 4, 7, 11, 8]


def test_the_countersignature_and_its_twin():
    link = VECTORS["link"]
    said = json.loads(link["statement"])
    table = {
        "t_ms": link["ranges"]["t_ms"],
        "anchors": [
            {"anchor_id": each["anchor_id"], "range_mm": each["range_mm"]} for each in link["ranges"]["anchors"]
        ],
    }
    for name, value in (("ranges", table), ("claims", link["claims"]), ("broadcast", link["attested"])):
        canonical = json.dumps(value, sort_keys=True, separators=(",", ":")).encode()
        assert said[f"{name}_sha256"] == hashlib.sha256(canonical).hexdigest()
    point = encoding.from_base64url(VECTORS["keys"]["uav ledger"]["public"])
    text = link["statement"].encode()
    assert signature_holds(point, text, bytes.fromhex(link["signature"]))
    twin = bytes.fromhex(link["signature_that_must_be_refused"])
    assert not signature_holds(point, text, twin)
    key = ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), point)
    key.verify(der_from_raw(twin), text, ec.ECDSA(hashes.SHA256()))  # right by mathematics
    with pytest.raises(SignatureError, match="high-S"):
        verify(key, text, der_from_raw(twin))
    with pytest.raises(InvalidSignature):
        key.verify(der_from_raw(twin), text + b" ", ec.ECDSA(hashes.SHA256()))


def test_answers():
    secrets = VECTORS["sessions"]["whole"]
    for side, challenge, answer in (("pad", bytes(range(8)), "answer"), ("witness", b"", "answer_for_witness")):
        made = hmac.new(bytes.fromhex(secrets[side]["answer_key"]), challenge, hashlib.sha256).digest()[:8]
        assert made.hex() == VECTORS["link"][answer]


def test_the_sign_in():
    said = VECTORS["sign_in"]
    key = ec.EllipticCurvePublicKey.from_encoded_point(
        ec.SECP256R1(), encoding.from_base64url(VECTORS["keys"]["agent ledger"]["public"])
    )
    verify(key, said["signed"].encode(), bytes.fromhex(said["signature"]))
    assert json.loads(said["signed"]) == {
        "purpose": "wonderland-ingest",
        "nonce": said["nonce"],
        "server": "wonderland",
        "agent": said["agent"],
        "id": said["agent_id"],
        "spool": said["spool"],
        "tls_server_end_point": hashlib.sha256(b"the server's certificate").hexdigest(),
    }


def test_a_bit_of_any_frame_changed_or_a_frame_come_twice_is_not_taken():
    secrets = VECTORS["sessions"]["whole"]["pad"]
    held = LinkKeys(*(bytes.fromhex(secrets[name]) for name in ("link_session", *list(LABELS)[2:6])))
    poll = bytes.fromhex(VECTORS["link"]["words"][0]["frames"][0])
    for bit in range(8 * len(poll)):
        drone = Link("uav", held, lambda: 0)
        changed = bytearray(poll)
        changed[bit // 8] ^= 1 << bit % 8
        drone.receive(bytes(changed))
        assert not list(drone.events()), bit
    drone, pad = Link("uav", held, lambda: 0), Link("pad", held, lambda: 0)
    drone.receive(poll)
    assert len(list(drone.events())) == 1
    drone.receive(poll)
    pad.receive(poll)
    assert not list(drone.events())
    assert not list(pad.events())
