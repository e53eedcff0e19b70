"""The service's certificate and the CA of its peers: checked at the start, and taken anew when the files change.

A peer's stream lasts for months, and a certificate for one year: renewing it must not take the service down. The files
are looked at again whenever a peer connects; what was there goes on being used while the new files do not fit together
(between the writing of one and the other, for example).
"""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import grpc
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

from wonderland_chaincode.service.errors import SettingsError
from wonderland_fabric_gateway.certificates import certificates_of
from wonderland_fabric_gateway.files import read_bounded

EXPIRES_SOON: Final = dt.timedelta(days=14)
_log: Final = logging.getLogger(__name__)
_State = tuple[tuple[int, int, int], ...]


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)


@dataclass(frozen=True, slots=True)
class _Material:
    """What the files held (PEM)."""

    certificate: bytes
    key: bytes
    client_ca: bytes | None
    valid_until: dt.datetime

    def configuration(self) -> grpc.ServerCertificateConfiguration:
        return grpc.ssl_server_certificate_configuration([(self.key, self.certificate)], self.client_ca)


class Tls:
    """The files, and what of them is in use. With `client_ca`, peers must show a certificate of it (mutual TLS)."""

    def __init__(
        self, certificate: Path, key: Path, client_ca: Path | None, clock: Callable[[], dt.datetime] = _now
    ) -> None:
        """Raises `SettingsError` when the files cannot be read, do not fit each other, or are out of date."""
        self._paths = (certificate, key, *(() if client_ca is None else (client_ca,)))
        self._clock = clock
        self._state = self._look()
        self._used = self._load()
        self.mutual: Final = client_ca is not None

    @property
    def valid_until(self) -> dt.datetime:
        """When the certificate in use expires."""
        return self._used.valid_until

    def credentials(self) -> grpc.ServerCredentials:
        """For gRPC, which asks again at each handshake."""
        return grpc.dynamic_ssl_server_credentials(self._used.configuration(), self._configuration, self.mutual)

    def refresh(self) -> None:
        """Take the files anew if they changed and fit each other; what is in use stays otherwise."""
        state = self._look()
        if state == self._state:
            return
        try:
            self._used = self._load()
        except SettingsError as error:
            _log.error("the TLS files changed, but cannot be used: %s; the former ones go on", error)
        else:
            _log.info("new TLS certificate, valid until %s", f"{self.valid_until:%Y-%m-%d %H:%M} UTC")
        self._state = state

    def _configuration(self) -> grpc.ServerCertificateConfiguration:
        """Called by gRPC from a thread of its own, at each handshake."""
        self.refresh()
        return self._used.configuration()

    def _look(self) -> _State:
        """What tells that a file was changed; zeros for one that is not there."""
        seen = []
        for path in self._paths:
            try:
                found = path.stat()
            except OSError:
                seen.append((0, 0, 0))
            else:
                seen.append((found.st_ino, found.st_mtime_ns, found.st_size))
        return tuple(seen)

    def _load(self) -> _Material:
        certificate, key, *rest = self._paths
        chain = read_bounded(certificate, SettingsError, "TLS certificate")
        key_pem = read_bounded(key, SettingsError, "TLS key")
        roots = None
        for client_ca in rest:
            roots = read_bounded(client_ca, SettingsError, "client CA")
            _certificates(roots, client_ca)
        leaf = _certificates(chain, certificate)[0]
        try:
            private = load_pem_private_key(key_pem, None)
        except (ValueError, TypeError) as cause:
            raise SettingsError(f"TLS key: {key} is no PEM key without a password") from cause
        spki = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
        if private.public_key().public_bytes(*spki) != leaf.public_key().public_bytes(*spki):
            raise SettingsError(f"TLS key: {key} does not belong to the certificate {certificate}")
        now = self._clock()
        if not leaf.not_valid_before_utc <= now <= leaf.not_valid_after_utc:
            raise SettingsError(
                f"TLS certificate: {certificate} is valid from {leaf.not_valid_before_utc:%Y-%m-%d %H:%M} to "
                f"{leaf.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; renew it, or set this machine's clock"
            )
        if leaf.not_valid_after_utc - now < EXPIRES_SOON:
            _log.warning(
                "the TLS certificate expires on %s; renew it", f"{leaf.not_valid_after_utc:%Y-%m-%d %H:%M} UTC"
            )
        return _Material(chain, key_pem, roots, leaf.not_valid_after_utc)


def _certificates(pem: bytes, path: Path) -> list[x509.Certificate]:
    try:
        return certificates_of(pem)
    except ValueError as cause:
        raise SettingsError(f"{path} holds no PEM certificate") from cause
