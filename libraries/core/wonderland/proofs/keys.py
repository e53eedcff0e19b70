"""The keys of a session: ECDH on P-256, then HKDF-SHA-256 (RFC 5869) over the transcript.

Both public keys come from the ledger, in transactions signed with X.509 identities, so that nothing new has to be
trusted; the pad's key is used once, so that an old session can not be opened by a key found later.
The contract has no part in this: it never holds a secret.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass, field
from typing import Final

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from wonderland.proofs.errors import KeyAgreementError

_LABEL: Final = b"wonderland/1 "
_PUBLIC_BYTES: Final = 65
ANSWER_BYTES: Final = 8


@dataclass(frozen=True, slots=True)
class SessionKeys:
    """Everything derived for one session; secrets never show in a representation."""

    code_pad: bytes = field(repr=False)
    """16 B that the pad says in its poll (step 2)."""
    code_uav: bytes = field(repr=False)
    """16 B that the drone answers (step 4)."""
    key_pad_to_uav: bytes = field(repr=False)
    """16 B, AES-CCM."""
    key_uav_to_pad: bytes = field(repr=False)
    """16 B, AES-CCM."""
    iv_pad_to_uav: bytes = field(repr=False)
    """13 B."""
    iv_uav_to_pad: bytes = field(repr=False)
    """13 B."""
    sts_key: bytes = field(repr=False)
    """16 B, session key of the scrambled time-stamp sequence (UCI TLV 0x45)."""
    confirmation: bytes = field(repr=False)
    """32 B, confirms to each side that the other derived the same."""
    session_a: int
    """UCI id of the ranging session."""
    session_b: int
    """UCI id of the session that carries words from pad to drone."""
    link_session: bytes
    """4 B that name the session in each frame of the link."""
    session_c: int
    """UCI id of the session in which the drone blinks and the pad's nodes time-stamp."""
    sts_key_blinks: bytes = field(repr=False)
    """16 B, session key of the blinks' scrambled time-stamp sequence."""
    answer_key: bytes = field(repr=False)
    """32 B, key of the answer that rides in each blink (``answer``)."""
    uav_mac: int
    """Short UWB address of the drone in this session: nothing to follow from one session to the next."""

    def answer(self, challenge: bytes) -> bytes:
        """The answer (8 B) to a challenge, carried in each blink; for a witness, who has no words, to no challenge."""
        return hmac.new(self.answer_key, challenge, hashlib.sha256).digest()[:ANSWER_BYTES]


def new_key() -> ec.EllipticCurvePrivateKey:
    """A fresh P-256 key for one session."""
    return ec.generate_private_key(ec.SECP256R1())


def public_bytes(key: ec.EllipticCurvePrivateKey) -> bytes:
    """The public half (65 B, SEC 1 uncompressed)."""
    return key.public_key().public_bytes(serialization.Encoding.X962, serialization.PublicFormat.UncompressedPoint)


def shared_secret(private_key: ec.EllipticCurvePrivateKey, peer_public: bytes) -> bytes:
    """ECDH (32 B); raises KeyAgreementError where ``peer_public`` is no point of the curve."""
    if len(peer_public) != _PUBLIC_BYTES:
        raise KeyAgreementError(f"a public key has {_PUBLIC_BYTES} bytes, this one {len(peer_public)}")
    try:
        peer = ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), peer_public)
        return private_key.exchange(ec.ECDH(), peer)
    except ValueError as error:
        raise KeyAgreementError(f"the peer's public key is no point of P-256: {error}") from None


def derive(secret: bytes, transcript_digest: bytes) -> SessionKeys:
    """All keys of a session from the shared secret, salted with the transcript's digest."""
    root = _extract(transcript_digest, secret)
    names = _expand(root, b"names", 14)
    return SessionKeys(
        code_pad=_expand(root, b"code pad", 16),
        code_uav=_expand(root, b"code uav", 16),
        key_pad_to_uav=_expand(root, b"aead pad to uav", 16),
        key_uav_to_pad=_expand(root, b"aead uav to pad", 16),
        iv_pad_to_uav=_expand(root, b"iv pad to uav", 13),
        iv_uav_to_pad=_expand(root, b"iv uav to pad", 13),
        sts_key=_expand(root, b"sts", 16),
        confirmation=_expand(root, b"confirmation", 32),
        # Ids of the two UCI sessions differ in their lowest bit, so that they can not be the same.
        session_a=int.from_bytes(names[:4], "big") & 0x7FFFFFFE or 2,
        session_b=int.from_bytes(names[:4], "big") & 0x7FFFFFFE | 1,
        # The third one has the highest bit, which they have not.
        session_c=int.from_bytes(names[4:8], "big") | 0x80000000,
        sts_key_blinks=_expand(root, b"sts blinks", 16),
        answer_key=_expand(root, b"answer", 32),
        link_session=names[8:12],
        # 0xB000–0xBFFF: apart from the addresses that pads give their own nodes (0xA000 and up).
        uav_mac=0xB000 | int.from_bytes(names[12:14], "big") & 0x0FFF,
    )


def _extract(salt: bytes, secret: bytes) -> bytes:
    """HKDF-Extract."""
    return hmac.new(salt, secret, hashlib.sha256).digest()


def _expand(root: bytes, label: bytes, size: int) -> bytes:
    """HKDF-Expand for one output of at most 32 B."""
    return hmac.new(root, _LABEL + label + b"\x01", hashlib.sha256).digest()[:size]
