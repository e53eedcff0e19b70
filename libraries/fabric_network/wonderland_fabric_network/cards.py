"""The cards of a network's members, in its directory and in the files that they give each other."""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import TYPE_CHECKING

from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network.certificates import make_private
from wonderland_fabric_network.changes import MAX_CHANGE_BYTES, ChannelChange
from wonderland_fabric_network.errors import DirectoryStateError
from wonderland_fabric_network.membership import MAX_CARD_BYTES, MAX_ROSTER_BYTES, MemberCard, Membership, Roster

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from wonderland_fabric_network.layout import NetworkDirectory


def load_membership(directory: NetworkDirectory) -> Membership | None:
    """Whose keys are here, and the cards that are known; None where all of the network is. Raises `NetworkError`."""
    if not directory.mine_file.exists():
        return None
    damaged = f"{directory.mine_file}: should name the organisations whose keys are here"
    try:
        mine = json.loads(read_bounded(directory.mine_file, DirectoryStateError, "members"))["mine"]
    except (ValueError, TypeError, KeyError) as cause:
        raise DirectoryStateError(f"{damaged} ({cause})") from cause
    if not isinstance(mine, list) or not mine or not all(isinstance(each, str) for each in mine):
        raise DirectoryStateError(damaged)
    cards = [read_card(path) for path in sorted(directory.members.glob("*.json"))]
    return Membership(tuple(mine), MappingProxyType({card.msp_id: card for card in cards}))


def read_card(path: Path) -> MemberCard:
    """A card that somebody gave. Raises `NetworkError`."""
    return MemberCard.read(read_bounded(path, DirectoryStateError, "a member's card", MAX_CARD_BYTES), str(path))


def read_roster(path: Path) -> Roster:
    """A roster that a member gave. Raises `NetworkError`."""
    return Roster.read(read_bounded(path, DirectoryStateError, "a network's roster", MAX_ROSTER_BYTES), str(path))


def read_change(path: Path) -> ChannelChange:
    """A change that somebody proposed. Raises `NetworkError`."""
    return ChannelChange.read(
        read_bounded(path, DirectoryStateError, "a change of a channel", MAX_CHANGE_BYTES), str(path)
    )


def forget_card(directory: NetworkDirectory, msp_id: str) -> None:
    """The card of one that left."""
    (directory.members / f"{msp_id}.json").unlink(missing_ok=True)


def keep_cards(directory: NetworkDirectory, cards: Collection[MemberCard]) -> None:
    """Cards, and what the channel's configuration takes of them, where the rest of the program looks for it."""
    make_private(directory.members)
    for card in cards:
        organisation = directory.organisation(card.msp_id)
        files = {organisation.root: card.root, organisation.tls_root: card.tls_root}
        for index, orderer in enumerate(card.orderers):
            node = organisation.node(f"orderer{index}")
            files |= {node.identity.certificate: orderer.identity, node.tls.certificate: orderer.tls_certificate}
        for path, text in files.items():
            make_private(path.parent)
            if not path.exists():
                write_atomic(path, text.encode(), PUBLIC)
        write_atomic(directory.members / f"{card.msp_id}.json", card.to_bytes(), PUBLIC)
