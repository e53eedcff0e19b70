"""Membership: whether a certificate belongs to an organisation of the channel, now, and what its key signed.

As Fabric's MSP does (``msp/mspimplvalidate.go``): the chain ends in a root of that organisation, no certificate of it
is revoked by the organisation's lists, exactly one node OU is named, and a CA's own certificate is nobody's identity.
Other than Fabric's MSP, and like its orderer and gateway filters, it also refuses certificates outside their validity.
"""

from __future__ import annotations

import datetime as dt
import itertools
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm

from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.embedded.errors import AccessDeniedError
from wonderland_fabric_gateway.errors import IdentityError, SignatureError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.revocation import check_revocation_list, subject_key_id
from wonderland_fabric_gateway.signing import verify

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

MAX_CHAIN: Final = 5
CACHED_MEMBERS: Final = 4096


@dataclass(frozen=True)
class Creator:
    """Who sent a transaction, as the contract sees it. Units: `public_key` is the 65-byte uncompressed point."""

    msp_id: str
    role: str
    pol_id: str
    common_name: str
    attributes: Mapping[str, str]
    certificate_sha256: str
    public_key: bytes
    node_ou: str


@dataclass(frozen=True)
class Member:
    """An identity whose certificate chain was checked; `valid_from_ms` to `valid_to_ms` is what the chain allows."""

    identity: Identity
    creator: Creator
    valid_from_ms: int
    valid_to_ms: int

    def verify(self, message: bytes, signature: bytes) -> None:
        """Raise `AccessDeniedError` unless this member made the low-S signature over the message."""
        try:
            verify(self.identity.public_key, message, signature)
        except SignatureError as cause:
            raise AccessDeniedError(f"{self.creator.msp_id}: {cause}") from cause


@dataclass(frozen=True)
class OrganisationTrust:
    """One organisation's trust anchors, as the channel's configuration has them (PEM)."""

    msp_id: str
    root_certs: tuple[bytes, ...]
    intermediate_certs: tuple[bytes, ...] = ()
    revocation_lists: tuple[bytes, ...] = ()
    application: bool = True
    """Whether it may use the channel; an orderer's organisation may only sign blocks."""


@dataclass
class _Organisation:
    trust: OrganisationTrust
    roots: list[x509.Certificate]
    intermediates: list[x509.Certificate]
    revoked: set[tuple[bytes, int]] = field(default_factory=set)
    """Issuer's key id and serial number of each revoked certificate."""


