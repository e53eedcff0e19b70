"""From a description to a network that answers; and from whatever an earlier attempt left behind to the same.

Each step looks at what is there and does what is missing, so that `up` may be run again after any failure, crash or
reboot. What can go on at the same time does: that is where the seconds are.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, TypeAlias

from wonderland_fabric_gateway.channel_groups import OrganisationDescription
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network import connections, lifecycle, ports, recovery
from wonderland_fabric_network.agreement import Agreement, load_agreement, require_installed, save_agreement
from wonderland_fabric_network.cards import load_membership
from wonderland_fabric_network.certificates import signing_identity
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.contract import (
    SLOTS,
    InstalledContract,
    build_package,
    installed_contract,
)
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import ComponentError, DirectoryStateError, NetworkError, UnreachableError
from wonderland_fabric_network.genesis import ChannelPlan, first_block
from wonderland_fabric_network.hosts import CONTRACT
from wonderland_fabric_network.layout import CLIENT, MSP_ADMIN, NetworkDirectory
from wonderland_fabric_network.leadership import wait_leader
from wonderland_fabric_network.membership import NONCE_BYTES
from wonderland_fabric_network.network import Member, Network, contract_component
from wonderland_fabric_network.with_others import WithOthers

if TYPE_CHECKING:
    from wonderland_fabric_network.authorities import Authority
    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.peers import PeerAdmin
    from wonderland_fabric_network.processes import Launch

Report: TypeAlias = Callable[[str, str], None]
"""Hears of each step that begins, and what of it has just been done."""


def open_network(directory: NetworkDirectory) -> Network:
    """A network that was brought up before, perhaps not to its end. Raises `NetworkError`."""
    directory.require()
    description = NetworkDescription.load(directory.description_file)
    membership = load_membership(directory)
    listening = ports.allot(directory.ports_file, description, os.urandom, membership)
    return Network(directory, description, listening, membership=membership)


def new_network(directory: NetworkDirectory, description: NetworkDescription | None) -> Network:
    """The network of a directory; of that description when there is none yet. Raises `NetworkError`."""
    directory.prepare()
    if directory.description_file.exists():
        there = NetworkDescription.load(directory.description_file)
        if description is not None and description != there:
            raise DirectoryStateError(
                f"{directory.path} holds a network of another description ({directory.description_file}). Next: leave "
                "the options and the file away to start that one, use another --dir, or `wonderland network destroy`"
            )
        return open_network(directory)
    description = description or NetworkDescription()
    description.require_pads_endorse()
    installed_contract(description.contract.package)  # whether it is there at all, before anything is written
    listening = ports.allot(directory.ports_file, description, os.urandom)
    description.save(directory.description_file)
    return Network(directory, description, listening)


async def bring_up(network: Network, binaries: Binaries, report: Report) -> None:
    """Have everything run, and the contract answer. Raises `LedgerError`; running it again goes on from there."""
    await BringUp(network, binaries, report).run()


def prepare(network: Network) -> None:
    """What CAs that run elsewhere need to start: their settings, with a new secret. Raises `LedgerError`."""
    for msp_id in network.msp_ids:
        network.authority(msp_id).configure()


class BringUp:
    """The steps, for one network."""

    def __init__(self, network: Network, binaries: Binaries, report: Report) -> None:
        self._network = network
        self._binaries = binaries
        self._report = report
        self._processes = network.processes

    async def run(self) -> None:
        """All of them, in order, the servers being ours to start."""
        network = self._network
        network.require_here()
        self._require_met()
        network.write_builder()
        contract = installed_contract(network.description.contract.package)
        agreement = load_agreement(network.directory.contract_file)
        async with AsyncExitStack() as stack:
            self._report("certificates", "starting the organisations' CAs")
            authorities = await together(self.organisation(msp_id, stack) for msp_id in network.msp_ids)
            block = channel_block(self._network)
            if agreement is None or agreement.fits(contract):
                await self._contract_servers(contract, agreement.slot if agreement else SLOTS[0])
            self._report("channel", f"joining {network.channel}")
            peers = await network.peer_admins(stack)
            await together(
                [
                    *(self._join_orderer(member, block) for member in network.orderers),
                    *(self.join_peer(member, peer, block) for member, peer in zip(network.peers, peers, strict=True)),
                    *(self.identities(authority) for authority in authorities),
                ]
            )
            connections.write_first(network)
            if network.membership is not None:
                await WithOthers(network, self._report).agree(peers, contract, agreement)
                return
            await wait_leader(network)
            await self._agree(peers, contract, agreement)

    def _require_met(self) -> None:
        membership = self._network.membership
        missing = () if membership is None else membership.missing(self._network.description)
        if missing:
            raise DirectoryStateError(
                f"the cards of {', '.join(missing)} are not here yet. Next: `wonderland network meet CARD…`"
            )

    async def certify(self) -> None:
        """Whatever servers elsewhere need to start, by CAs that run: certificates, settings, the channel's block."""
        network = self._network
        contract = installed_contract(network.description.contract.package)
        async with AsyncExitStack() as stack:
            self._report("certificates", "waiting for the organisations' CAs")
            authorities = await together(self.organisation(msp_id, stack) for msp_id in network.msp_ids)
            channel_block(self._network)
            await together(self.identities(authority) for authority in authorities)
        connections.write_first(network)
        await self._contract_servers(contract, SLOTS[0])

    async def join(self, *, agree: bool = False) -> None:
        """Servers that run elsewhere on the channel, and the contract agreed on.

        `agree`: also on an installed contract that differs from the one that was agreed on.
        """
        network = self._network
        contract = installed_contract(network.description.contract.package)
        agreement = load_agreement(network.directory.contract_file)
        block = channel_block(self._network)
        async with AsyncExitStack() as stack:
            peers = await network.peer_admins(stack)
            self._report("channel", f"joining {network.channel}")
            await together(
                [
                    *(self._join_orderer(member, block) for member in network.orderers),
                    *(self.join_peer(member, peer, block) for member, peer in zip(network.peers, peers, strict=True)),
                ]
            )
            await wait_leader(network)
            if agree and agreement is not None and not agreement.fits(contract):
                agreement = await self._agree_anew(peers, contract, agreement)
            await self._agree(peers, contract, agreement)

    async def _agree_anew(self, peers: list[PeerAdmin], contract: InstalledContract, former: Agreement) -> Agreement:
        """The installed contract under the next sequence, in the slot of the former one."""
        network = self._network
        described = network.description.contract
        package = build_package(described.name, contract, former.slot)
        sequence = former.sequence + 1
        self._report("contract", f"agreeing on {described.name} {contract.version}, sequence {sequence}")
        wanted = lifecycle.Definition(
            described.name, sequence, contract.version, described.policy.validation_parameter()
        )
        await lifecycle.agree(network, peers, wanted, package)
        await together(lifecycle.wait_definition(peer, network.channel, described.name, sequence) for peer in peers)
        return Agreement(sequence, contract.version, contract.sha256, package.slot, package.package_id)

    async def organisation(self, msp_id: str, stack: AsyncExitStack) -> Authority:
        """Its CA, what its servers need of it, and those servers started."""
        network = self._network
        authority = network.authority(msp_id)
        self._require_free([authority.launch(self._binaries.ca_server)])
        authority.configure()
        try:
            await authority.start(self._processes, self._binaries.ca_server)
            await stack.enter_async_context(authority)
            orderers = [member for member in network.orderers if member.msp_id == msp_id]
            peers = [member for member in network.peers if member.msp_id == msp_id]
            await together(
                [
                    authority.ensure_administrator(),
                    *(self._start(authority, member, "orderer") for member in orderers),
                    *(self._start(authority, member, "peer") for member in peers),
                    *([self._client_tls(authority, MSP_ADMIN)] if orderers else []),
                    *([self._client_tls(authority, CLIENT)] if peers else []),
                    *([ensure_contract_tls(authority)] if msp_id in network.endorsers else []),
                ]
            )
            await authority.require_clock()
        except NetworkError:
            raise
        except LedgerError as error:
            raise self._processes.failure(authority.component, str(error)) from error
        return authority

    async def _start(self, authority: Authority, member: Member, kind: str) -> None:
        await authority.ensure_node(member.name, kind)
        if kind == "orderer":
            self._network.configure_orderer(member)
            launch = self._network.launch_orderer(member, self._binaries)
        else:
            self._network.configure_peer(member)
            launch = self._network.launch_peer(member, self._binaries)
        if self._network.hosts.each:
            return
        self._begin(launch)
        await self._processes.wait_ready(launch)
        self._report(f"{kind}s", f"{member.component} runs")

    async def _client_tls(self, authority: Authority, name: str) -> None:
        await authority.ensure_tls(name, "client", authority.directory.tls_identity(name))

    async def identities(self, authority: Authority) -> None:
        """One identity for each role of an organisation that uses the channel, the first time."""
        kinds = {each.msp_id: each.kind for each in self._network.organisations}
        if authority.msp_id in kinds and not authority.directory.connection_file.exists():
            for who in connections.first_identities(kinds[authority.msp_id]):
                await authority.ensure(who, authority.directory.identity(who.name))

    async def _join_orderer(self, member: Member, block: bytes) -> None:
        async with self._network.orderer_admin(member) as admin:
            try:
                if await admin.status(self._network.channel) is None:
                    if load_agreement(self._network.directory.contract_file) is not None:
                        await recovery.require_others_agree(self._network, member, self._report)
                    await admin.join(block)
            except ComponentError:
                raise
            except NetworkError as error:
                raise self._processes.failure(member.component, str(error)) from error
        self._report("channel", f"{member.component} joined")

    async def join_peer(self, member: Member, peer: PeerAdmin, block: bytes) -> None:
        """A peer on the channel. Raises `ComponentError`."""
        try:
            if self._network.channel not in await peer.channels():
                await peer.join(block)
        except NetworkError as error:
            raise self._processes.failure(member.component, str(error)) from error
        self._report("channel", f"{member.component} joined")

    async def _contract_servers(self, contract: InstalledContract, slot: str) -> None:
        package = build_package(self._network.description.contract.name, contract, slot)
        for msp_id in self._network.endorsers:
            self._network.configure_contract(msp_id, package)
            self._begin(self._network.launch_contract(msp_id, slot))

    async def _agree(self, peers: list[PeerAdmin], contract: InstalledContract, agreement: Agreement | None) -> None:
        """The contract installed, approved and committed; its servers reached."""
        network = self._network
        described = network.description.contract
        definition = await peers[0].definition(network.channel, described.name)
        if definition is None:
            self._report("contract", f"agreeing on {described.name} {contract.version}")
            package = build_package(described.name, contract, SLOTS[0])
            wanted = lifecycle.Definition(described.name, 1, contract.version, described.policy.validation_parameter())
            await lifecycle.agree(network, peers, wanted, package)
            agreement = Agreement(1, contract.version, contract.sha256, package.slot, package.package_id)
        else:
            agreement = agreement or await self._recall(peers, definition.sequence, contract)
            require_installed(agreement, contract)
            await self._contract_servers(contract, agreement.slot)
            package = build_package(described.name, contract, agreement.slot)
            endorsing = [peer for peer in peers if peer.msp_id in network.endorsers]
            if not all(
                await together(
                    recovery.has_contract(network, peer, package, agreement, self._report) for peer in endorsing
                )
            ):
                agreement = await self._agree_anew(peers, contract, agreement)
        save_agreement(network.directory.contract_file, agreement)
        for msp_id in network.endorsers:
            await self._processes.wait_ready(network.launch_contract(msp_id, agreement.slot))
        self._report("contract", "waiting until every peer reaches the organisations that must endorse")
        authority = peers[0].msp_id
        inspector = signing_identity(authority, network.directory.organisation(authority).identity("inspector"))
        # Each peer for itself: a client of any organisation begins at one of its own.
        try:
            await together(
                lifecycle.wait_answering(peer, inspector, network.channel, described.name, lifecycle.PROBE)
                for peer in peers
            )
        except ComponentError as error:
            for msp_id in network.endorsers:
                component = contract_component(msp_id, agreement.slot)
                if not network.hosts.each and self._processes.pid(component) is None:
                    raise self._processes.failure(component, "ended after it had started") from error
            raise

    async def _recall(self, peers: list[PeerAdmin], sequence: int, contract: InstalledContract) -> Agreement:
        """What was agreed on, when the note about it is lost: the channel knows."""
        network = self._network
        described = network.description.contract
        endorser = next(peer for peer in peers if peer.msp_id in network.endorsers)
        approved = await lifecycle.approved_package(endorser, network.channel, described.name, sequence)
        for slot in SLOTS:
            package = build_package(described.name, contract, slot)
            if package.package_id == approved:
                return Agreement(sequence, contract.version, contract.sha256, slot, package.package_id)
        raise ComponentError(
            endorser.component,
            f"the organisations agreed on the package {approved}, which is not that of the installed contract "
            f"{described.package} {contract.version}",
            remedy="install that version of the contract, or agree on this one by `wonderland network upgrade`",
        )

    def _begin(self, launch: Launch) -> None:
        if self._processes.pid(launch.name) is None:
            self._require_free([launch])
            self._processes.start(launch)

    def _require_free(self, launches: list[Launch]) -> None:
        if self._network.hosts.each:
            return
        for launch in launches:
            if self._processes.pid(launch.name) is None:
                for host, port in launch.listens:
                    ports.require_free(host, [port], launch.name)


