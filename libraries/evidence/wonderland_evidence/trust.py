"""What a verifier pins: ``wonderland-trust/1``, a file for people to compare by another way than the evidence came.

Channel, the hash of its first block, and each organisation's root certificates. What counts is the PEM;
`sha256` and the texts for the reader (subject, validity) must be those of it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland_evidence.bundle import require_format
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.fields import Fields
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust

FORMAT: Final = "wonderland-trust/1"
MAX_BYTES: Final = 4 << 20
MAX_PEM: Final = 32_768


@dataclass(frozen=True)
class Pins:
    """The pinned facts. `roots`: SHA-256 (hex) over the DER of each root certificate, by MSP id."""

    channel: str
    genesis_hash: bytes
    roots: dict[str, frozenset[str]]
    timestamp_roots: tuple[x509.Certificate, ...] = ()

    @classmethod
    def decode(cls, data: bytes) -> Pins:
        """Read a trust file. Raises `UnreadableError`."""
        try:
            value = encoding.decode(data, max_bytes=MAX_BYTES)
        except EncodingError as cause:
            raise UnreadableError("not_json", f"the trust file: {cause}") from cause
        fields = Fields(value, "")
        require_format(fields, FORMAT)
        channel, genesis = fields.text("channel"), fields.text("genesis_hash")
        organisations = fields.fields("organisations")
        roots: dict[str, frozenset[str]] = {}
        for msp_id in organisations.names():
            each = organisations.fields(msp_id)
            roots[msp_id] = frozenset(each.each("roots", _root))
            each.end()
        if len(genesis) != 64 or not set(genesis) <= set("0123456789abcdef") or not roots:
            raise fields.wrong("genesis_hash", "is no SHA-256 in hexadecimal, or no organisation is named")
        stamps: tuple[x509.Certificate, ...] = ()
        if fields.has("timestamp_roots"):
            stamps = tuple(
                _certificate(fields, pem)
                for pem in fields.each("timestamp_roots", lambda one: one.text("pem", limit=MAX_PEM))
            )
        fields.end()
        return cls(channel, bytes.fromhex(genesis), roots, stamps)


def trust_document(
    genesis: ChannelTrust, newest: ChannelTrust, genesis_hash: bytes, timestamp_roots: Sequence[bytes] = ()
) -> bytes:
    """The trust file of a channel: the organisations of its first and its newest configuration."""
    roots: dict[str, dict[bytes, None]] = {}
    for trust in (genesis, newest):
        for msp_id, organisation in trust.config.organisations.items():
            roots.setdefault(msp_id, {}).update(dict.fromkeys(organisation.root_certs))
    document: dict[str, Any] = {
        "format": FORMAT,
        "channel": newest.channel,
        "genesis_hash": genesis_hash.hex(),
        "organisations": {
            msp_id: {"roots": [_root_json(pem) for pem in pems]} for msp_id, pems in sorted(roots.items())
        },
    }
    if timestamp_roots:
        document["timestamp_roots"] = [{"pem": pem.decode()} for pem in timestamp_roots]
    return json.dumps(document, indent=2, ensure_ascii=False).encode() + b"\n"


def root_sha256(pem: bytes) -> str:
    """SHA-256 (hex) over a root certificate's DER."""
    return hashlib.sha256(certificate_of(pem).public_bytes(Encoding.DER)).hexdigest()


def _root(fields: Fields) -> str:
    digest, pem = fields.text("sha256"), fields.text("pem", limit=MAX_PEM)
    try:
        found = _root_json(pem.encode())
    except ValueError as cause:
        raise fields.wrong("pem", f"is no certificate ({cause})") from cause
    if found["sha256"] != digest:
        raise fields.wrong("sha256", "is not that of the certificate beside it")
    for name in ("subject", "valid_from", "valid_until"):
        if fields.text(name) != found[name]:
            raise fields.wrong(name, f"is not that of the certificate beside it, which has {found[name]!r}")
    return digest


def _certificate(fields: Fields, pem: str) -> x509.Certificate:
    try:
        return certificate_of(pem.encode())
    except ValueError as cause:
        raise fields.wrong("timestamp_roots", f"holds what is no certificate ({cause})") from cause


def _root_json(pem: bytes) -> dict[str, str]:
    certificate = certificate_of(pem)
    return {
        "sha256": root_sha256(pem),
        "subject": certificate.subject.rfc4514_string(),
        "valid_from": certificate.not_valid_before_utc.isoformat(),
        "valid_until": certificate.not_valid_after_utc.isoformat(),
        "pem": pem.decode(),
    }
