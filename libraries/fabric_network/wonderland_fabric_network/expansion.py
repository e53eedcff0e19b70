"""Another organisation on a running channel: its CA, its peers, and, if the others agree, its signature.

The majority of the organisations there signs that it joins. Its peers begin with block 0. When the endorsement policy
is to name it, every organisation agrees on that as on a new version of the contract.
"""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wonderland_fabric_gateway.channel_groups import organisation_group
from wonderland_fabric_gateway.files import read_bounded
from wonderland_fabric_network import certificates, connections, lifecycle
from wonderland_fabric_network.agreement import load_agreement, require_installed
from wonderland_fabric_network.bringing_up import BringUp, describe_organisation
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.config_update import update_channel
from wonderland_fabric_network.contract import build_package, installed_contract
from wonderland_fabric_network.description import extended_endorsement
from wonderland_fabric_network.errors import DirectoryStateError
from wonderland_fabric_network.layout import MSP_ADMIN
from wonderland_fabric_network.upgrading import Upgrade, upgrade

if TYPE_CHECKING:
    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.description import Organisation
    from wonderland_fabric_network.network import Network
    from wonderland_fabric_network.peers import PeerAdmin


@dataclass(frozen=True)
class Joined:
    """An organisation that uses the channel since `block` (None: it did already), and what was agreed on with it."""

    network: Network
    block: int | None
    upgrade: Upgrade | None


async def add_organisation(
    network: Network, binaries: Binaries, organisation: Organisation, report: Report, *, endorsement: str | None = None
) -> Joined:
    """Have an organisation join, and endorse when a policy that names it is given. Raises `LedgerError`.

    An operator of pads must endorse: what belongs to its pads needs its signature. Where the policy is the standard
    one, it becomes that of the larger network by itself. May be run again after any failure, with the same
    organisation.
    """
    network.require_whole()
    there = {each.msp_id: each for each in network.description.organisations}
    if there.get(organisation.msp_id) not in {None, organisation}:
        raise DirectoryStateError(
            f"{organisation.msp_id} takes part already, and otherwise: {there[organisation.msp_id]}"
        )
    before = tuple(each.msp_id for each in network.organisations if each.msp_id != organisation.msp_id)
    if organisation.msp_id not in there:
        network = network.with_description(network.description.with_organisation(organisation))
    if endorsement is None:
        endorsement = extended_endorsement(network.description)
    if endorsement is not None:  # whether it makes sense, before anything is started
        network.description.with_endorsement(endorsement).require_pads_endorse()
    steps = BringUp(network, binaries, report)
    network.require_here()
    async with AsyncExitStack() as stack:
        report("certificates", f"starting {organisation.msp_id}'s CA")
        authority = await steps.organisation(organisation.msp_id, stack)
        members = [member for member in network.peers if member.msp_id == organisation.msp_id]
        own = [await stack.enter_async_context(network.peer_admin(member)) for member in members]
        others = [
            await stack.enter_async_context(network.peer_admin(member))
            for member in network.peers
            if member.msp_id != organisation.msp_id
        ]
        report("channel", f"{', '.join(before)} agree that {organisation.msp_id} joins")
        block_number = await _admit(network, others, organisation.msp_id, before)
        block = read_bounded(network.directory.block_file, DirectoryStateError, "the channel's first block", 100 << 20)
        await together(
            [
                *(steps.join_peer(member, peer, block) for member, peer in zip(members, own, strict=True)),
                steps.identities(authority),
            ]
        )
        connections.write_first(network)
        connections.add_all(network, organisation.msp_id)
        network.description.save(network.directory.description_file)
        await _approve_current(network, own)
    done: Upgrade | None = None
    if endorsement is not None:
        network, done = await upgrade(network, report, endorsement=endorsement)
    return Joined(network, block_number, done)


async def _admit(network: Network, peers: list[PeerAdmin], msp_id: str, signing: tuple[str, ...]) -> int | None:
    """The organisation in the channel's configuration, signed for by the others' administrators."""
    group = organisation_group(describe_organisation(network, msp_id), orderer=False)

    def change(root: Any) -> None:
        members = root.groups["Application"].groups
        if msp_id not in members:
            members[msp_id].CopyFrom(group)

    majority = signing[: len(signing) // 2 + 1]
    signers = [
        certificates.signing_identity(each, network.directory.organisation(each).identity(MSP_ADMIN))
        for each in majority
    ]
    return await update_channel(network, peers, change, signers)


async def _approve_current(network: Network, own: list[PeerAdmin]) -> None:
    """The new organisation agrees to the contract that runs, so that its peers can be asked about it."""
    described = network.description.contract
    contract = installed_contract(described.package)
    agreement = load_agreement(network.directory.contract_file)
    if agreement is None:
        raise DirectoryStateError("there is no contract on the channel yet; `wonderland network up` agrees on one")
    require_installed(agreement, contract)
    await together(lifecycle.wait_definition(peer, network.channel, described.name, agreement.sequence) for peer in own)
    wanted = lifecycle.Definition(
        described.name, agreement.sequence, agreement.version, described.policy.validation_parameter()
    )
    runs_it = own[0].msp_id in network.endorsers
    package = build_package(described.name, contract, agreement.slot)
    if runs_it:
        await together(lifecycle.install(peer, package) for peer in own)
    await lifecycle.approve(own[0], network.channel, wanted, package.package_id if runs_it else None)