def channel_block(network: Network) -> bytes:
    """The channel's first block, made once. Raises `LedgerError`."""
    path = network.directory.block_file
    if path.exists():
        return read_bounded(path, DirectoryStateError, "the channel's first block", 100 << 20)
    ordering = network.description.ordering
    applications = sorted(network.description.organisations, key=lambda each: each.kind != "authority")
    plan = ChannelPlan(
        channel=network.channel,
        applications=tuple(describe_organisation(network, each.msp_id) for each in applications),
        orderers=tuple(
            describe_organisation(network, each.msp_id) for each in network.description.ordering.organisations
        ),
        consenters=network.consenters(),
        ordering=ordering,
    )
    t_s, nonce = (
        (int(network.now().timestamp()), network.random_bytes(NONCE_BYTES))
        if network.membership is None
        else network.membership.founding()
    )
    block = first_block(plan, t_s, nonce)
    write_atomic(path, block, PUBLIC)
    return block


async def ensure_contract_tls(authority: Authority) -> None:
    """What an organisation's contract servers show on TLS connections. Raises `CaError`."""
    node = authority.directory.node(CONTRACT)
    await authority.ensure_tls(CONTRACT, "client", node.tls)
    if not node.tls_root.exists():
        write_atomic(node.tls_root, authority.directory.tls_root.read_bytes(), PUBLIC)


def describe_organisation(network: Network, msp_id: str) -> OrganisationDescription:
    """An organisation as the channel's configuration has it. Raises `UnreachableError` when its roots are missing."""
    directory = network.directory.organisation(msp_id)
    try:
        root, tls_root = directory.root.read_bytes(), directory.tls_root.read_bytes()
    except OSError as cause:
        raise UnreachableError(f"{msp_id}: {cause.filename}: {cause.strerror}") from cause
    orderers = [member for member in network.every_orderer if member.msp_id == msp_id]
    peers = [member for member in network.every_peer if member.msp_id == msp_id]
    return OrganisationDescription(
        msp_id,
        root,
        tls_root,
        endpoints=tuple(network.address(member) for member in orderers),
        anchor_peers=tuple((network.hosts.of(msp_id, member.name), network.port(member)) for member in peers[:1]),
    )
