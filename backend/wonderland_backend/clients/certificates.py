"""Certificates that machines show (RFC 8705): by TLS that ends here, or told by a proxy that is believed (RFC 9440)."""

from __future__ import annotations

import hashlib
import ipaddress
from base64 import b64decode, urlsafe_b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID
from cryptography.x509.verification import (
    Criticality,
    ExtensionPolicy,
    Policy,
    PolicyBuilder,
    Store,
    VerificationError,
)
from starlette.requests import HTTPConnection

from wonderland.problems import said
from wonderland_backend.errors import BadRequest, SettingsError
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.certificates import certificate_of_der, certificates_of

EXTENSION: Final = "wonderland.peer"
"""Under which name of ``scope["extensions"]`` the server tells whom it is connected with."""
HEADER: Final = "client-cert"
CHAIN_HEADER: Final = "client-cert-chain"
MAX_DER: Final = 16 * 1024
MAX_CHAIN: Final = 8


@dataclass(frozen=True)
class Peer:
    """Whom the server's socket is connected with: never what a header says."""

    address: str
    certificate: bytes | None
    """DER; one that the TLS handshake has verified, key included."""
    encrypted: bool = False
    """Whether TLS ends here."""
    for_agents: bool = False
    """Whether it came by the agents' own listener."""


@dataclass(frozen=True)
class ShownCertificate:
    """A certificate whose private key the caller has."""

    certificate: x509.Certificate
    sha256: bytes
    trusted: bool
    """Whether it leads to one of the client CAs; else it is only this very certificate."""

    @property
    def thumbprint(self) -> str:
        """``x5t#S256`` of RFC 8705."""
        return urlsafe_b64encode(self.sha256).rstrip(b"=").decode()


class Certificates:
    """Finds the certificate of a request."""

    def __init__(
        self, authorities: Sequence[x509.Certificate], proxies: Sequence[str], clock: Callable[[], int]
    ) -> None:
        """`proxies` are addresses or networks. Raises `ValueError` for one that is none."""
        self._store = Store(list(authorities)) if authorities else None
        self._proxies = [ipaddress.ip_network(each) for each in proxies]
        self._clock = clock

    @classmethod
    def of_settings(cls, settings: Settings, clock: Callable[[], int]) -> Certificates:
        """As the settings say. Raises `SettingsError`."""
        return cls(_read(settings.tls_client_ca), settings.client_cert_proxies, clock)

    @property
    def offered(self) -> bool:
        """Whether clients can show certificates at all."""
        return self._store is not None or bool(self._proxies)

    def of(self, connection: HTTPConnection) -> ShownCertificate | None:
        """The certificate that came with a request. Raises `BadRequest` for a proxy's header that is none."""
        peer = connection.scope.get("extensions", {}).get(EXTENSION)
        if not isinstance(peer, Peer):
            return None
        if not self._is_proxy(peer.address):
            # Anybody can write the header; it counts from those proxies only.
            return None if peer.certificate is None else _shown(_parse(peer.certificate), trusted=True)
        told = connection.headers.getlist(HEADER)
        if not told:
            return None
        if len(told) > 1:
            raise BadRequest(said("client_cert_twice"))
        leaf = _byte_sequence(told[0])
        chain = [_byte_sequence(each) for each in ",".join(connection.headers.getlist(CHAIN_HEADER)).split(",") if each]
        return _shown(leaf, trusted=self._leads_to_authority(leaf, chain))

    def _is_proxy(self, address: str) -> bool:
        try:
            found = ipaddress.ip_address(address)
        except ValueError:
            return False
        if isinstance(found, ipaddress.IPv6Address) and found.ipv4_mapped is not None:
            found = found.ipv4_mapped
        return any(found in network for network in self._proxies)

    def _leads_to_authority(self, leaf: x509.Certificate, chain: list[x509.Certificate]) -> bool:
        # A proxy may have asked for a certificate without verifying it, so that self-signed ones come through.
        if self._store is None or len(chain) > MAX_CHAIN:
            return False
        now = datetime.fromtimestamp(self._clock() / 1000, UTC)
        policy = PolicyBuilder().store(self._store).time(now)
        policy = policy.extension_policies(ca_policy=ExtensionPolicy.webpki_defaults_ca(), ee_policy=_CLIENTS)
        try:
            policy.build_client_verifier().verify(leaf, chain)
        except (VerificationError, ValueError):
            return False
        return True


def names_of(certificate: x509.Certificate) -> dict[str, set[str]]:
    """The names of a certificate, by the parameter of RFC 8705 (2.1.2) that a client is registered with."""
    found: dict[str, set[str]] = {"subject_dn": {certificate.subject.rfc4514_string()}}
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, ValueError):
        return found
    found["san_dns"] = {name.lower() for name in names.get_values_for_type(x509.DNSName)}
    found["san_uri"] = set(names.get_values_for_type(x509.UniformResourceIdentifier))
    return found


def read_pem(text: str) -> x509.Certificate:
    """A registered client's certificate. Raises ValueError."""
    found = certificates_of(text.encode())
    if len(found) != 1:
        raise FieldRefused(said("certificate_one"))
    return found[0]


def sha256_of(certificate: x509.Certificate) -> bytes:
    """SHA-256 of a certificate's DER."""
    return hashlib.sha256(certificate.public_bytes(Encoding.DER)).digest()


def _for_clients(_policy: Policy, _certificate: x509.Certificate, usage: x509.ExtendedKeyUsage | None) -> None:
    if usage is not None and ExtendedKeyUsageOID.CLIENT_AUTH not in usage:
        raise ValueError("the certificate is not for clients")


# Organisations' CAs name machines by subject as often as by alternative name.
_CLIENTS: Final = ExtensionPolicy.permit_all().may_be_present(x509.ExtendedKeyUsage, Criticality.AGNOSTIC, _for_clients)


def _shown(certificate: x509.Certificate, *, trusted: bool) -> ShownCertificate:
    return ShownCertificate(certificate, sha256_of(certificate), trusted)


def _byte_sequence(text: str) -> x509.Certificate:
    """A certificate as a byte sequence of RFC 8941: base64 between colons. Raises `BadRequest`."""
    text = text.strip()
    if len(text) > 2 * MAX_DER or len(text) < 2 or not text.startswith(":") or not text.endswith(":"):
        raise BadRequest(said("client_cert_malformed"))
    try:
        return _parse(b64decode(text[1:-1], validate=True))
    except ValueError:
        raise BadRequest(said("client_cert_none")) from None


def _parse(der: bytes) -> x509.Certificate:
    return certificate_of_der(der)


def _read(path: Path | None) -> list[x509.Certificate]:
    if path is None:
        return []
    try:
        return certificates_of(path.read_bytes())
    except (OSError, ValueError) as cause:
        raise SettingsError(f"tls_client_ca: {path} cannot be read as PEM certificates ({cause})") from None
