"""What lies where in a network's directory.

network.yaml                 the description, as it was brought up
ports.json                   who listens where; chosen once
members/<MSP id>.json        where organisations have directories of their own: what each says of itself
mine.json                    and whose keys are here
channel.block                the channel's first block
connection.json              what clients take: one identity per role, through the first peer of the authority
builder/                     how peers connect to contract servers
run/, logs/                  locks with process ids; what each component wrote
organisations/<MSP id>/      one organisation's own; nobody else would have it in reality
  connection.json            the same, with its own identities and its own first peer
  ca-root.pem, tls-root.pem  the roots of its identities and of its TLS certificates
  ca/                        its Fabric CA
  identities/                certificates and keys of people, pads and drones; msp-admin, its administrator
  nodes/<name>/              a peer, an orderer or a contract server: msp/, tls/, data/, settings
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.connection import FILE_NAME
from wonderland_fabric_network.errors import DirectoryStateError

if TYPE_CHECKING:
    from collections.abc import Iterator

DESCRIPTION: Final = "network.yaml"
MSP_ADMIN: Final = "msp-admin"
"""The organisation's administrator (OU admin): joins peers, approves contracts, signs changes of the channel."""
CLIENT: Final = "client"
"""What an organisation's clients show on TLS connections to its peers; who they are is said by what they sign."""
REGISTRAR: Final = "registrar"
"""Who may register identities with the organisation's CA."""


@dataclass(frozen=True)
class IdentityPaths:
    """Certificate and private key, PEM."""

    certificate: Path
    key: Path

    def exist(self) -> bool:
        """Whether both are there."""
        return self.certificate.exists() and self.key.exists()


@dataclass(frozen=True)
class NodeDirectory:
    """A peer, an orderer or a contract server of an organisation."""

    path: Path

    @property
    def msp(self) -> Path:
        """Its MSP directory, as Fabric's servers take it."""
        return self.path / "msp"

    @property
    def identity(self) -> IdentityPaths:
        """What it signs with."""
        return IdentityPaths(self.msp / "signcerts" / "cert.pem", self.msp / "keystore" / "key.pem")

    @property
    def tls(self) -> IdentityPaths:
        """What it shows on TLS connections, as server and as client."""
        return IdentityPaths(self.path / "tls" / "server.pem", self.path / "tls" / "server.key")

    @property
    def tls_root(self) -> Path:
        """The root of its organisation's TLS certificates."""
        return self.path / "tls" / "ca.pem"

    @property
    def data(self) -> Path:
        """Where the server keeps its ledger."""
        return self.path / "data"

    @property
    def builder_file(self) -> Path:
        """What a peer's builder of contract servers has to know."""
        return self.path / "builder.json"

    def package_file(self, slot: str) -> Path:
        """Which package a contract server serves."""
        return self.path / f"package-{slot}"


@dataclass(frozen=True)
class OrganisationDirectory:
    """What belongs to one organisation."""

    path: Path
    msp_id: str

    @property
    def ca_home(self) -> Path:
        """Its Fabric CA's directory."""
        return self.path / "ca"

    @property
    def root(self) -> Path:
        """The root certificate of its identities."""
        return self.path / "ca-root.pem"

    @property
    def tls_root(self) -> Path:
        """The root certificate of its TLS certificates."""
        return self.path / "tls-root.pem"

    @property
    def connection_file(self) -> Path:
        """connection.json of its own people and machines."""
        return self.path / FILE_NAME

    def identity(self, name: str) -> IdentityPaths:
        """Where an identity is, or would be."""
        return IdentityPaths(self.path / "identities" / f"{name}.pem", self.path / "identities" / f"{name}.key")

    def tls_identity(self, name: str) -> IdentityPaths:
        """Where a TLS certificate that belongs to no server is, or would be."""
        return self.identity(f"{name}.tls")

    def node(self, name: str) -> NodeDirectory:
        """The directory of one of its servers: keys, settings, ledger."""
        return NodeDirectory(self.path / "nodes" / name)


class NetworkDirectory:
    """One network's directory. Nothing is made before `prepare`."""

    def __init__(self, path: Path) -> None:
        self.path: Final = path.absolute()
        self.description_file: Final = self.path / DESCRIPTION
        self.ports_file: Final = self.path / "ports.json"
        self.members: Final = self.path / "members"
        self.mine_file: Final = self.path / "mine.json"
        self.block_file: Final = self.path / "channel.block"
        self.contract_file: Final = self.path / "contract.json"
        self.connection_file: Final = self.path / FILE_NAME
        self.lock_file: Final = self.path / "network.lock"
        self.builder: Final = self.path / "builder"
        self.run: Final = self.path / "run"
        self.logs: Final = self.path / "logs"

    def prepare(self) -> None:
        """Make the directory, private to its owner. Raises `DirectoryStateError`."""
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            for each in (self.run, self.logs):
                each.mkdir(exist_ok=True, mode=0o700)
        except OSError as cause:
            raise DirectoryStateError(
                f"{self.path} cannot be used as a network's directory ({cause.strerror})"
            ) from cause

    def require(self) -> None:
        """Raise `DirectoryStateError` unless a network was brought up here."""
        if not self.description_file.exists():
            raise DirectoryStateError(f"there is no network in {self.path}; `wonderland network up` makes one")

    def organisation(self, msp_id: str) -> OrganisationDirectory:
        """The directory of an organisation: CA, identities, servers, connection.json."""
        return OrganisationDirectory(self.path / "organisations" / msp_id, msp_id)

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the network for one command that changes it. Raises `DirectoryStateError` when another one does."""
        path = self.lock_file
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as cause:
            raise DirectoryStateError(f"{path}: {cause.strerror}") from cause
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError as cause:
            raise DirectoryStateError(
                f"another `wonderland network` command works in {self.path}; let it end, then try again"
            ) from cause
        finally:
            os.close(handle)
