"""How a contract service is set up, checked before it listens."""

from __future__ import annotations

import datetime as dt
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import grpc
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

from chaincode.service.errors import SettingsError
from wonderland.ledger.addresses import is_loopback, split_address
from wonderland.ledger.files import read_bounded

PACKAGE_ID: Final = re.compile(r"[A-Za-z0-9]+(?:[.+_-][A-Za-z0-9]+)*:[0-9a-f]{64}")
"""As Fabric makes it: the package's label, and the SHA-256 of the package (``core/chaincode/persistence``)."""
EXPIRES_SOON: Final = dt.timedelta(days=14)


@dataclass(frozen=True)
class Limits:
    """What one service takes on. Times in seconds."""

    max_in_flight: int = 1000
    """Transactions at once from one peer; Fabric's own default for a peer is 2500."""
    max_streams: int = 64
    handshake_s: float = 30.0
    answer_s: float = 60.0
    """How long a peer may take for one read or write. It gives a transaction up after 30 s itself."""
    time_window_s: float = 15 * 60.0
    """How far a transaction's time may be from this machine's; Fabric's ``peer.authentication.timewindow``."""
    drain_s: float = 10.0
    """How long transactions under way may take to end when the service is stopped."""


@dataclass(frozen=True, slots=True)
class Tls:
    """The server's certificate chain and key, and the CA whose certificates peers must show (PEM)."""

    certificate: bytes
    key: bytes
    client_ca: bytes | None
    valid_until: dt.datetime

    @classmethod
    def load(cls, certificate: Path, key: Path, client_ca: Path | None, now: dt.datetime) -> Tls:
        """Read the files and see that they fit each other. Raises `SettingsError`."""
        chain = read_bounded(certificate, SettingsError, "TLS certificate")
        key_pem = read_bounded(key, SettingsError, "TLS key")
        roots = None if client_ca is None else read_bounded(client_ca, SettingsError, "client CA")
        leaf = _certificates(chain, certificate)[0]
        if roots is not None and client_ca is not None:
            _certificates(roots, client_ca)
        try:
            private = load_pem_private_key(key_pem, None)
        except (ValueError, TypeError) as cause:
            raise SettingsError(f"TLS key: {key} is no PEM key without a password") from cause
        spki = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
        if private.public_key().public_bytes(*spki) != leaf.public_key().public_bytes(*spki):
            raise SettingsError(f"TLS key: {key} does not belong to the certificate {certificate}")
        if not leaf.not_valid_before_utc <= now <= leaf.not_valid_after_utc:
            raise SettingsError(
                f"TLS certificate: {certificate} is valid from {leaf.not_valid_before_utc:%Y-%m-%d %H:%M} to "
                f"{leaf.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; renew it, or set this machine's clock"
            )
        return cls(chain, key_pem, roots, leaf.not_valid_after_utc)

    def credentials(self) -> grpc.ServerCredentials:
        """For gRPC: peers must show a certificate of the client CA, if there is one."""
        pair = [(self.key, self.certificate)]
        return grpc.ssl_server_credentials(pair, self.client_ca, require_client_auth=self.client_ca is not None)


def check_package_id(text: str) -> str:
    """The package id itself. Raises `SettingsError` unless it is LABEL:HASH."""
    if not PACKAGE_ID.fullmatch(text):
        raise SettingsError(
            f"{text[:100]!r} is no package id: LABEL:HASH with 64 hexadecimal digits, as installing the package said"
        )
    return text


def check_listen(listen: str, *, encrypted: bool, plaintext: bool) -> None:
    """Raise `AddressError` for no address, `SettingsError` for other machines' access without TLS unasked."""
    host, _ = split_address(listen)
    if encrypted or plaintext or is_loopback(host):
        return
    raise SettingsError(
        f"{listen} can be reached by other machines: whoever stands between a peer and its contract decides what the "
        "peer signs. Give --tls-cert, --tls-key and --client-ca (or --plaintext inside a network that is protected)"
    )


def _certificates(pem: bytes, path: Path) -> list[x509.Certificate]:
    try:
        return x509.load_pem_x509_certificates(pem)
    except ValueError as cause:
        raise SettingsError(f"{path} holds no PEM certificate") from cause
