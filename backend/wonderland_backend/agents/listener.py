"""Which certificates agents can have seen of this server, and which it accepts of them."""

from __future__ import annotations

import ssl
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland.telemetry import NO_END_POINT, end_point_of
from wonderland_backend.errors import SettingsError
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.certificates import certificates_of


@dataclass(frozen=True)
class EndPoints:
    """What an agent may sign as the server's certificate (`telemetry.end_point_of`), by how it is connected."""

    everybody: str
    """Of TLS that ends here; `NO_END_POINT` without."""
    agents: str
    """Of the agents' own listener."""
    proxies: tuple[Path, ...]
    """Certificates that proxies show, read at each hello: they are renewed every few weeks."""

    @classmethod
    def of(cls, settings: Settings) -> EndPoints:
        """Raises `SettingsError` for a file that holds no certificate."""
        everybody, own = settings.tls_certificate, settings.agents.tls_certificate
        shown = NO_END_POINT if everybody is None else _end_point(everybody, "tls_certificate")
        found = cls(
            shown,
            shown if own is None else _end_point(own, "agents.tls_certificate"),
            settings.agents.proxy_certificates,
        )
        found.behind_proxies()
        return found

    def behind_proxies(self) -> frozenset[str]:
        """What agents see where TLS does not end here. Raises `SettingsError` for a file without a certificate."""
        return frozenset({NO_END_POINT, *(_end_point(path, "agents.proxy_certificates") for path in self.proxies)})


def _end_point(path: Path, setting: str) -> str:
    try:
        leaf = certificates_of(path.read_bytes())[0]
    except (OSError, ValueError, IndexError) as cause:
        raise SettingsError(f"{setting}: {path} holds no certificate in PEM ({cause})") from None
    return end_point_of(leaf.public_bytes(Encoding.DER))


class AgentsTls:
    """TLS of where agents alone come in: certificates of the channel's organisations only.

    It learns authorities as the ledger names them and forgets none; whether a certificate is still good is seen at
    sign-in, and again whenever the channel's configuration changes.
    """

    def __init__(self) -> None:
        self._contexts: list[ssl.SSLContext] = []
        self._known: dict[bytes, None] = {}

    def serve(self, context: ssl.SSLContext) -> None:
        """A listener's context; it demands a certificate."""
        context.verify_mode = ssl.CERT_REQUIRED
        self._contexts.append(context)
        for der in self._known:
            context.load_verify_locations(cadata=der)

    def trust(self, authorities: Iterable[x509.Certificate]) -> None:
        """Roots and intermediates of organisations."""
        for certificate in authorities:
            # Not the PEM: text before it, which others can write into a configuration, is more than OpenSSL takes.
            der = certificate.public_bytes(Encoding.DER)
            if der not in self._known:
                self._known[der] = None
                for context in self._contexts:
                    context.load_verify_locations(cadata=der)
