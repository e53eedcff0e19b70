"""An organisation's Fabric CA, and everything that it certifies: servers, administrators, people, pads and drones."""

from __future__ import annotations

import asyncio
import base64
import datetime as dt
import os
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import yaml
from cryptography import x509

from wonderland_fabric_gateway.attributes import ID, ROLE
from wonderland_fabric_gateway.ca.certificates import new_private_key
from wonderland_fabric_gateway.ca.client import (
    ALREADY_REGISTERED,
    FabricCaClient,
    FabricCaError,
    FabricCaUnreachableError,
)
from wonderland_fabric_gateway.ca.requests import TLS_PROFILE, CertificateRequest
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network import certificates, settings
from wonderland_fabric_network.errors import CertificateStateError, ComponentError, DirectoryStateError
from wonderland_fabric_network.layout import MSP_ADMIN, REGISTRAR, IdentityPaths, NodeDirectory, OrganisationDirectory
from wonderland_fabric_network.processes import Launch, ProcessTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.description import Certificates
    from wonderland_fabric_network.hosts import Hosts

_SECRET_BYTES: Final = 24
MAX_CLOCK_DIFFERENCE: Final = dt.timedelta(minutes=5)
_SETTINGS: Final = "fabric-ca-server-config.yaml"


@dataclass(frozen=True)
class Certified:
    """Who is to have a certificate: node OU and attributes go into it."""

    name: str
    node_ou: str
    attributes: Mapping[str, str]

    @classmethod
    def with_role(cls, name: str, role: str, pol_id: str) -> Self:
        """A person or machine with a role on the channel."""
        return cls(name, "client", {ROLE: role, ID: pol_id})


@dataclass(frozen=True)
class Admitted:
    """Certificates (PEM) for keys that were made elsewhere."""

    certificate: bytes
    tls_certificate: bytes


