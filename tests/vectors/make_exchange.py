"""Writes ``exchange/exchange.json``: one proof's secrets, frames and signatures, to the octet. Run by ``make vectors``.

Keys and times are fixed and signatures are RFC 6979's, so that every run writes the same: a diff is a change of the
protocol, which needs a new name of it (``wonderland/2``).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from kit.proof_world import START_MS, World

from wonderland import telemetry
from wonderland.proofs import encoding, keys
from wonderland.proofs.attestation import position_digest
from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.sessions import AnchorRanges, Party, RangeTable, Session, Witness
from wonderland.proofs.statement import statement
from wonderland.proofs.transcript import transcript_of
from wonderland.uwb.link import Link, LinkKeys
from wonderland.uwb.link.messages import (
    Echo,
    Identity,
    MessageType,
    Reply,
    encode_attested,
    encode_challenge,
    encode_code,
    encode_signature,
)
from wonderland.uwb.link.proof_payloads import ClaimBatch, RangesPart
from wonderland_fabric_gateway.signing import P256_ORDER, der_from_raw, raw_from_der

TARGET = Path(__file__).parent / "exchange" / "exchange.json"
CHANNEL = "wonderland"
NAMES = ("pad one-time", "uav one-time", "witness one-time", "uav ledger", "agent ledger")


def private(name: str) -> ec.EllipticCurvePrivateKey:
    """A key that everybody knows: its scalar is the SHA-256 of its name."""
    return ec.derive_private_key(int.from_bytes(hashlib.sha256(name.encode()).digest(), "big"), ec.SECP256R1())


def public(name: str) -> str:
    """Its public half as records have it."""
    return encoding.to_base64url(keys.public_bytes(private(name)))


def signed(name: str, text: bytes) -> bytes:
    """DER, low-S, deterministic."""
    r_s = raw_from_der(private(name).sign(text, ec.ECDSA(hashes.SHA256(), deterministic_signing=True)))
    s = int.from_bytes(r_s[32:], "big")
    return der_from_raw(r_s[:32] + min(s, P256_ORDER - s).to_bytes(32, "big"))


def sessions() -> dict[str, Session]:
    """One with what every session has, one with all that a session may have."""
    world = World()
    plain = replace(
        world.session(world.claim((3000, 4000, 3000), START_MS)),
        session_id=hashlib.sha256(b"session").hexdigest(),
        pad_key=public("pad one-time"),
        uav_key=public("uav one-time"),
        pad=Party(msp_id="PadMSP", certificate_sha256=hashlib.sha256(b"pad certificate").hexdigest()),
        uav=Party(
            msp_id="FleetMSP",
            certificate_sha256=hashlib.sha256(b"uav certificate").hexdigest(),
            public_key=public("uav ledger"),
        ),
        commissioning_sha256=encoding.digest(world.commissioning.to_json()).hex(),
    )
    whole = replace(
        plain,
        witness=Witness(
            pad_id="pad-2",
            prekey_id="w1",
            pad_key=public("witness one-time"),
            party=Party(msp_id="PadMSP", certificate_sha256=hashlib.sha256(b"witness certificate").hexdigest()),
            commissioning_sha256=hashlib.sha256(b"witness commissioning").hexdigest(),
        ),
        node=NodeAbility(
            words="both_ways", word_octets=80, slot_us=2000, channels=(5, 9), sts="provisioned", blinks="scheduled"
        ),
        calibration=DroneOffset(offset_mm=120, sigma_mm=25, measured_ms=START_MS - 86_400_000),
    )
    return {
        name: replace(each, transcript_sha256=transcript_of(each, CHANNEL).digest().hex())
        for name, each in (("plain", plain), ("whole", whole))
    }


def plain(value: object) -> object:
    """Octets as hexadecimal digits."""
    return value.hex() if isinstance(value, bytes) else value


def secrets(pad: str, digest: bytes) -> dict[str, object]:
    """What both sides derive, step by step."""
    shared = keys.shared_secret(private(pad), keys.public_bytes(private("uav one-time")))
    found = keys.derive(shared, digest)
    return {
        "shared_secret": shared.hex(),
        "root": keys._extract(digest, shared).hex(),
        **{name: plain(value) for name, value in asdict(found).items()},
    }


def exchange() -> dict[str, object]:
    """All of it."""
    made = {}
    for name, session in sessions().items():
        digest = bytes.fromhex(session.transcript_sha256)
        made[name] = {
            "session": session.to_json(),
            "transcript": encoding.encode(transcript_of(session, CHANNEL).to_json()).decode(),
            "transcript_sha256": session.transcript_sha256,
            "pad": secrets("pad one-time", digest),
        }
        if session.witness is not None:
            made[name]["witness"] = secrets("witness one-time", digest)
    return {
        "channel": CHANNEL,
        "keys": {
            name: {"private": f"{private(name).private_numbers().private_value:064x}", "public": public(name)}
            for name in NAMES
        },
        "sessions": made,
        "link": spoken(sessions()["whole"]),
        "sign_in": sign_in(),
    }


def spoken(session: Session) -> dict[str, object]:
    """The words of a proof in their order, as frames, and what the drone signs."""
    found = keys.derive(
        keys.shared_secret(private("pad one-time"), keys.public_bytes(private("uav one-time"))),
        bytes.fromhex(session.transcript_sha256),
    )
    world = World()
    challenge = bytes(range(8))
    claim = world.claim((3000, 4000, 3000), START_MS + 400)
    table = RangeTable(
        t_ms=(START_MS + 500, START_MS + 550),
        anchors=tuple(
            AnchorRanges(anchor_id=anchor.anchor_id, range_mm=(5000 + 10 * index, 5010 + 10 * index))
            for index, anchor in enumerate(world.commissioning.anchors)
        ),
    )
    digest = position_digest(claim.lat_e7, claim.lon_e7, START_MS + 400, 3000)
    attested = [encoding.to_base64url(digest)]
    text = statement(session.session_id, session.transcript_sha256, table, (claim,), attested)
    signature = raw_from_der(signed("uav ledger", text))
    twin = signature[:32] + (P256_ORDER - int.from_bytes(signature[32:], "big")).to_bytes(32, "big")
    words = (
        ("pad", MessageType.POLL, encode_code(found.code_pad)),
        ("uav", MessageType.REPLY, Reply(found.code_uav, START_MS + 300).encode()),
        ("uav", MessageType.IDENTITY, Identity(bytes.fromhex(session.uav.certificate_sha256)).encode()),
        ("pad", MessageType.IDENTITY, Identity(bytes.fromhex(session.pad.certificate_sha256)).encode()),
        ("pad", MessageType.CHALLENGE, encode_challenge(challenge)),
        ("uav", MessageType.ECHO, Echo(challenge, START_MS + 350).encode()),
        ("uav", MessageType.CLAIMS, ClaimBatch(0, (claim,)).encode()),
        ("pad", MessageType.RANGES, RangesPart(0, table, final=True).encode()),
        ("uav", MessageType.ATTESTED, encode_attested([digest])),
        ("uav", MessageType.SIGNATURE, encode_signature(signature)),
    )
    return {
        "session": "whole",
        "words": frames(found, words),
        "answer": found.answer(challenge).hex(),
        "answer_for_witness": keys.derive(
            keys.shared_secret(private("witness one-time"), keys.public_bytes(private("uav one-time"))),
            bytes.fromhex(session.transcript_sha256),
        )
        .answer(b"")
        .hex(),
        "claims": [claim.to_json()],
        "ranges": table.to_json(),
        "attested": attested,
        "statement": text.decode(),
        "signature": signature.hex(),
        "signature_that_must_be_refused": twin.hex(),
    }


def frames(found: keys.SessionKeys, words: tuple[tuple[str, MessageType, bytes], ...]) -> list[dict[str, object]]:
    """Each word with its frames and the frame that acknowledges them, on a link that loses nothing."""
    held = LinkKeys(
        found.link_session, found.key_pad_to_uav, found.key_uav_to_pad, found.iv_pad_to_uav, found.iv_uav_to_pad
    )
    ends = {"pad": Link("pad", held, lambda: 0), "uav": Link("uav", held, lambda: 0)}
    spoken = []
    for sender, kind, payload in words:
        receiver = "uav" if sender == "pad" else "pad"
        ends[sender].send(kind, payload)
        sent = ends[sender].frames_to_send(4096)
        for frame in sent:
            ends[receiver].receive(frame)
        answered = ends[receiver].frames_to_send(4096)
        for frame in answered:
            ends[sender].receive(frame)
        spoken.append(
            {
                "from": sender,
                "message": kind.name,
                "payload": payload.hex(),
                "frames": [frame.hex() for frame in sent],
                "acknowledged_by": [frame.hex() for frame in answered],
            }
        )
    return spoken


def sign_in() -> dict[str, object]:
    """What an agent signs to be let in by a backend."""
    nonce = encoding.to_base64url(bytes(range(32)))
    end_point = telemetry.end_point_of(b"the server's certificate")
    said = {"nonce": nonce, "agent": "uav", "agent_id": "uav-1", "spool": "0f" * 16, "end_point": end_point}
    text = telemetry.signed_text(**said)
    return {**said, "signed": text.decode(), "signature": signed("agent ledger", text).hex()}


if __name__ == "__main__":
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text(json.dumps(exchange(), indent=1, ensure_ascii=False) + "\n")
