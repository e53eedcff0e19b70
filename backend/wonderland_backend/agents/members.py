"""Who an agent is: its ledger certificate, checked against the channel's organisations as the mirror learned them."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Final

import orjson
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland.telemetry import Hello, signed_text
from wonderland_backend.agents.errors import IngestError
from wonderland_backend.agents.listener import AgentsTls, EndPoints
from wonderland_backend.context import part
from wonderland_backend.mirror.rows import APPLICATION
from wonderland_fabric_gateway.certificates import certificate_of, certificate_of_der
from wonderland_fabric_gateway.embedded.errors import AccessDeniedError, RevocationListError
from wonderland_fabric_gateway.embedded.msp import ChannelMembership, Member, OrganisationTrust, is_issued
from wonderland_fabric_gateway.errors import IdentityError
from wonderland_fabric_gateway.identity import Identity

_ANOTHER_SERVER: Final = (
    "the agent signed in to another server's certificate: somebody is between, or a proxy's certificate is missing in "
    "agents.proxy_certificates"
)
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Seen:
    """What a connection itself shows."""

    end_points: frozenset[str]
    """Which certificates of this server the agent can have seen (`EndPoints`)."""
    shown: bytes | None = None
    """The agent's own certificate (DER), where TLS that ends here demands one."""


class Members:
    """The channel's organisations, of which an agent must be a member."""

    def __init__(self, end_points: EndPoints) -> None:
        self._organisations: dict[str, ChannelMembership] = {}
        self._tls_roots: dict[str, list[x509.Certificate]] = {}
        self._participants: tuple[str, ...] = ()
        self.end_points = end_points
        self.tls = AgentsTls()

    def configure(self, organisations: Iterable[tuple[str, str]]) -> None:
        """Replace the organisations: (msp_id, definition as the mirror keeps it) each.

        One whose certificates or revocation lists cannot be read is left out: none of its agents gets in.
        """
        found: dict[str, ChannelMembership] = {}
        tls_roots: dict[str, list[x509.Certificate]] = {}
        participants = set()
        for msp_id, definition in organisations:
            try:
                read = orjson.loads(definition)
                trust = _trust(msp_id, read)
                tls_roots[msp_id] = [certificate_of(pem.encode()) for pem in read.get("tls_root_certs", [])]
                found[msp_id] = ChannelMembership([trust])
            except (IdentityError, RevocationListError, ValueError) as cause:
                logger.error("agents of %s are refused, its definition on the ledger cannot be used: %s", msp_id, cause)  # noqa: TRY400 - the text says it all
                continue
            if APPLICATION in read["sections"]:
                participants.add(msp_id)
            authorities = [certificate_of(pem) for pem in (*trust.root_certs, *trust.intermediate_certs)]
            self.tls.trust([*authorities, *tls_roots[msp_id]])
        self._organisations, self._tls_roots = found, tls_roots
        self._participants = tuple(sorted(participants))

    def is_member(self, msp_id: str, creator: bytes, now_ms: int) -> bool:
        """Whether an identity that was authenticated earlier would still be."""
        try:
            self.member(msp_id, creator, now_ms)
        except AccessDeniedError:
            return False
        return True

    def member(self, msp_id: str, creator: bytes, now_ms: int) -> Member:
        """The member that an identity is on the channel. Raises `AccessDeniedError`, saying why it is none."""
        membership = self._organisations.get(msp_id)
        if membership is None:
            raise AccessDeniedError(f"{msp_id} is no organisation of the channel")
        return membership.application_member(creator, now_ms)

    @property
    def msp_ids(self) -> tuple[str, ...]:
        """MSP ids of the organisations that take part in transactions: not of those that only order them."""
        return self._participants

    def authorities(self, msp_id: str) -> tuple[bytes, ...]:
        """An organisation's intermediate and root certificates (PEM); none of one that there is not."""
        membership = self._organisations.get(msp_id)
        if membership is None:
            return ()
        (trust,) = membership.organisations
        return (*trust.intermediate_certs, *trust.root_certs)

    def authenticate(self, hello: Hello, *, nonce: str, seen: Seen, now_ms: int) -> Identity:
        """The agent's identity. Raises `IngestError`, with what is wrong."""
        membership = self._organisations.get(hello.msp_id)
        if membership is None:
            raise IngestError("unknown_organisation", f"{hello.msp_id} is no organisation of the channel")
        creator = Identity(hello.msp_id, hello.certificate.encode()).creator
        text = signed_text(
            nonce=nonce,
            agent=hello.agent,
            agent_id=hello.id,
            spool=hello.spool,
            end_point=hello.tls_server_end_point,
        )
        try:
            member = membership.application_member(creator, now_ms)
            member.verify(text, encoding.from_base64url(hello.signature))
            if seen.shown is not None:
                self._require_shown(hello.msp_id, membership, seen.shown, now_ms)
        except (AccessDeniedError, EncodingError) as cause:
            raise IngestError("not_authenticated", str(cause)[:300]) from None
        if member.creator.role != hello.agent or member.creator.pol_id != hello.id:
            raise IngestError(
                "wrong_role",
                f"the certificate is of {member.creator.role or 'no role'} {member.creator.pol_id or '(no id)'}, "
                f"not of {hello.agent} {hello.id}",
            )
        if hello.tls_server_end_point not in seen.end_points:
            raise IngestError("another_server", _ANOTHER_SERVER)
        return member.identity

    def _require_shown(self, msp_id: str, membership: ChannelMembership, shown: bytes, now_ms: int) -> None:
        """Raise `AccessDeniedError` unless what the handshake verified is of the organisation that signs, too."""
        certificate = certificate_of_der(shown)
        if not any(is_issued(root, certificate) for root in self._tls_roots[msp_id]):
            pem = certificate.public_bytes(Encoding.PEM)
            membership.application_member(Identity(msp_id, pem).creator, now_ms)


MembersDep = Annotated[Members, part(Members)]


def _trust(msp_id: str, definition: dict[str, Any]) -> OrganisationTrust:
    return OrganisationTrust(
        msp_id=msp_id,
        root_certs=tuple(pem.encode() for pem in definition["root_certs"]),
        intermediate_certs=tuple(pem.encode() for pem in definition["intermediate_certs"]),
        revocation_lists=tuple(pem.encode() for pem in definition["revocation_lists"]),
        application="Application" in definition["sections"],
    )
