"""One network: its directory, who listens where, and how each component is configured, started and reached."""

from __future__ import annotations

import datetime as dt
import os
import shlex
import sys
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import yaml

from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import builder, ports, settings
from wonderland_fabric_network.agreement import load_agreement
from wonderland_fabric_network.authorities import Authority
from wonderland_fabric_network.certificates import make_private, signing_identity
from wonderland_fabric_network.contract import SLOTS
from wonderland_fabric_network.elsewhere import Elsewhere
from wonderland_fabric_network.errors import DirectoryStateError
from wonderland_fabric_network.genesis import Consenter
from wonderland_fabric_network.hosts import CONTRACT, Hosts
from wonderland_fabric_network.layout import CLIENT, MSP_ADMIN, NetworkDirectory, NodeDirectory
from wonderland_fabric_network.orderers import Broadcast, OrdererAdmin
from wonderland_fabric_network.peers import PeerAdmin
from wonderland_fabric_network.processes import Launch, ProcessTable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.contract import ContractPackage
    from wonderland_fabric_network.description import NetworkDescription, Organisation
    from wonderland_fabric_network.membership import Membership

_EXECUTABLE: Final = 0o755


@dataclass(frozen=True)
class Member:
    """A peer or an orderer: organisation, its name there, its number among all of its kind (from 1)."""

    msp_id: str
    name: str
    number: int

    @property
    def component(self) -> str:
        """Its name in this network."""
        return f"{self.msp_id}.{self.name}"


