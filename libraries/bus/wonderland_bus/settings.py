"""What a session of the bus and its router need, checked before Zenoh sees it, whose own words say little."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

from wonderland_bus.errors import BusSettingsError
from wonderland_bus.identity import Peer, is_name

_ADDRESS: Final = re.compile(r"tls/(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+):(\d{1,5})")
MAX_MESSAGE_BYTES: Final = 128 * 1024
"""Of one message on the bus. What is longer is cut by whoever sends it (`wonderland_bus.channel`)."""
MAX_FILE_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Tls:
    """PEM files: who vouches for the others, and who this peer is; a ledger identity will do."""

    ca: Path
    certificate: Path
    key: Path

    def peer(self) -> Peer:
        """Who this peer is. Raises `BusSettingsError`."""
        return Peer.of(self.own()[0])

    def own(self) -> list[x509.Certificate]:
        """The certificate, and what follows it in the file. Raises `BusSettingsError`."""
        return _certificates(self.certificate, "certificate")

    def check(self, now: datetime | None = None) -> None:
        """Raise `BusSettingsError` for what no router would accept."""
        _certificates(self.ca, "ca")
        leaf = self.own()[0]
        Peer.of(leaf)
        now = now or datetime.now(UTC)
        if now >= leaf.not_valid_after_utc:
            raise BusSettingsError(
                f"certificate: {self.certificate} expired at {leaf.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; renew it"
            )
        if now < leaf.not_valid_before_utc:
            raise BusSettingsError(
                f"certificate: {self.certificate} holds from {leaf.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on; "
                "is this machine's clock right?"
            )
        try:
            key = load_pem_private_key(_read(self.key, "key"), None)
        except (ValueError, TypeError) as cause:
            raise BusSettingsError(f"key: {self.key} is no private key in PEM without a password ({cause})") from None
        shapes = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
        if key.public_key().public_bytes(*shapes) != leaf.public_key().public_bytes(*shapes):
            raise BusSettingsError(f"key: {self.key} is not the key of {self.certificate}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A session of an agent or a backend: with one of the routers, and with another when that one is gone."""

    routers: Sequence[str]
    """``tls/host:port``; the name in the router's certificate must be this host's."""
    tls: Tls
    lease_ms: int = 5_000
    """After so long without a word a router is given up."""
    patience_ms: int = 3_000
    """So long opening a session waits for a router."""
    retry_ms: int = 250
    """After so long a router that was lost is tried again; then twice as long, up to 16 times."""

    def check(self) -> None:
        """Raise `BusSettingsError`."""
        self.check_addresses()
        self.tls.check()

    def check_addresses(self) -> None:
        """The same, but for files. Raise `BusSettingsError`."""
        if not self.routers:
            raise BusSettingsError("routers: none; for example tls/router.example:7447")
        for each in self.routers:
            address_of(each, "routers")


@dataclass(frozen=True, slots=True, kw_only=True)
class Router:
    """A router: who may do what is told by the common names of certificates that ``tls.ca`` vouches for.

    A name alone does not say which authority issued it. Put no authority into ``tls.ca`` that you would not trust with
    every name in these lists (docs/decisions/0044).
    """

    tls: Tls
    agents: Sequence[str] = ()
    backends: Sequence[str] = ()
    listen: Sequence[str] = ("tls/localhost:7447",)
    lease_ms: int = 5_000
    max_peers: int = 5_000

    def check(self) -> None:
        """Raise `BusSettingsError`."""
        if not self.listen:
            raise BusSettingsError("listen: nothing; for example tls/localhost:7447")
        for each in self.listen:
            address_of(each, "listen")
        for role, names in (("agents", self.agents), ("backends", self.backends)):
            for name in names:
                if not is_name(name):
                    raise BusSettingsError(f"{role}: {name[:80]!r} is no common name: letters, digits and ._@-")
            if len(set(names)) != len(names):
                raise BusSettingsError(f"{role}: a name stands there twice")
        both = set(self.agents) & set(self.backends)
        if both:
            raise BusSettingsError(f"{min(both)} is among agents and among backends; it can be one of them")
        if not self.agents or not self.backends:
            missing = "backends" if self.agents else "agents"
            raise BusSettingsError(
                f"{missing}: none, so that nobody would meet; the common names of their certificates belong there"
            )
        self.tls.check()


def address_of(endpoint: str, field: str) -> tuple[str, int]:
    """Host and port of ``tls/host:port``. Raises `BusSettingsError`."""
    found = _ADDRESS.fullmatch(endpoint)
    if found is None or int(found[2]) > 0xFFFF:
        raise BusSettingsError(
            f"{field}: {endpoint[:200]!r} is no address of the bus, for example tls/router.example:7447 "
            "(there is no bus without TLS)"
        )
    return found[1].strip("[]"), int(found[2])


def _certificates(path: Path, field: str) -> list[x509.Certificate]:
    try:
        return x509.load_pem_x509_certificates(_read(path, field))
    except ValueError as cause:
        raise BusSettingsError(f"{field}: {path} holds no certificate in PEM ({cause})") from None


def _read(path: Path, field: str) -> bytes:
    try:
        with path.open("rb") as file:
            found = file.read(MAX_FILE_BYTES + 1)
    except OSError as cause:
        raise BusSettingsError(f"{field}: {path} cannot be read ({cause.strerror})") from None
    if len(found) > MAX_FILE_BYTES:
        raise BusSettingsError(f"{field}: {path} has more than {MAX_FILE_BYTES} bytes")
    return found