class ChannelMembership:
    """The organisations of one channel configuration. Replaced as a whole when the configuration changes."""

    def __init__(self, organisations: Iterable[OrganisationTrust], *, sequence: int = 0) -> None:
        """Raises `IdentityError` for a broken CA certificate, `RevocationListError` for a broken list."""
        self.sequence: Final = sequence
        self._organisations = {trust.msp_id: _load(trust) for trust in organisations}
        self._members: OrderedDict[bytes, Member] = OrderedDict()

    @property
    def organisations(self) -> tuple[OrganisationTrust, ...]:
        """The trust anchors it was made of."""
        return tuple(organisation.trust for organisation in self._organisations.values())

    def member(self, creator: bytes, now_ms: int) -> Member:
        """The member that a SerializedIdentity names. Raises `AccessDeniedError`, saying why.

        Checked chains are remembered by the very bytes; their validity in time is looked at each time.
        """
        member = self._members.get(creator)
        if member is None:
            member = self._check(creator)
            self._members[creator] = member
            if len(self._members) > CACHED_MEMBERS:
                self._members.popitem(last=False)
        else:
            self._members.move_to_end(creator)
        if not member.valid_from_ms <= now_ms <= member.valid_to_ms:
            when = "is not valid yet" if now_ms < member.valid_from_ms else "has expired"
            raise AccessDeniedError(
                f"{member.creator.msp_id}: the certificate of {member.creator.common_name!r} {when}; renew it"
            )
        return member

    def application_member(self, creator: bytes, now_ms: int) -> Member:
        """A member of an organisation that may use the channel. Raises `AccessDeniedError`."""
        member = self.member(creator, now_ms)
        if not self._organisations[member.creator.msp_id].trust.application:
            raise AccessDeniedError(
                f"{member.creator.msp_id} orders blocks; it is no member of the application channel"
            )
        return member

    def _check(self, creator: bytes) -> Member:
        try:
            return self._admit(Identity.from_creator(creator))
        except AccessDeniedError:
            raise
        except Exception as cause:  # the X.509 library has many ways (KeyError among them) to say that bytes are odd
            what = cause if isinstance(cause, IdentityError) else f"its certificate cannot be read ({cause!r})"
            raise AccessDeniedError(f"creator is malformed: {what}") from cause

    def _admit(self, identity: Identity) -> Member:
        msp_id = identity.msp_id
        organisation = self._organisations.get(msp_id)
        if organisation is None:
            raise AccessDeniedError(f"creator org unknown: {msp_id!r} is no organisation of this channel")
        chain = _chain(organisation, identity.certificate)
        if _is_ca(identity.certificate):
            raise AccessDeniedError(f"{msp_id}: a CA certificate cannot be used as an identity")
        for certificate, issuer in itertools.pairwise(chain):
            if (subject_key_id(issuer), certificate.serial_number) in organisation.revoked:
                raise AccessDeniedError(f"{msp_id}: the certificate of {identity.common_name!r} is revoked")
        if not identity.node_ou:
            raise AccessDeniedError(
                f"{msp_id}: the certificate must name exactly one of the OUs client, peer, admin, orderer"
            )
        view = Creator(
            msp_id=msp_id,
            role=identity.role,
            pol_id=identity.pol_id,
            common_name=identity.common_name,
            attributes=dict(identity.attributes),
            certificate_sha256=identity.certificate_sha256,
            public_key=identity.public_key_bytes,
            node_ou=identity.node_ou,
        )
        return Member(
            identity,
            view,
            max(_ms(certificate.not_valid_before_utc) for certificate in chain),
            min(_ms(certificate.not_valid_after_utc) for certificate in chain),
        )


def _load(trust: OrganisationTrust) -> _Organisation:
    def certificates(pems: Iterable[bytes]) -> list[x509.Certificate]:
        try:
            return [certificate_of(pem) for pem in pems]
        except ValueError as cause:
            raise IdentityError(f"{trust.msp_id}: a CA certificate is no PEM certificate ({cause})") from cause

    organisation = _Organisation(trust, certificates(trust.root_certs), certificates(trust.intermediate_certs))
    for crl_pem in trust.revocation_lists:
        crl = check_revocation_list(crl_pem, (*trust.root_certs, *trust.intermediate_certs))
        key_id = crl.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value.key_identifier
        organisation.revoked.update((key_id or b"", entry.serial_number) for entry in crl)
    return organisation


def _chain(organisation: _Organisation, certificate: x509.Certificate) -> list[x509.Certificate]:
    """From the certificate to a root, both included."""
    chain = [certificate]
    while len(chain) < MAX_CHAIN:
        for issuer in (*organisation.roots, *organisation.intermediates):
            if issuer.subject == chain[-1].issuer and _is_ca(issuer) and is_issued(issuer, chain[-1]):
                chain.append(issuer)
                break
        else:
            break
        if chain[-1] in organisation.roots:
            return chain
    raise AccessDeniedError(f"{organisation.trust.msp_id}: the certificate was not issued by a CA of that organisation")


def is_issued(issuer: x509.Certificate, certificate: x509.Certificate) -> bool:
    """Whether the issuer signed the certificate, and its name says so."""
    try:
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return True


def _is_ca(certificate: x509.Certificate) -> bool:
    try:
        return certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        return False
    except (ValueError, x509.DuplicateExtension) as cause:
        raise IdentityError(f"a certificate's extensions cannot be read ({cause})") from cause


def _ms(instant: dt.datetime) -> int:
    return int(instant.timestamp() * 1000)
