"""What an authentication message of DRIP says: Link, Wrapper, Manifest, Frame (RFC 9575, section 4)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from wonderland_remote_id.decoding import EPOCH_2019_MS
from wonderland_remote_id.drip.det import BYTES as DET_BYTES
from wonderland_remote_id.drip.det import HOST_IDENTITY_BYTES, Det, DripError, message_hash
from wonderland_remote_id.enums import MessageType
from wonderland_remote_id.messages import MESSAGE_BYTES

SIGNATURE_BYTES: Final = 64
HASH_BYTES: Final = 8
MAX_WRAPPED: Final = 4
MAX_HASHES: Final = 11
MAX_EVIDENCE_BYTES: Final = 112
_TIMES: Final = struct.Struct("<II")
_LINK_BYTES: Final = 8 + DET_BYTES + HOST_IDENTITY_BYTES + DET_BYTES + SIGNATURE_BYTES
_WRAPPABLE: Final = (
    MessageType.BASIC_ID,
    MessageType.LOCATION,
    MessageType.SELF_ID,
    MessageType.SYSTEM,
    MessageType.OPERATOR_ID,
)
Sign = Callable[[bytes], bytes]
"""Signs with Ed25519: 64 bytes."""


class SamType(IntEnum):
    """The first byte of a specific authentication method's data."""

    LINK = 1
    WRAPPER = 2
    MANIFEST = 3
    FRAME = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A registry endorses a key: "this entity tag and this public key belong together, from then until then"."""

    valid_from_ms: int
    valid_until_ms: int
    child: Det
    child_host_identity: bytes
    parent: Det
    signature: bytes

    def signed(self) -> bytes:
        """What the parent's signature covers."""
        times = _times(self.valid_from_ms, self.valid_until_ms)
        return times + self.child.octets + self.child_host_identity + self.parent.octets

    def sam(self) -> bytes:
        """The octets of this in an Authentication message, with its SAM type."""
        return bytes((SamType.LINK,)) + self.signed() + self.signature


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedEvidence:
    """What a drone signs in flight, common to Wrapper, Manifest and Frame."""

    valid_from_ms: int
    valid_until_ms: int
    evidence: bytes
    det: Det
    signature: bytes

    def signed(self, evidence: bytes | None = None) -> bytes:
        """What the drone's signature covers; ``evidence`` where it is not in the message itself."""
        times = _times(self.valid_from_ms, self.valid_until_ms)
        return times + (self.evidence if evidence is None else evidence) + self.det.octets

    def sam(self, kind: SamType) -> bytes:
        """The octets of this in an Authentication message, with its SAM type."""
        return bytes((kind,)) + self.signed() + self.signature


@dataclass(frozen=True, slots=True)
class Wrapper:
    """Signs over up to four messages; none inside: over those of the pack that it came in."""

    signed: SignedEvidence

    @property
    def frames(self) -> tuple[bytes, ...]:
        """The messages inside, 25 bytes each."""
        evidence = self.signed.evidence
        return tuple(evidence[at : at + MESSAGE_BYTES] for at in range(0, len(evidence), MESSAGE_BYTES))


@dataclass(frozen=True, slots=True)
class Manifest:
    """Signs over hashes of messages that were broadcast before."""

    signed: SignedEvidence

    @property
    def hashes(self) -> tuple[bytes, ...]:
        """All hashes in order: the previous manifest's, its own, the link's, the messages'."""
        evidence = self.signed.evidence
        return tuple(evidence[at : at + HASH_BYTES] for at in range(0, len(evidence), HASH_BYTES))

    @property
    def message_hashes(self) -> tuple[bytes, ...]:
        """Hashes of messages."""
        return self.hashes[3:]

    def is_consistent(self) -> bool:
        """Whether its own hash is that of its contents."""
        evidence = self.signed.evidence
        return message_hash(evidence[:HASH_BYTES] + bytes(HASH_BYTES) + evidence[2 * HASH_BYTES :]) == self.hashes[1]


@dataclass(frozen=True, slots=True)
class Frame:
    """Signs over data of a type that other specifications define; none does yet."""

    signed: SignedEvidence

    @property
    def frame_type(self) -> int:
        """What the data is."""
        return self.signed.evidence[0]


Sam: TypeAlias = Link | Wrapper | Manifest | Frame


