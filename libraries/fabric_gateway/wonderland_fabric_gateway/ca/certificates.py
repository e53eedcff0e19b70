"""Certificates and revocation lists in the form that Fabric's MSP accepts; pure, no files and no clock.

Sources: RFC 5280; Fabric "Membership Service Providers" (P-256, CA:TRUE with SKI on the root, CN and one node OU
in the subject); fabric-ca's signing profiles. Two rules that cost others days: a revocation list **without** the
authority key identifier makes every identity of the organisation invalid, and one signed by another key is
silently ignored. `build_revocation_list` therefore always writes the AKI of the very key that signs.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from wonderland_fabric_gateway.attributes import ATTRIBUTES_OID, encode_attributes
from wonderland_fabric_gateway.ca.application import Application, Kind, is_address
from wonderland_fabric_gateway.signing import P256_ORDER

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import datetime

    from wonderland_fabric_gateway.ca.random import RandomBytes

_HASH: Final = hashes.SHA256()
_SERIAL_BITS: Final = 159  # RFC 5280: positive and at most 20 bytes
_KEY_BYTES: Final = 48  # FIPS 186-5 A.2.1: 128 bits more than the order, so that the bias is negligible

REASONS: Final = {reason.value: reason for reason in x509.ReasonFlags if reason is not x509.ReasonFlags.remove_from_crl}
"""The reasons of RFC 5280 by name, for example keyCompromise, superseded, cessationOfOperation."""


@dataclass(frozen=True, slots=True)
class Authority:
    """A root: its certificate and the key that signs."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def key_identifier(self) -> bytes:
        """The root's subject key identifier, which all it signs names as its authority's."""
        return self.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value.digest


@dataclass(frozen=True, slots=True)
class Terms:
    """What the CA adds to an application: the serial number and the time it holds for."""

    serial: int
    not_before: datetime
    not_after: datetime


@dataclass(frozen=True, slots=True)
class RevokedEntry:
    """One line of a revocation list."""

    serial: int
    revoked_at: datetime
    reason: str


def new_private_key(random_bytes: RandomBytes) -> ec.EllipticCurvePrivateKey:
    """A P-256 key from 48 random bytes (FIPS 186-5 A.2.1)."""
    scalar = int.from_bytes(random_bytes(_KEY_BYTES), "big") % (P256_ORDER - 1) + 1
    return ec.derive_private_key(scalar, ec.SECP256R1())


def private_key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Unencrypted PKCS#8, as Fabric's tools read it."""
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def new_serial(random_bytes: RandomBytes) -> int:
    """A positive serial number of 159 bits, never 0."""
    return int.from_bytes(random_bytes(20), "big") % ((1 << _SERIAL_BITS) - 1) + 1


def build_root(
    common_name: str, organisation: str, not_before: datetime, not_after: datetime, random_bytes: RandomBytes
) -> Authority:
    """A self-signed root that may sign certificates and revocation lists, and no further CA."""
    key = new_private_key(random_bytes)
    name = x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATION_NAME, organisation),
            x509.NameAttribute(NameOID.COMMON_NAME, common_name),
        ]
    )
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(new_serial(random_bytes))
        .not_valid_before(not_before)
        .not_valid_after(not_after)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(cert_sign=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, _HASH)
    )
    return Authority(certificate, key)


def build_certificate(
    authority: Authority, public_key: ec.EllipticCurvePublicKey, application: Application, terms: Terms
) -> x509.Certificate:
    """A certificate for a checked application.

    Subject: CN = name, OU = node OU. An identity carries its attributes as Fabric CA writes them; a TLS certificate
    may serve (for `hosts`) and be a client.
    """
    subject = x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, application.node_ou),
            x509.NameAttribute(NameOID.COMMON_NAME, application.name),
        ]
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(authority.certificate.subject)
        .public_key(public_key)
        .serial_number(terms.serial)
        .not_valid_before(terms.not_before)
        .not_valid_after(terms.not_after)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
        .add_extension(_authority_key_identifier(authority), critical=False)
    )
    if application.kind is Kind.TLS:
        purposes = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    if application.attributes:
        attributes = x509.UnrecognizedExtension(ATTRIBUTES_OID, encode_attributes(application.attributes))
        builder = builder.add_extension(attributes, critical=False)
    if application.hosts:
        names = [_general_name(host) for host in dict.fromkeys(application.hosts)]
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return builder.sign(authority.key, _HASH)


def build_revocation_list(
    authority: Authority, revoked: Iterable[RevokedEntry], number: int, this_update: datetime, next_update: datetime
) -> x509.CertificateRevocationList:
    """A revocation list with number and the signing key's identifier."""
    builder = (
        x509.CertificateRevocationListBuilder()
        .issuer_name(authority.certificate.subject)
        .last_update(this_update)
        .next_update(next_update)
        .add_extension(x509.CRLNumber(number), critical=False)
        .add_extension(_authority_key_identifier(authority), critical=False)
    )
    for entry in revoked:
        line = x509.RevokedCertificateBuilder().serial_number(entry.serial).revocation_date(entry.revoked_at)
        if entry.reason != x509.ReasonFlags.unspecified.value:  # RFC 5280, 5.3.1: absent rather than unspecified
            line = line.add_extension(x509.CRLReason(REASONS[entry.reason]), critical=False)
        builder = builder.add_revoked_certificate(line.build())
    return builder.sign(authority.key, _HASH)


def _general_name(host: str) -> x509.GeneralName:
    return x509.IPAddress(ipaddress.ip_address(host)) if is_address(host) else x509.DNSName(host)


def _authority_key_identifier(authority: Authority) -> x509.AuthorityKeyIdentifier:
    return x509.AuthorityKeyIdentifier(authority.key_identifier, None, None)


def _key_usage(*, cert_sign: bool = False) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=cert_sign,
        crl_sign=cert_sign,
        encipher_only=False,
        decipher_only=False,
    )
