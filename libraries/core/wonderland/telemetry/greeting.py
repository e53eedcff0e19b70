"""How an agent answers the server's challenge: signed for this server's certificate, so that nobody can pass it on."""

from __future__ import annotations

import hashlib
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland.telemetry.errors import TelemetryError
from wonderland.telemetry.fields import clean
from wonderland.telemetry.frames import NONCE_BYTES, PROTOCOL, SERVER, Challenge, Hello, signed_text

if TYPE_CHECKING:
    from wonderland_fabric_gateway.connection import ClientTls
    from wonderland_fabric_gateway.identity import Identity
    from wonderland_fabric_gateway.signing import Signer

NO_END_POINT: Final = ""
"""Of a connection without TLS."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Credentials:
    """Who this agent is. ``sign`` maps a message to a DER low-S ECDSA P-256/SHA-256 signature with the ledger key."""

    agent: Literal["pad", "uav"]
    id: str
    msp_id: str
    certificate_pem: str
    sign: Callable[[bytes], bytes]

    @classmethod
    def of(cls, agent: Literal["pad", "uav"], agent_id: str, identity: Identity, sign: Signer) -> Credentials:
        """Of a ledger identity."""
        certificate = identity.certificate_pem.decode("ascii", "replace")
        return cls(agent=agent, id=agent_id, msp_id=identity.msp_id, certificate_pem=certificate, sign=sign)


def end_point_of(certificate_der: bytes) -> str:
    """What an agent signs of the server's certificate: hexadecimal SHA-256, as RFC 5929's tls-server-end-point."""
    return hashlib.sha256(certificate_der).hexdigest()


def end_point_seen(connection: ssl.SSLObject | None) -> str:
    """The same of a connection that stands; `NO_END_POINT` where it is not encrypted."""
    certificate = None if connection is None else connection.getpeercert(binary_form=True)
    return NO_END_POINT if certificate is None else end_point_of(certificate)


def tls_of(ca: Path | None, client: ClientTls | None) -> ssl.SSLContext:
    """How an agent connects: `ca` in place of this machine's authorities, and what it shows if it is asked.

    Raises `OSError` (`ssl.SSLError` is one) for files that cannot be used.
    """
    context = ssl.create_default_context(cafile=None if ca is None else str(ca))
    if client is not None:
        context.load_cert_chain(client.certificate, client.key)
    return context


def hello_to(
    challenge: Challenge,
    who: Credentials,
    *,
    spool: str,
    end_point: str,
    takes: Sequence[Literal["please_prove"]] = (),
) -> Hello:
    """The signed answer. Raises `TelemetryError` for a challenge that is none, and what `who.sign` raises."""
    try:
        size = len(encoding.from_base64url(challenge.nonce))
    except EncodingError as cause:
        raise TelemetryError("bad_challenge", f"the server's nonce: {cause}") from cause
    if size != NONCE_BYTES:
        raise TelemetryError("bad_challenge", f"the server's nonce has {size} bytes, not {NONCE_BYTES}")
    if challenge.server != SERVER:
        named = clean(challenge.server, 40)
        raise TelemetryError(
            "bad_challenge", f"the server calls itself {named!r}, not {SERVER!r}: is the address right?"
        )
    signed = signed_text(nonce=challenge.nonce, agent=who.agent, agent_id=who.id, spool=spool, end_point=end_point)
    return Hello(
        protocol=PROTOCOL,
        agent=who.agent,
        id=who.id,
        spool=spool,
        msp_id=who.msp_id,
        certificate=who.certificate_pem,
        tls_server_end_point=end_point,
        signature=encoding.to_base64url(who.sign(signed)),
        takes=tuple(takes),
    )
