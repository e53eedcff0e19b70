"""What pad and drone say to each other inside the link: message types and the payloads that are plain bytes.

CLAIMS and RANGES carry records of a proof: their payloads are in ``proof_payloads``. VERDICT is not sent yet.
Integers are big-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from wonderland.uwb.link.errors import PayloadError

CODE_OCTETS: Final = 16
CHALLENGE_OCTETS: Final = 8
HASH_OCTETS: Final = 32
SIGNATURE_OCTETS: Final = 64
DIGEST_OCTETS: Final = 8
MAX_DIGESTS: Final = 64
MAX_REASON_OCTETS: Final = 200
_ECHO: Final = struct.Struct(">8sQ")
_REPLY: Final = struct.Struct(">16sQ")


class MessageType(IntEnum):
    """First octet of every message; the rest is its payload."""

    POLL = 1
    """pad → UAV: the pad's session code (16 octets). Step 2 of the proof."""
    REPLY = 2
    """UAV → pad: ``Reply``: the UAV's session code and when it matched the pad's. Step 4."""
    IDENTITY = 3
    """Both ways: ``Identity``: certificate hash or whole certificate."""
    CLAIMS = 4
    """UAV → pad: positions claimed during the session (``proof_payloads.ClaimBatch``)."""
    CHALLENGE = 5
    """pad → UAV: 8 unpredictable octets."""
    ECHO = 6
    """UAV → pad: ``Echo``: the challenge and when it was heard."""
    RANGES = 7
    """pad → UAV: the ranges that the UAV shall countersign (``proof_payloads.RangesPart``)."""
    SIGNATURE = 8
    """UAV → pad: ECDSA P-256 signature r ‖ s over the transcript (64 octets)."""
    VERDICT = 9
    """pad → UAV: hint that a verdict was committed (canonical JSON); the ledger alone decides."""
    ABORT = 10
    """Both ways: ``Abort``: why the sender gives up."""
    ATTESTED = 11
    """UAV → pad, before SIGNATURE: digests of the Remote ID positions that it broadcast (8 octets each, at most 64)."""


def encode_code(code: bytes) -> bytes:
    """Payload of POLL; raises ``PayloadError`` unless it has 16 octets."""
    return _exactly("session code", code, CODE_OCTETS)


def decode_code(payload: bytes) -> bytes:
    """The session code of a POLL payload; compare it in constant time (``hmac.compare_digest``)."""
    return _exactly("session code", payload, CODE_OCTETS)


def encode_challenge(challenge: bytes) -> bytes:
    """Payload of CHALLENGE: 8 octets."""
    return _exactly("challenge", challenge, CHALLENGE_OCTETS)


def decode_challenge(payload: bytes) -> bytes:
    """The challenge of a CHALLENGE payload."""
    return _exactly("challenge", payload, CHALLENGE_OCTETS)


def encode_signature(signature: bytes) -> bytes:
    """Payload of SIGNATURE: r ‖ s, 64 octets."""
    return _exactly("signature", signature, SIGNATURE_OCTETS)


def decode_signature(payload: bytes) -> bytes:
    """The signature r ‖ s of a SIGNATURE payload; whether it is valid is the caller's to check."""
    return _exactly("signature", payload, SIGNATURE_OCTETS)


def encode_attested(digests: Sequence[bytes]) -> bytes:
    """Payload of ATTESTED; raises ``PayloadError`` for none, too many, or digests of another length."""
    if not 0 < len(digests) <= MAX_DIGESTS:
        raise PayloadError(f"attested: {len(digests)} digests; 1 to {MAX_DIGESTS} are allowed")
    return b"".join(_exactly("digest", digest, DIGEST_OCTETS) for digest in digests)


def decode_attested(payload: bytes) -> tuple[bytes, ...]:
    """The digests of an ATTESTED payload, in the drone's order."""
    count, rest = divmod(len(payload), DIGEST_OCTETS)
    if rest or not 0 < count <= MAX_DIGESTS:
        raise PayloadError(f"attested: {len(payload)} octets are not 1 to {MAX_DIGESTS} digests")
    return tuple(payload[at : at + DIGEST_OCTETS] for at in range(0, len(payload), DIGEST_OCTETS))


