"""Signed statements: what an organisation's server answered, and when, as JWS (RFC 7515) by its ledger identity.

A statement is one server's word, which it cannot take back; a session's evidence (`wonderland_evidence.verify`) is the
ledger's. `x5c` has the certificates up to the organisation's root, which the verifier pins (`trust.Pins`).
"""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from binascii import Error as Base64Error
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland_evidence.errors import StatementError, UnreadableError
from wonderland_evidence.trust import Pins, root_sha256
from wonderland_fabric_gateway.certificates import certificate_of, certificate_of_der
from wonderland_fabric_gateway.embedded.errors import AccessDeniedError
from wonderland_fabric_gateway.embedded.msp import ChannelMembership, OrganisationTrust
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.identity import Identity

MEDIA_TYPE: Final = "application/jose"
TYPE: Final = "wonderland-statement+jws"
ALGORITHM: Final = "ES256"
ROLE: Final = "mirror"
"""Of the identities that may make statements: a server's."""
MAX_BYTES: Final = 256 * 1024
MAX_CHAIN: Final = 8
_COORDINATE_BYTES: Final = 32
_HEADER: Final = frozenset({"alg", "typ", "x5c"})


@dataclass(frozen=True)
class Statement:
    """What was said, by whom, when."""

    about: str
    """What `content` is: ``proof`` or ``conformance``."""
    content: dict[str, Any]
    channel: str
    msp_id: str
    common_name: str
    issued_s: int
    """Seconds since the Unix epoch, by the server's clock."""


def compose(
    about: str,
    content: dict[str, Any],
    *,
    channel: str,
    identity: Identity,
    authorities: Sequence[bytes],
    issued_s: int,
    sign: Callable[[bytes], bytes],
) -> str:
    """The compact serialization. `authorities`: intermediate and root certificates (PEM); `sign`: DER, low-S."""
    chain = [identity.certificate_pem, *authorities]
    header = {"alg": ALGORITHM, "typ": TYPE, "x5c": [b64encode(_der(pem)).decode() for pem in chain]}
    payload = {
        "iss": identity.msp_id,
        "sub": identity.common_name,
        "iat": issued_s,
        "channel": channel,
        "about": about,
        "content": content,
    }
    texts = (json.dumps(each, separators=(",", ":")) for each in (header, payload))
    signed = ".".join(encoding.to_base64url(text.encode()) for text in texts)
    r, s = decode_dss_signature(sign(signed.encode()))
    raw = r.to_bytes(_COORDINATE_BYTES, "big") + s.to_bytes(_COORDINATE_BYTES, "big")
    return f"{signed}.{encoding.to_base64url(raw)}"


def verify_statement(text: str, pins: Pins) -> Statement:
    """What a server said. Raises `UnreadableError` for what is none, `StatementError` for one that does not hold.

    Whether the certificate was revoked is not looked at: that is on the ledger.
    """
    header, payload, signature, signed = _parsed(text)
    msp_id = _field(payload, "iss", str)
    statement = Statement(
        _field(payload, "about", str),
        _field(payload, "content", dict),
        _field(payload, "channel", str),
        msp_id,
        _field(payload, "sub", str),
        _field(payload, "iat", int),
    )
    if statement.channel != pins.channel:
        raise StatementError(f"it is about channel {statement.channel[:80]!r}, not {pins.channel!r}")
    identity, trust = _signer(header, msp_id, pins)
    try:
        member = ChannelMembership([trust]).application_member(identity.creator, statement.issued_s * 1000)
        member.verify(signed, signature)
    except (AccessDeniedError, LedgerError) as cause:
        raise StatementError(str(cause)) from cause
    if member.creator.role != ROLE or member.creator.common_name != statement.common_name:
        who = f"{member.creator.common_name!r} with role {member.creator.role or 'none'!r}"
        raise StatementError(f"it was signed by {who}; only a server's identity ({ROLE!r}) makes statements")
    return statement


def _parsed(text: str) -> tuple[dict[str, Any], dict[str, Any], bytes, bytes]:
    if len(text) > MAX_BYTES:
        raise UnreadableError("too_large", f"a statement of more than {MAX_BYTES} bytes")
    parts = text.strip().split(".")
    if len(parts) != 3:
        raise UnreadableError("not_json", "a statement has three parts with dots between them (JWS, compact)")
    try:
        header, payload = (json.loads(encoding.from_base64url(part)) for part in parts[:2])
        raw = encoding.from_base64url(parts[2])
    except (ValueError, EncodingError, RecursionError) as cause:
        raise UnreadableError("not_json", f"the statement cannot be decoded ({cause})") from cause
    if not isinstance(header, dict) or not isinstance(payload, dict):
        raise UnreadableError("wrong_field", "header and payload of a statement are objects")
    if header.get("alg") != ALGORITHM or header.get("typ") != TYPE or header.keys() != _HEADER:
        raise UnreadableError("unknown_version", f"the header is none of {TYPE} with {ALGORITHM} and x5c alone")
    if len(raw) != 2 * _COORDINATE_BYTES:
        raise UnreadableError("wrong_field", "the signature is not of 64 bytes")
    r, s = (int.from_bytes(each, "big") for each in (raw[:_COORDINATE_BYTES], raw[_COORDINATE_BYTES:]))
    return header, payload, encode_dss_signature(r, s), ".".join(parts[:2]).encode()


def _field(payload: dict[str, Any], name: str, kind: type) -> Any:
    value = payload.get(name)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise UnreadableError("wrong_field", f"{name}: expected {kind.__name__}")
    return value


def _signer(header: dict[str, Any], msp_id: str, pins: Pins) -> tuple[Identity, OrganisationTrust]:
    """Who signed, and his organisation's certificates, the roots of which are pinned."""
    shown = header["x5c"]
    if not isinstance(shown, list) or not 2 <= len(shown) <= MAX_CHAIN:
        raise UnreadableError("wrong_field", f"x5c: expected 2 to {MAX_CHAIN} certificates")
    try:
        leaf, *others = [certificate_of_der(b64decode(each, validate=True)) for each in shown]
    except (ValueError, TypeError, Base64Error) as cause:
        raise UnreadableError("wrong_field", f"x5c: holds what is no certificate ({cause})") from cause
    pems = [_pem(each) for each in others]
    pinned = pins.roots.get(msp_id, frozenset())
    roots = tuple(pem for pem in pems if root_sha256(pem) in pinned)
    if not roots:
        raise StatementError(f"it leads to no root that is pinned for {msp_id[:80]!r}")
    intermediates = tuple(pem for pem in pems if pem not in roots)
    return Identity(msp_id, _pem(leaf)), OrganisationTrust(msp_id, roots, intermediates)


def _der(pem: bytes) -> bytes:
    return certificate_of(pem).public_bytes(Encoding.DER)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(Encoding.PEM)
