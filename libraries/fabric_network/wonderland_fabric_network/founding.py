"""Founding a network together: each member has a directory, keys and servers of its own, and shows cards alone."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING

from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import ports
from wonderland_fabric_network.bringing_up import BringUp, Report
from wonderland_fabric_network.cards import keep_cards, load_membership
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.contract import installed_contract
from wonderland_fabric_network.errors import DirectoryStateError
from wonderland_fabric_network.membership import (
    ContractCard,
    MemberCard,
    Membership,
    OrdererCard,
    PeerCard,
    Roster,
    require_members,
    shared_sha256,
)
from wonderland_fabric_network.network import Network

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from wonderland_fabric_network.binaries import Binaries
    from wonderland_fabric_network.description import NetworkDescription
    from wonderland_fabric_network.layout import NetworkDirectory


def new_part(
    directory: NetworkDirectory, description: NetworkDescription, mine: Sequence[str], roster: Roster | None = None
) -> Network:
    """One member's part of a network, with nothing running yet. Raises `NetworkError`; may be repeated.

    `roster`: of a network that was founded already, which `description` has with the newcomer.
    """
    require_members(mine, description)
    contract = installed_contract(description.contract.package)
    if roster is None:
        description.require_pads_endorse()
    elif (contract.version, contract.sha256) != (roster.contract.version, roster.contract.sha256):
        raise DirectoryStateError(
            f"the members agreed on contract {roster.contract.version} (source {roster.contract.sha256[:12]}); "
            f"installed here is {contract.version} (source {contract.sha256[:12]}). Next: install theirs"
        )
    directory.prepare()
    membership = load_membership(directory)
    if directory.description_file.exists():
        there = type(description).load(directory.description_file)
        if there != description or membership is None or membership.mine != tuple(mine):
            raise DirectoryStateError(
                f"{directory.path} holds another network, or another member's part. Next: use another --dir, or "
                "`wonderland network destroy`"
            )
    membership = membership or Membership(tuple(mine))
    if roster is not None:
        membership = Membership(membership.mine, {card.msp_id: card for card in roster.cards} | dict(membership.cards))
        keep_cards(directory, roster.cards)
        write_atomic(directory.block_file, roster.block, PUBLIC)
    write_atomic(directory.mine_file, json.dumps({"mine": list(mine)}).encode() + b"\n", PUBLIC)
    listening = ports.allot(directory.ports_file, description, os.urandom, membership)
    description.save(directory.description_file)
    return Network(directory, description, listening, membership=membership)


async def make_cards(
    network: Network, binaries: Binaries, report: Report, *, newcomer: bool = False
) -> list[MemberCard]:
    """The own organisations' cards, their CAs and servers started for them. Made once. Raises `LedgerError`."""
    membership = network.membership
    assert membership is not None
    made = [membership.cards[each] for each in membership.mine if each in membership.cards]
    if len(made) == len(membership.mine):
        return made
    network.write_builder()
    steps = BringUp(network, binaries, report)
    async with AsyncExitStack() as stack:
        report("certificates", "starting the CA")
        await together(steps.organisation(msp_id, stack) for msp_id in network.msp_ids)
    cards = [_card(network, msp_id, newcomer=newcomer) for msp_id in membership.mine]
    keep_cards(network.directory, cards)
    return cards


def meet(network: Network, cards: Collection[MemberCard]) -> Network:
    """The same part, knowing these members, too. Raises `NetworkError`."""
    membership = network.membership
    if membership is None:
        raise DirectoryStateError(
            f"{network.directory.path} holds all of its network; members meet where each has its own (`network card`)"
        )
    if not set(membership.mine) <= set(membership.cards):
        raise DirectoryStateError("there is no card of this directory's own yet; `wonderland network card` makes it")
    known = membership.with_cards(cards, network.description)
    keep_cards(network.directory, cards)
    listening = ports.allot(network.directory.ports_file, network.description, os.urandom, known)
    return Network(network.directory, network.description, listening, membership=known)


def _card(network: Network, msp_id: str, *, newcomer: bool) -> MemberCard:
    organisation = network.directory.organisation(msp_id)
    contract = installed_contract(network.description.contract.package)
    consenters = [network.consenter(member) for member in network.orderers if member.msp_id == msp_id]
    return MemberCard.parse(
        MemberCard(
            msp_id=msp_id,
            network_sha256=(
                hashlib.sha256(network.directory.block_file.read_bytes()).hexdigest()
                if newcomer
                else shared_sha256(network.description)
            ),
            kind=network.description.organisation(msp_id).kind if newcomer else None,
            contract=ContractCard(version=contract.version, sha256=contract.sha256),
            t_s=int(network.now().timestamp()),
            host=network.description.host,
            root=organisation.root.read_text(),
            tls_root=organisation.tls_root.read_text(),
            peers=tuple(PeerCard(port=network.port(member)) for member in network.peers if member.msp_id == msp_id),
            orderers=tuple(
                OrdererCard(
                    port=each.port, tls_certificate=each.tls_certificate.decode(), identity=each.identity.decode()
                )
                for each in consenters
            ),
        ).to_json()
    )