@dataclass(frozen=True, slots=True)
class Identity:
    """Who speaks: exactly one of ``certificate_sha256`` (32 octets) and ``certificate_der``."""

    certificate_sha256: bytes | None = None
    certificate_der: bytes | None = None

    def encode(self) -> bytes:
        """A kind octet (0 hash, 1 certificate) and the octets."""
        if (self.certificate_sha256 is None) == (self.certificate_der is None):
            raise PayloadError("identity: give either the hash or the certificate")
        if self.certificate_sha256 is not None:
            return b"\x00" + _exactly("certificate hash", self.certificate_sha256, HASH_OCTETS)
        if not self.certificate_der:
            raise PayloadError("identity: the certificate is empty")
        return b"\x01" + self.certificate_der

    @classmethod
    def decode(cls, payload: bytes) -> Identity:
        """Raises ``PayloadError``; a certificate is passed on unparsed."""
        if payload[:1] == b"\x00":
            return cls(certificate_sha256=_exactly("certificate hash", payload[1:], HASH_OCTETS))
        if payload[:1] == b"\x01" and len(payload) > 1:
            return cls(certificate_der=payload[1:])
        raise PayloadError("identity: the first octet must be 0 (hash) or 1 (certificate), followed by octets")


@dataclass(frozen=True, slots=True)
class Echo:
    """Answer to a challenge: the same 8 octets and ``heard_ms``, the UAV's clock when it heard them (ms, 64 bits)."""

    challenge: bytes
    heard_ms: int

    def encode(self) -> bytes:
        """16 octets."""
        if not 0 <= self.heard_ms < 1 << 64:
            raise PayloadError(f"echo: heard_ms {self.heard_ms} does not fit in 64 bits")
        return _ECHO.pack(_exactly("challenge", self.challenge, CHALLENGE_OCTETS), self.heard_ms)

    @classmethod
    def decode(cls, payload: bytes) -> Echo:
        """Raises ``PayloadError`` unless the payload has 16 octets."""
        return cls(*_ECHO.unpack(_exactly("echo", payload, _ECHO.size)))


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer to a poll: the UAV's session code (16 octets) and ``matched_ms``, its clock when it matched the pad's."""

    code: bytes
    matched_ms: int

    def encode(self) -> bytes:
        """24 octets."""
        if not 0 <= self.matched_ms < 1 << 64:
            raise PayloadError(f"reply: matched_ms {self.matched_ms} does not fit in 64 bits")
        return _REPLY.pack(_exactly("session code", self.code, CODE_OCTETS), self.matched_ms)

    @classmethod
    def decode(cls, payload: bytes) -> Reply:
        """Raises ``PayloadError`` unless the payload has 24 octets; compare the code in constant time."""
        return cls(*_REPLY.unpack(_exactly("reply", payload, _REPLY.size)))


class AbortReason(IntEnum):
    """Why one side gives up."""

    UNSPECIFIED = 0
    CODE_MISMATCH = 1
    IDENTITY_MISMATCH = 2
    TIMEOUT = 3
    RANGES_REFUSED = 4
    CANCELLED = 5
    INTERNAL = 6


@dataclass(frozen=True, slots=True)
class Abort:
    """Payload of ABORT. ``text`` is for people, at most 200 octets of UTF-8."""

    reason: AbortReason
    text: str = ""

    def encode(self) -> bytes:
        """A reason octet and the text."""
        text = self.text.encode("utf-8", "replace")
        if len(text) > MAX_REASON_OCTETS:
            raise PayloadError(f"abort: a text of {len(text)} octets; at most {MAX_REASON_OCTETS} are allowed")
        return bytes((self.reason,)) + text

    @classmethod
    def decode(cls, payload: bytes) -> Abort:
        """Raises ``PayloadError``; a reason from a newer peer reads as UNSPECIFIED."""
        if not 1 <= len(payload) <= 1 + MAX_REASON_OCTETS:
            raise PayloadError(f"abort: {len(payload)} octets; 1 to {1 + MAX_REASON_OCTETS} are expected")
        try:
            text = payload[1:].decode("utf-8")
        except UnicodeDecodeError as error:
            raise PayloadError("abort: the text is not UTF-8") from error
        known = payload[0] in AbortReason.__members__.values()
        return cls(AbortReason(payload[0]) if known else AbortReason.UNSPECIFIED, text)


def _exactly(what: str, value: bytes, size: int) -> bytes:
    if len(value) != size:
        raise PayloadError(f"{what}: {len(value)} octets where {size} are expected")
    return bytes(value)