class Authority:
    """One organisation's CA server. Use as an asynchronous context once `start` has been called, or it runs.

    `now` gives the time (aware UTC), `random_bytes` n unpredictable bytes.
    """

    def __init__(
        self,
        directory: OrganisationDirectory,
        ports: tuple[int, int],
        hosts: Hosts,
        issue: Certificates,
        *,
        now: Callable[[], dt.datetime] = lambda: dt.datetime.now(dt.UTC),
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.directory: Final = directory
        self.msp_id: Final = directory.msp_id
        self.component: Final = f"{directory.msp_id}.ca"
        self._port, self._operations_port = ports
        self._hosts = hosts
        self._host = hosts.of(directory.msp_id, "ca")
        self._issue = issue
        self._now = now
        self._random_bytes = random_bytes
        self._clients: AsyncExitStack = AsyncExitStack()
        self._ca: FabricCaClient | None = None
        self._tls_ca: FabricCaClient | None = None

    def hosts(self, name: str) -> tuple[str, ...]:
        """Names and addresses that a TLS certificate of that name is for."""
        return self._hosts.names(self.msp_id, name)

    @property
    def address(self) -> str:
        """``host:port`` at which it is found."""
        return f"{self._host}:{self._port}"

    def launch(self, binary: Path) -> Launch:
        """How its server is started; its settings are written by `configure`."""
        return Launch(
            self.component,
            (str(binary), "start", "-H", str(self.directory.ca_home)),
            {},
            ((self._host, self._port),),
        )

    def configure(self) -> None:
        """Write the server's settings, keeping the registrar's secret. Raises `DirectoryStateError`."""
        home = self.directory.ca_home
        second = home / settings.TLS_CA_DIRECTORY
        certificates.make_private(second)
        place = settings.CaPlace(
            self._hosts.bind,
            self._port,
            self._operations_port,
            REGISTRAR,
            self._registrar_secret() or self._secret(),
            self.hosts("ca"),
        )
        tls_file = second / _SETTINGS
        instance = settings.ca_instance(self.msp_id, settings.tls_ca_name(self.msp_id), place, self._issue)
        write_atomic(tls_file, _yaml(instance))
        write_atomic(home / _SETTINGS, _yaml(settings.ca_server(self.msp_id, place, self._issue, tls_file)))

    async def start(self, processes: ProcessTable, binary: Path) -> None:
        """Run the server and wait until it answers. Raises `ComponentError`."""
        launch = self.launch(binary)
        if processes.pid(self.component) is None:
            processes.start(launch)
        await processes.wait_ready(launch)
        self.keep_roots()

    def keep_roots(self) -> None:
        """Keep the roots of a server that has started, or see that they are the same.

        Raises `DirectoryStateError`, `CertificateStateError`.
        """
        for source, target in (
            (self.directory.ca_home, self.directory.root),
            (self.directory.ca_home / settings.TLS_CA_DIRECTORY, self.directory.tls_root),
        ):
            pem = read_bounded(source / "ca-cert.pem", DirectoryStateError, f"{self.msp_id}: root certificate")
            if not target.exists():
                write_atomic(target, pem, PUBLIC)
            elif target.read_bytes() != pem:
                raise CertificateStateError(
                    f"{self.msp_id}: its CA has another root than the one that the channel trusts ({target}). Next: "
                    f"restore {source} from a backup"
                )

    async def __aenter__(self) -> Self:
        root = read_bounded(self.directory.root, DirectoryStateError, f"{self.msp_id}: root certificate")
        self._ca = await self._clients.enter_async_context(
            FabricCaClient(self.address, settings.ca_name(self.msp_id), root)
        )
        self._tls_ca = await self._clients.enter_async_context(
            FabricCaClient(self.address, settings.tls_ca_name(self.msp_id), root)
        )
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._clients.aclose()

    @property
    def ca(self) -> FabricCaClient:
        """The CA of identities."""
        assert self._ca is not None
        return self._ca

    @property
    def tls_ca(self) -> FabricCaClient:
        """The CA of TLS certificates."""
        assert self._tls_ca is not None
        return self._tls_ca

    async def require_clock(self) -> None:
        """Raise `CertificateStateError` when this machine's clock is far from the CA's; `CaError` without an answer."""
        said, here = (await self.ca.info()).now, self._now()
        if said is not None and abs(said - here) > MAX_CLOCK_DIFFERENCE:
            raise CertificateStateError(
                f"{self.component}: its clock says {said:%Y-%m-%d %H:%M} UTC, this machine's {here:%Y-%m-%d %H:%M} "
                "UTC; Fabric refuses what is more than 15 minutes off. Next: set both clocks right (NTP), then run "
                "this again"
            )

    async def registrar(self) -> SigningIdentity:
        """Who registers and revokes identities."""
        return await self._registrar(self.ca, self.directory.identity(REGISTRAR))

    async def ensure_administrator(self) -> None:
        """The organisation's administrator (OU admin)."""
        await self.ensure(Certified(MSP_ADMIN, "admin", {}), self.directory.identity(MSP_ADMIN))

    async def ensure(self, who: Certified, paths: IdentityPaths) -> None:
        """Key and certificate of an identity, enrolled where missing. Raises `CaError`, `CertificateStateError`."""
        if certificates.fits(paths):
            certificates.require_usable(
                paths.certificate, self._root(self.directory.root), self._now(), f"{self.msp_id}/{who.name}"
            )
            return
        await self.enrol(who, paths)

    async def enrol(self, who: Certified, paths: IdentityPaths) -> None:
        """A new key and certificate, whatever there is. Raises `CaError`."""
        await self._enrol(self.ca, await self.registrar(), who, paths)

    async def invite(self, who: Certified) -> str:
        """A secret with which a new name enrols itself, once. Raises `CaError`; a known name cannot be invited."""
        secret = self._secret()
        await self.ca.register(
            await self.registrar(),
            who.name,
            node_ou=who.node_ou,
            secret=secret,
            attributes=who.attributes,
            max_enrolments=1,
        )
        return secret

    async def admit(self, who: Certified, request: CertificateRequest, tls_request: CertificateRequest) -> Admitted:
        """Certificates of identity and TLS (PEM) for keys that were made elsewhere. Raises `CaError`.

        A name that was admitted before gets newer ones, for whichever keys, with the attributes that it has.
        """
        secret = self._secret()  # used once, now, and never kept
        await self._let_enrol(self.ca, await self.registrar(), who, secret)
        certificate = await self.ca.enrol_request(request, secret)
        registrar = await self._registrar(self.tls_ca, self.directory.tls_identity(REGISTRAR))
        await self._let_enrol(self.tls_ca, registrar, Certified(who.name, who.node_ou, {}), secret)
        return Admitted(certificate, await self.tls_ca.enrol_request(tls_request, secret, profile=TLS_PROFILE))

    async def ensure_tls(self, name: str, node_ou: str, paths: IdentityPaths) -> None:
        """Key and TLS certificate for a server or client of this organisation. Raises `CaError`."""
        if certificates.fits(paths):
            certificates.require_usable(
                paths.certificate, self._root(self.directory.tls_root), self._now(), f"{self.msp_id}/{name} (TLS)"
            )
            return
        await self.enrol_tls(name, node_ou, paths)

    async def enrol_tls(self, name: str, node_ou: str, paths: IdentityPaths) -> None:
        """A new key and TLS certificate, whatever there is. Raises `CaError`."""
        registrar = await self._registrar(self.tls_ca, self.directory.tls_identity(REGISTRAR))
        await self._enrol(
            self.tls_ca,
            registrar,
            Certified(name, node_ou, {}),
            paths,
            profile=TLS_PROFILE,
            hosts=self.hosts(name),
        )

    async def renew(self, name: str, paths: IdentityPaths, *, keep_key: bool = False) -> None:
        """A new certificate for a name that was enrolled before, its attributes as they are. Raises `CaError`."""
        await self._renew(self.ca, await self.registrar(), name, paths, keep_key=keep_key)

    async def renew_tls(self, name: str, paths: IdentityPaths, *, keep_key: bool = False) -> None:
        """A new TLS certificate for a name that was enrolled before. Raises `CaError`."""
        registrar = await self._registrar(self.tls_ca, self.directory.tls_identity(REGISTRAR))
        profile = TLS_PROFILE
        await self._renew(
            self.tls_ca, registrar, name, paths, keep_key=keep_key, profile=profile, hosts=self.hosts(name)
        )

    async def renew_registrars(self) -> None:
        """New certificates for who registers identities. Raises `CaError`."""
        for ca, paths in (
            (self.ca, self.directory.identity(REGISTRAR)),
            (self.tls_ca, self.directory.tls_identity(REGISTRAR)),
        ):
            await self._enrol_registrar(ca, paths)

    async def ensure_node(self, name: str, node_ou: str) -> NodeDirectory:
        """A server's directory: MSP and TLS, as Fabric's servers read them. Raises `CaError`."""
        node = self.directory.node(name)
        async with asyncio.TaskGroup() as group:
            group.create_task(self.ensure(Certified(name, node_ou, {}), node.identity))
            group.create_task(self.ensure_tls(name, node_ou, node.tls))
        self.write_msp(node)
        return node

    def write_msp(self, node: NodeDirectory) -> None:
        """The parts of a server's directory that are not its own keys."""
        root, tls_root = self.directory.root.read_bytes(), self.directory.tls_root.read_bytes()
        for path, data in (
            (node.msp / "cacerts" / "ca.pem", root),
            (node.msp / "tlscacerts" / "tls-ca.pem", tls_root),
            (node.msp / "config.yaml", _yaml(settings.NODE_OUS)),
            (node.tls_root, tls_root),
        ):
            certificates.make_private(path.parent)
            if not path.exists() or path.read_bytes() != data:
                write_atomic(path, data, PUBLIC)

    async def _registrar(self, ca: FabricCaClient, paths: IdentityPaths) -> SigningIdentity:
        if not certificates.fits(paths) or certificates.load(paths.certificate).not_valid_after_utc < self._now():
            await self._enrol_registrar(ca, paths)
        return certificates.signing_identity(self.msp_id, paths)

    async def _enrol_registrar(self, ca: FabricCaClient, paths: IdentityPaths) -> None:
        secret = self._registrar_secret()
        if secret is None:
            raise DirectoryStateError(f"{self.directory.ca_home} has no settings; run `wonderland network up`")
        key = new_private_key(self._random_bytes)
        certificates.store(paths, await ca.enrol(REGISTRAR, secret, key), key)

    async def _renew(
        self,
        ca: FabricCaClient,
        registrar: SigningIdentity,
        name: str,
        paths: IdentityPaths,
        *,
        keep_key: bool,
        profile: str = "",
        hosts: Sequence[str] = (),
    ) -> None:
        secret = self._secret()
        await ca.set_secret(registrar, name, secret)
        key = certificates.load_key(paths.key) if keep_key else new_private_key(self._random_bytes)
        certificates.store(paths, await ca.enrol(name, secret, key, profile=profile, hosts=hosts), key)

    async def _enrol(
        self,
        ca: FabricCaClient,
        registrar: SigningIdentity,
        who: Certified,
        paths: IdentityPaths,
        *,
        profile: str = "",
        hosts: Sequence[str] = (),
    ) -> None:
        secret = self._secret()  # used once, now, and never kept
        await self._let_enrol(ca, registrar, who, secret)
        key = new_private_key(self._random_bytes)
        certificates.store(paths, await ca.enrol(who.name, secret, key, profile=profile, hosts=hosts), key)

    async def _let_enrol(self, ca: FabricCaClient, registrar: SigningIdentity, who: Certified, secret: str) -> None:
        """Register a name, or give one that is known another secret."""
        try:
            await ca.register(registrar, who.name, node_ou=who.node_ou, secret=secret, attributes=who.attributes)
        except FabricCaError as error:
            if error.code != ALREADY_REGISTERED:
                raise
            await ca.set_secret(registrar, who.name, secret, attributes=who.attributes)
        except FabricCaUnreachableError as error:
            raise ComponentError(self.component, str(error), remedy="`wonderland network up` starts it") from error

    def _registrar_secret(self) -> str | None:
        path = self.directory.ca_home / _SETTINGS
        if not path.exists():
            return None
        try:
            document: Any = yaml.safe_load(read_bounded(path, DirectoryStateError, "CA settings"))
            secret: Any = document["registry"]["identities"][0]["pass"]
        except (yaml.YAMLError, KeyError, IndexError, TypeError) as cause:
            raise DirectoryStateError(f"{path}: cannot be read; restore it from a backup") from cause
        if not isinstance(secret, str):
            raise DirectoryStateError(f"{path}: the registrar has no secret; restore it from a backup")
        return secret

    def _secret(self) -> str:
        return base64.urlsafe_b64encode(self._random_bytes(_SECRET_BYTES)).decode()

    def _root(self, path: Path) -> x509.Certificate:
        return certificates.load(path)


def _yaml(document: dict[str, Any]) -> bytes:
    text: str = yaml.safe_dump(document, sort_keys=False)
    return text.encode()