def parse_sam(data: bytes) -> Sam:
    """What authentication data says; nothing is verified yet. Raises `DripError`."""
    if not data:
        raise DripError("authentication data of no bytes has no SAM type")
    try:
        kind = SamType(data[0])
    except ValueError:
        raise DripError(f"SAM type {data[0]} is none of DRIP's (1 to 4)", 0) from None
    if kind is SamType.LINK:
        return _link(data[1:])
    signed = _evidence(data[1:])
    evidence = signed.evidence
    if kind is SamType.WRAPPER:
        if len(evidence) % MESSAGE_BYTES or len(evidence) > MAX_WRAPPED * MESSAGE_BYTES:
            raise DripError(f"a Wrapper around {len(evidence)} bytes; it holds up to four messages of {MESSAGE_BYTES}")
        kinds = [frame[0] >> 4 for frame in Wrapper(signed).frames]
        if kinds != sorted(kinds) or any(found not in _WRAPPABLE for found in kinds):
            raise DripError("a Wrapper around messages that may not be in it, or in another order")
        return Wrapper(signed)
    if kind is SamType.MANIFEST:
        count = len(evidence) // HASH_BYTES
        if len(evidence) % HASH_BYTES or not 3 <= count <= 3 + MAX_HASHES:
            raise DripError(f"a Manifest of {len(evidence)} bytes; it holds 3 to {3 + MAX_HASHES} hashes of 8 bytes")
        return Manifest(signed)
    if not evidence:
        raise DripError("a Frame without its type")
    return Frame(signed)


def verify(host_identity: bytes, signature: bytes, data: bytes) -> bool:
    """Whether an Ed25519 signature is right."""
    try:
        Ed25519PublicKey.from_public_bytes(host_identity).verify(signature, data)
    except (InvalidSignature, ValueError):
        return False
    return True


def endorse(child: Det, child_host_identity: bytes, parent: Det, times_ms: tuple[int, int], sign: Sign) -> Link:
    """A Link, signed by the parent."""
    unsigned = Link(
        valid_from_ms=times_ms[0],
        valid_until_ms=times_ms[1],
        child=child,
        child_host_identity=child_host_identity,
        parent=parent,
        signature=b"",
    )
    return _link(unsigned.signed() + sign(unsigned.signed()))


def sign_evidence(evidence: bytes, det: Det, times_ms: tuple[int, int], sign: Sign) -> SignedEvidence:
    """Evidence, signed by the drone."""
    if len(evidence) > MAX_EVIDENCE_BYTES:
        raise DripError(f"{len(evidence)} bytes of evidence; there is room for {MAX_EVIDENCE_BYTES}")
    data = _times(*times_ms) + evidence + det.octets
    return _evidence(data + sign(data))


def manifest_evidence(previous: bytes, link: bytes, messages: Iterable[bytes]) -> bytes:
    """The evidence of a Manifest: ``previous`` its predecessor's own hash, ``link`` the link's pages, then frames."""
    rest = message_hash(link) + b"".join(message_hash(message) for message in messages)
    return previous + message_hash(previous + bytes(HASH_BYTES) + rest) + rest


def _times(from_ms: int, until_ms: int) -> bytes:
    seconds = [(t_ms - EPOCH_2019_MS) // 1000 for t_ms in (from_ms, until_ms)]
    if not all(0 <= value < 1 << 32 for value in seconds):
        raise DripError("a time outside what seconds since 2019 can say")
    return _TIMES.pack(*seconds)


def _link(data: bytes) -> Link:
    if len(data) != _LINK_BYTES:
        raise DripError(f"a Link of {len(data)} bytes; it has {_LINK_BYTES}")
    from_s, until_s = _TIMES.unpack_from(data)
    child, identity = data[8:24], data[24:56]
    return Link(
        valid_from_ms=EPOCH_2019_MS + from_s * 1000,
        valid_until_ms=EPOCH_2019_MS + until_s * 1000,
        child=Det(child),
        child_host_identity=identity,
        parent=Det(data[56:72]),
        signature=data[72:],
    )


def _evidence(data: bytes) -> SignedEvidence:
    least = _TIMES.size + DET_BYTES + SIGNATURE_BYTES
    if not least <= len(data) <= least + MAX_EVIDENCE_BYTES:
        raise DripError(f"signed evidence of {len(data)} bytes; it has {least} to {least + MAX_EVIDENCE_BYTES}")
    from_s, until_s = _TIMES.unpack_from(data)
    end = len(data) - SIGNATURE_BYTES
    return SignedEvidence(
        valid_from_ms=EPOCH_2019_MS + from_s * 1000,
        valid_until_ms=EPOCH_2019_MS + until_s * 1000,
        evidence=data[_TIMES.size : end - DET_BYTES],
        det=Det(data[end - DET_BYTES : end]),
        signature=data[end:],
    )