class Network:
    """A network that has its directory and its ports, or one member's part of it. `now` gives the time (aware UTC).

    `organisations`, `orderers`, `peers`, `endorsers` and `msp_ids` are those that this directory runs; all that the
    channel has are the description's, `every_orderer` and `every_peer`.
    """

    def __init__(
        self,
        directory: NetworkDirectory,
        description: NetworkDescription,
        listening: ports.Ports,
        *,
        membership: Membership | None = None,
        now: Callable[[], dt.datetime] = lambda: dt.datetime.now(dt.UTC),
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.directory: Final = directory
        self.description: Final = description
        self.ports: Final = listening
        self.membership: Final = membership
        self.hosts: Final = Hosts(description, membership.hosts if membership is not None else {})
        self.processes: Final[ProcessTable] = (Elsewhere if self.hosts.each else ProcessTable)(
            directory.run, directory.logs
        )
        self.now: Final = now
        self.random_bytes: Final = random_bytes

    def with_description(self, description: NetworkDescription, membership: Membership | None = None) -> Network:
        """The same network as it will be, with these members where given; ports for what is new are chosen.

        Nothing else is written.
        """
        membership = membership or self.membership
        listening = ports.allot(self.directory.ports_file, description, self.random_bytes, membership)
        return Network(
            self.directory,
            description,
            listening,
            membership=membership,
            now=self.now,
            random_bytes=self.random_bytes,
        )

    def require_whole(self) -> None:
        """Raise `DirectoryStateError` where this directory has the keys of some organisations only."""
        if self.membership is not None:
            raise DirectoryStateError(
                f"this directory has the keys of {', '.join(self.msp_ids)} only, and what concerns the whole channel "
                "is decided with the others. Next: see docs/operate/joining.md"
            )

    def is_mine(self, msp_id: str) -> bool:
        """Whether this directory has that organisation's keys."""
        return self.membership is None or msp_id in self.membership.mine

    def require_here(self) -> None:
        """Raise `DirectoryStateError` when something else runs the servers."""
        if self.hosts.each:
            raise DirectoryStateError(
                "the servers of this network have hosts of their own (hosts: each), and something else starts and "
                "stops them. Next: see docs/operate/containers.md for what to do there"
            )

    @property
    def channel(self) -> str:
        """The channel's name, from the description."""
        return self.description.channel

    @property
    def every_peer(self) -> tuple[Member, ...]:
        """All peers of the channel, the authority's first."""
        names = [
            (organisation.msp_id, f"peer{index}")
            for organisation in sorted(self.description.organisations, key=lambda each: each.kind != "authority")
            for index in range(organisation.peers)
        ]
        return tuple(Member(msp_id, name, number) for number, (msp_id, name) in enumerate(names, 1))

    @property
    def every_orderer(self) -> tuple[Member, ...]:
        """The orderers of all organisations, in the description's order."""
        names = [
            (organisation.msp_id, f"orderer{index}")
            for organisation in self.description.ordering.organisations
            for index in range(organisation.orderers)
        ]
        return tuple(Member(msp_id, name, number) for number, (msp_id, name) in enumerate(names, 1))

    @property
    def peers(self) -> tuple[Member, ...]:
        """The peers here."""
        return tuple(member for member in self.every_peer if self.is_mine(member.msp_id))

    @property
    def orderers(self) -> tuple[Member, ...]:
        """The orderers here."""
        return tuple(member for member in self.every_orderer if self.is_mine(member.msp_id))

    @property
    def organisations(self) -> tuple[Organisation, ...]:
        """The organisations here that use the channel, the authority first."""
        here = [each for each in self.description.organisations if self.is_mine(each.msp_id)]
        return tuple(sorted(here, key=lambda each: each.kind != "authority"))

    @property
    def msp_ids(self) -> tuple[str, ...]:
        """All organisations here, also those that only order."""
        ordering = [each.msp_id for each in self.description.ordering.organisations if self.is_mine(each.msp_id)]
        return (*(each.msp_id for each in self.organisations), *ordering)

    @property
    def endorsers(self) -> tuple[str, ...]:
        """The organisations here that run the contract."""
        return tuple(each for each in self.description.contract.policy.organisations if self.is_mine(each))

    def first_peer(self, msp_id: str) -> Member:
        """An organisation's first peer."""
        return next(peer for peer in self.peers if peer.msp_id == msp_id)

    def address(self, member: Member, port: str = "listen") -> str:
        """``host:port`` of a peer or an orderer."""
        return f"{self.hosts.of(member.msp_id, member.name)}:{self.port(member, port)}"

    def port(self, member: Member, name: str = "listen") -> int:
        """A port of a peer or an orderer."""
        return self.ports[f"{member.msp_id}/{member.name}/{name}"]

    def node(self, member: Member) -> NodeDirectory:
        """The directory of this server."""
        return self.directory.organisation(member.msp_id).node(member.name)

    def authority(self, msp_id: str) -> Authority:
        """The CA of this organisation."""
        return Authority(
            self.directory.organisation(msp_id),
            (self.ports[f"{msp_id}/ca/listen"], self.ports[f"{msp_id}/ca/operations"]),
            self.hosts,
            self.description.certificates,
            now=self.now,
            random_bytes=self.random_bytes,
        )

    def consenters(self) -> tuple[Consenter, ...]:
        """The orderers as the channel's configuration names them. Raises `DirectoryStateError` without certificates."""
        return tuple(self.consenter(member) for member in self.every_orderer)

    def consenter(self, member: Member) -> Consenter:
        """One orderer as the channel's configuration names it."""
        node = self.node(member)
        try:
            tls, identity = node.tls.certificate.read_bytes(), node.identity.certificate.read_bytes()
        except OSError as cause:
            raise DirectoryStateError(f"{member.component}: {cause.filename}: {cause.strerror}") from cause
        host = self.hosts.of(member.msp_id, member.name)
        return Consenter(member.number, member.msp_id, host, self.port(member), tls, identity)

    def peer_admin(self, member: Member) -> PeerAdmin:
        """A peer, as its organisation's administrator uses it. Raises `LedgerError`."""
        organisation = self.directory.organisation(member.msp_id)
        administrator = signing_identity(member.msp_id, organisation.identity(MSP_ADMIN))
        return PeerAdmin(
            member.component,
            self.address(member),
            organisation.tls_root.read_bytes(),
            administrator,
            client=organisation.tls_identity(CLIENT),
            random_bytes=self.random_bytes,
        )

    def orderer_admin(self, member: Member) -> OrdererAdmin:
        """An orderer, as its organisation's administrator uses it. Raises `LedgerError`."""
        organisation = self.directory.organisation(member.msp_id)
        return OrdererAdmin(
            member.component,
            self.address(member, "admin"),
            organisation.tls_root,
            organisation.tls_identity(MSP_ADMIN),
        )

    def broadcast(self, member: Member) -> Broadcast:
        """An orderer, to hand over changes of the configuration to."""
        shown = member.msp_id if self.is_mine(member.msp_id) else self.msp_ids[0]
        orders = any(each.msp_id == shown for each in self.orderers)
        return Broadcast(
            member.component,
            self.address(member),
            self.directory.organisation(member.msp_id).tls_root.read_bytes(),
            self.directory.organisation(shown).tls_identity(MSP_ADMIN if orders else CLIENT),
        )

    async def peer_admins(self, stack: AsyncExitStack) -> list[PeerAdmin]:
        """All peers, opened on that stack."""
        return [await stack.enter_async_context(self.peer_admin(member)) for member in self.peers]

    def configure_orderer(self, member: Member) -> None:
        """Write an orderer's settings."""
        node = self.node(member)
        own = (self.port(member), self.port(member, "admin"), self.port(member, "operations"))
        _write_yaml(node.path / "orderer.yaml", settings.orderer(member.msp_id, node, self.hosts.bind, *own))
        make_private(node.data)

    def launch_orderer(self, member: Member, binaries: Binaries) -> Launch:
        """How an orderer is started."""
        host = self.hosts.of(member.msp_id, member.name)
        environment = {"FABRIC_CFG_PATH": str(self.node(member).path), "FABRIC_LOGGING_SPEC": settings.LOGGING}
        listens = tuple((host, self.port(member, name)) for name in ("listen", "admin", "operations"))
        return Launch(member.component, (str(binaries.orderer), "start"), environment, listens)

    def configure_peer(self, member: Member) -> None:
        """Write a peer's settings, and what its builder of contract servers has to know."""
        node = self.node(member)
        others = [peer for peer in self.peers if peer.msp_id == member.msp_id and peer != member]
        place = settings.PeerPlace(
            member.name,
            self.hosts.of(member.msp_id, member.name),
            self.hosts.bind,
            self.port(member),
            self.port(member, "chaincode"),
            self.port(member, "operations"),
            tuple(self.address(peer) for peer in (others[:2] or [member])),
        )
        builder_path = settings.IMAGE_BUILDER if self.hosts.each else self.directory.builder
        _write_yaml(node.path / "core.yaml", settings.peer(member.msp_id, node, place, builder_path))
        configuration = settings.builder_configuration(
            [self.contract_address(member.msp_id, slot) for slot in SLOTS],
            node.tls.certificate.read_bytes(),
            node.tls.key.read_bytes(),
            node.tls_root.read_bytes(),
        )
        write_atomic(node.builder_file, configuration.encode())
        make_private(node.data)

    def launch_peer(self, member: Member, binaries: Binaries) -> Launch:
        """How a peer is started. Its builder takes its configuration, a key among it, from the environment only."""
        node = self.node(member)
        host = self.hosts.of(member.msp_id, member.name)
        start = f'{settings.BUILDER_VARIABLE}="$(cat "$1")"; export {settings.BUILDER_VARIABLE}; shift; exec "$@"'
        return Launch(
            member.component,
            ("/bin/sh", "-c", start, "sh", str(node.builder_file), str(binaries.peer), "node", "start"),
            {"FABRIC_CFG_PATH": str(node.path), "FABRIC_LOGGING_SPEC": settings.LOGGING},
            ((host, self.port(member)), (host, self.port(member, "operations"))),
        )

    def configure_contract(self, msp_id: str, package: ContractPackage) -> None:
        """Write which package an organisation's contract server serves."""
        path = self.directory.organisation(msp_id).node(CONTRACT).package_file(package.slot)
        make_private(path.parent)
        write_atomic(path, package.package_id.encode() + b"\n", PUBLIC)

    def launch_contract(self, msp_id: str, slot: str) -> Launch:
        """How an organisation's contract server is started."""
        node = self.directory.organisation(msp_id).node(CONTRACT)
        port = self.ports[f"{msp_id}/{CONTRACT}/{slot}"]
        host = self.hosts.of(msp_id, f"{CONTRACT}-{slot}")
        program = ("wonderland",) if self.hosts.each else (sys.executable, "-m", "wonderland.cli")
        arguments = (
            *(*program, "chaincode", "serve"),
            *("--contract", self.description.contract.package),
            *("--package-id-file", str(node.package_file(slot))),
            *("--listen", f"{self.hosts.bind}:{port}"),
            *("--tls-cert", str(node.tls.certificate)),
            *("--tls-key", str(node.tls.key)),
            *("--client-ca", str(node.tls_root)),
            *("--metrics", f"{self.hosts.bind}:{self.ports[f'{msp_id}/{CONTRACT}/metrics-{slot}']}"),
        )
        return Launch(contract_component(msp_id, slot), arguments, {"PYTHONUNBUFFERED": "1"}, ((host, port),))

    def contract_address(self, msp_id: str, slot: str) -> str:
        """Where an organisation's peers find its contract server."""
        host = self.hosts.of(msp_id, f"{CONTRACT}-{slot}")
        return f"{host}:{self.ports[f'{msp_id}/{CONTRACT}/{slot}']}"

    def write_builder(self) -> None:
        """The scripts that peers run to connect to contract servers."""
        scripts = self.directory.builder / "bin"
        make_private(scripts)
        module = Path(builder.__file__).absolute()
        for name in ("detect", "build", "release"):
            command = shlex.join([sys.executable, "-I", "-S", str(module), name])
            write_atomic(scripts / name, f'#!/bin/sh\nexec {command} "$@"\n'.encode(), _EXECUTABLE)

    def ca_address(self, msp_id: str) -> str:
        """``host:port`` of an organisation's CA."""
        return f"{self.hosts.of(msp_id, 'ca')}:{self.ports[f'{msp_id}/ca/listen']}"

    def running_contract_servers(self) -> dict[str, str]:
        """Address by component: those that run, and of an organisation where none does the one that should."""
        agreement = load_agreement(self.directory.contract_file)
        agreed = agreement.slot if agreement else SLOTS[0]
        return {
            contract_component(msp_id, slot): self.contract_address(msp_id, slot)
            for msp_id in self.endorsers
            for slot in SLOTS
            if slot == agreed or self.processes.pid(contract_component(msp_id, slot)) is not None
        }

    def home_of(self, name: str) -> str:
        """The organisation of an identity of that name; where one alone is here, that. Raises `DirectoryStateError`."""
        if len(self.organisations) == 1:  # a machine that made its own key has no file here
            return self.organisations[0].msp_id
        homes = [each for each in self.msp_ids if self.directory.organisation(each).identity(name).certificate.exists()]
        if len(homes) != 1:
            found = f"{' and '.join(homes)} have one; say which with --org" if homes else "none has one; see --org"
            raise DirectoryStateError(f"no single organisation has an identity {name!r}: {found}")
        return homes[0]

    def certificate_files(self) -> Iterator[tuple[str, Path]]:
        """Owner and file of every certificate that this network has."""
        for msp_id in self.msp_ids:
            organisation = self.directory.organisation(msp_id)
            yield f"{msp_id} root", organisation.root
            yield f"{msp_id} TLS root", organisation.tls_root
            yield f"{msp_id}/ca TLS", organisation.ca_home / "tls-cert.pem"
            for file in sorted(organisation.identity("x").certificate.parent.glob("*.pem")):
                yield f"{msp_id}/{file.stem}", file
            if msp_id in self.endorsers:
                yield f"{msp_id}/{CONTRACT} TLS", organisation.node(CONTRACT).tls.certificate
        for member in (*self.orderers, *self.peers):
            node = self.node(member)
            yield f"{member.msp_id}/{member.name}", node.identity.certificate
            yield f"{member.msp_id}/{member.name} TLS", node.tls.certificate


def contract_component(msp_id: str, slot: str) -> str:
    """The name of an organisation's contract server."""
    return f"{msp_id}.{CONTRACT}-{slot}"


def _write_yaml(path: Path, document: dict[str, object]) -> None:
    text: str = yaml.safe_dump(document, sort_keys=False)
    write_atomic(path, text.encode(), PUBLIC)
