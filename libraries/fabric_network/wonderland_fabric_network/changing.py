"""A member's part in changing a running channel: propose, sign, submit; and the roster for those who would join."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from wonderland.proofs import encoding
from wonderland_fabric_gateway.files import read_bounded
from wonderland_fabric_network import changes
from wonderland_fabric_network.agreement import load_agreement
from wonderland_fabric_network.cards import forget_card, keep_cards
from wonderland_fabric_network.certificates import signing_identity
from wonderland_fabric_network.changes import ChannelChange, Count
from wonderland_fabric_network.config_update import submit_update
from wonderland_fabric_network.endorsement import organisations_of
from wonderland_fabric_network.errors import ChannelUpdateError, DirectoryStateError, RefusedError
from wonderland_fabric_network.layout import MSP_ADMIN
from wonderland_fabric_network.membership import ContractCard, Roster, public_part

if TYPE_CHECKING:
    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
    from wonderland_fabric_network.network import Network
    from wonderland_fabric_network.peers import PeerAdmin


class Changing:
    """One member, with its peers open, and the channel as its first peer has it now. Use as an asynchronous context."""

    def __init__(self, network: Network) -> None:
        if network.membership is None:
            raise DirectoryStateError(
                "this directory has all of its network; what concerns the channel is done with `add-org`, `upgrade`, "
                "`renew`. Members propose and sign where each has its own part (`network card`)"
            )
        if not network.peers:
            raise DirectoryStateError(
                f"{', '.join(network.msp_ids)} runs no peer, and so cannot see what the channel is now. Next: do it "
                "where the organisation's peers are"
            )
        self._network = network
        self._stack = AsyncExitStack()
        self._peers: list[PeerAdmin] = []
        self.trust: ChannelTrust

    async def __aenter__(self) -> Self:
        self._peers = await self._network.peer_admins(self._stack)
        try:
            self.trust = await self._peers[0].trust(self._network.channel)
        except BaseException:
            await self._stack.aclose()
            raise
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._stack.aclose()

    async def propose(self, change: ChannelChange) -> ChannelChange:
        """The change, for this channel as it is now, unsigned. Raises `NetworkError` where it cannot be made."""
        update = changes.update_of(change, self.trust, self._network.description.ordering)
        if update is None:
            raise ChannelUpdateError("the channel is so already. Next: `submit` the file that made it so, to take note")
        await self._require_harmless(change)
        change.applied(self._network.description)
        return replace(change, update_sha256=changes.sha256(update))

    async def sign(self, change: ChannelChange) -> tuple[ChannelChange, Count]:
        """With the signatures of this member's administrators, and how far it is. Raises `NetworkError`."""
        update = await self._update(change)
        if update is None:
            raise ChannelUpdateError("the channel is so already; `wonderland network submit` takes note of it")
        there = self.trust.root.groups[change.section].groups
        signers = [self._administrator(each) for each in self._network.msp_ids if each in there]
        if not signers:
            raise DirectoryStateError(
                f"{', '.join(self._network.msp_ids)} has no say in this; {', '.join(sorted(there))} have"
            )
        self._count(change, update)  # whether what is there holds, before it is signed
        change = changes.signed(change, update, signers, self._network.random_bytes)
        return change, self._count(change, update)

    async def count(self, change: ChannelChange) -> Count | None:
        """How far it is; None where the channel is so already. Raises `NetworkError`."""
        update = await self._update(change)
        return None if update is None else self._count(change, update)

    async def submit(self, change: ChannelChange) -> tuple[Network, int | None]:
        """Have it made, and take note of it here; the network as it is then, and the block (None: it was made before).

        Raises `NetworkError`.
        """
        update = await self._update(change)
        block: int | None = None
        if update is not None:
            counted = self._count(change, update)
            if not counted.enough:
                raise ChannelUpdateError(
                    f"signed by {', '.join(counted.signed) or 'nobody'}, and a majority has to; missing are "
                    f"{', '.join(counted.missing)}. Next: they `wonderland network sign` the file"
                )
            first = self._network.msp_ids[0]
            try:
                block = await submit_update(
                    self._network,
                    self._peers,
                    update,
                    [each.to_protobuf() for each in change.signatures],
                    self._administrator(first),
                    after=self.trust.number,
                )
            except RefusedError as error:
                raise ChannelUpdateError(f"the ordering service refused the change: {error}") from error
        return self._noted(change), block

    def roster(self) -> Roster:
        """What a newcomer needs to know of this network. Raises `NetworkError`."""
        network = self._network
        agreement = load_agreement(network.directory.contract_file)
        if agreement is None or network.membership is None:
            raise DirectoryStateError("there is no contract on the channel yet; `wonderland network up` agrees on one")
        return Roster(
            description=public_part(network.description),
            contract=ContractCard(version=agreement.version, sha256=agreement.sha256),
            first_block=encoding.to_base64url(self._first_block()),
            cards=tuple(network.membership.cards.values()),
        )

    def _first_block(self) -> bytes:
        path = self._network.directory.block_file
        return read_bounded(path, DirectoryStateError, "the channel's first block", 100 << 20)

    async def _update(self, change: ChannelChange) -> bytes | None:
        if change.channel != self._network.channel:
            raise ChannelUpdateError(f"the change is of channel {change.channel}; this is {self._network.channel}")
        update = changes.update_of(change, self.trust, self._network.description.ordering)
        if update is not None:
            changes.require_same(change, update)
            await self._require_harmless(change)
            change.applied(self._network.description)
        return update

    def _count(self, change: ChannelChange, update: bytes) -> Count:
        return changes.count(change, update, self.trust, int(self._network.now().timestamp() * 1_000))

    def _administrator(self, msp_id: str) -> SigningIdentity:
        return signing_identity(msp_id, self._network.directory.organisation(msp_id).identity(MSP_ADMIN))

    async def _require_harmless(self, change: ChannelChange) -> None:
        """Who joins means this channel; who leaves is none whose signature the contract's policy counts."""
        if change.admit is not None:
            change.admit.require_for(self._first_block())
        if change.remove is None:
            return
        definition = await self._peers[0].definition(self._network.channel, self._network.description.contract.name)
        if definition is None:
            return
        if change.remove in organisations_of(definition.validation_parameter):
            raise ChannelUpdateError(
                f"the endorsement policy names {change.remove}. Next: all agree on one without it first, with "
                "`wonderland network upgrade --endorsement …`"
            )

    def _noted(self, change: ChannelChange) -> Network:
        """The change in this directory, as far as it is not there yet."""
        network, membership = self._network, self._network.membership
        assert membership is not None
        known = {each.msp_id for each in network.description.organisations}
        made = change.admit is not None and change.admit.msp_id in known
        made |= change.remove is not None and change.remove not in known
        description = network.description if made else change.applied(network.description)
        if change.admit is not None:
            membership = membership.with_newcomer(change.admit)
            keep_cards(network.directory, [change.admit])
        description.save(network.directory.description_file)
        if change.remove is not None:
            membership = membership.without(change.remove)
            forget_card(network.directory, change.remove)
        return network.with_description(description, membership)
