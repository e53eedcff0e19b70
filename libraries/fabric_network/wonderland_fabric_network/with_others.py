"""Agreeing on the contract where each member acts for itself alone: approve, wait for the others, commit.

Members come at different times. Whoever finds that all have approved commits; two that do so at once agree.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network import lifecycle
from wonderland_fabric_network.agreement import Agreement, ContractDiffersError, require_installed, save_agreement
from wonderland_fabric_network.changes import require_true_cards
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.connections import first_identity
from wonderland_fabric_network.contract import SLOTS, build_package
from wonderland_fabric_network.errors import ComponentError, NetworkError, RefusedError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import Collection

    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.contract import ContractPackage, InstalledContract
    from wonderland_fabric_network.network import Network
    from wonderland_fabric_network.peers import CommittedDefinition, PeerAdmin

PATIENCE_S: Final = 3_600.0
"""For the other members; what was done until then stays."""
PAUSE_S: Final = 1.0


class WithOthers:
    """One member's part in an agreement. `patience_s` is how long it waits for the others."""

    def __init__(self, network: Network, report: Report, *, patience_s: float = PATIENCE_S) -> None:
        self._network = network
        self._report = report
        self._deadline = time.monotonic() + patience_s
        self._told = ""

    async def agree(self, peers: list[PeerAdmin], contract: InstalledContract, agreement: Agreement | None) -> None:
        """Until the contract answers through each of its peers. Raises `NetworkError`; may be repeated."""
        if not peers:  # who only orders has nothing to approve
            return
        network, described = self._network, self._network.description.contract
        if agreement is not None:
            require_installed(agreement, contract)
        package = build_package(described.name, contract, agreement.slot if agreement else SLOTS[0])
        committed = await self._definition(peers[0], described.name)
        assert network.membership is not None
        require_true_cards(network.membership.cards.values(), await peers[0].trust(network.channel))
        wanted = lifecycle.Definition(
            described.name,
            committed.sequence if committed else 1,
            committed.version if committed else contract.version,
            committed.validation_parameter if committed else described.policy.validation_parameter(),
        )
        if wanted.version != contract.version:
            raise ContractDiffersError(
                f"the others went on to contract version {wanted.version}; installed here is {contract.version}. Next: "
                f"install {wanted.version}, and `wonderland network upgrade`"
            )
        await self.settle(peers, wanted, package)
        save_agreement(
            network.directory.contract_file,
            Agreement(wanted.sequence, contract.version, contract.sha256, package.slot, package.package_id),
        )
        await self._answering(peers)

    async def settle(
        self,
        peers: list[PeerAdmin],
        wanted: lifecycle.Definition,
        package: ContractPackage,
        without: Collection[str] = (),
    ) -> None:
        """Install, approve for each organisation here, and until the channel has agreed. Raises `NetworkError`.

        `without`: whom not to wait for; Fabric asks for a majority.
        """
        await together(lifecycle.install(peer, package) for peer in peers if peer.msp_id in self._network.endorsers)
        await self._approve(peers, wanted, package)
        while not await self._committed(peers[0], wanted):
            await self._commit(peers[0], wanted, without)

    async def _definition(self, peer: PeerAdmin, name: str) -> CommittedDefinition | None:
        """What the channel agreed on; a newcomer's peer learns it once the others admitted its organisation."""
        while True:
            try:
                return await peer.definition(self._network.channel, name)
            except RefusedError as error:
                if not lifecycle.is_stranger(error):
                    raise
                await self._wait(f"the members to admit {peer.msp_id} (`propose --admit`, `sign`, `submit`)", None)

    async def _committed(self, peer: PeerAdmin, wanted: lifecycle.Definition) -> bool:
        """Whether the channel has it. Raises `ContractDiffersError` where the others agreed on something else."""
        there = await peer.definition(self._network.channel, wanted.name)
        if there is None or there.sequence < wanted.sequence:
            return False
        if (there.version, there.validation_parameter) != (wanted.version, wanted.validation_parameter):
            raise ContractDiffersError(
                f"the others agreed on another version or endorsement policy ({there.version}, sequence "
                f"{there.sequence}) while this member waited. Next: `wonderland network upgrade` takes that"
            )
        return True

    async def _approve(self, peers: list[PeerAdmin], wanted: lifecycle.Definition, package: ContractPackage) -> None:
        network = self._network
        for msp_id, peer in {peer.msp_id: peer for peer in reversed(peers)}.items():
            endorses = msp_id in network.endorsers
            while True:
                try:
                    approved = await lifecycle.approved_package(peer, network.channel, wanted.name, wanted.sequence)
                    if approved is None:
                        await lifecycle.approve(peer, network.channel, wanted, package.package_id if endorses else None)
                except (ComponentError, UnreachableError) as error:
                    await self._wait("enough orderers", error)
                else:
                    break

    async def _commit(self, peer: PeerAdmin, wanted: lifecycle.Definition, without: Collection[str]) -> None:
        """Commit once all that are waited for have approved; else wait a little."""
        try:
            approvals = await lifecycle.approvals(peer, self._network.channel, wanted)
        except NetworkError as error:
            if await self._committed(peer, wanted):
                return
            await self._wait("its own peer", error)
            return
        missing = sorted(each for each, approved in approvals.items() if not approved and each not in without)
        if missing:
            await self._wait(f"{', '.join(missing)} to approve the same: `wonderland network upgrade` there", None)
            return
        self._report("contract", f"approved: committing {wanted.name} {wanted.version}, sequence {wanted.sequence}")
        endorsing = [each for each, approved in approvals.items() if approved]
        try:
            await lifecycle.commit(peer, self._network.channel, wanted, endorsing)
        except ComponentError as error:
            await self._wait("the others' peers", error)

    async def _answering(self, peers: list[PeerAdmin]) -> None:
        network = self._network
        self._report("contract", "waiting until the organisations that must endorse are reached")
        identity = first_identity(network)
        name = network.description.contract.name
        while True:
            try:
                await together(
                    lifecycle.wait_answering(peer, identity, network.channel, name, lifecycle.PROBE) for peer in peers
                )
            except ComponentError as error:
                await self._wait("the organisations that must endorse", error)
            else:
                return

    async def _wait(self, whom: str, error: NetworkError | None) -> None:
        if time.monotonic() > self._deadline:
            raise ComponentError(
                self._network.msp_ids[0],
                f"waited for {whom}" + (f": {error}" if error is not None else ""),
                remedy="once they are there, `wonderland network up` goes on",
            )
        if whom != self._told:
            self._told = whom
            self._report("contract", f"waiting for {whom} (Ctrl-C is safe: `up` goes on)")
        await asyncio.sleep(PAUSE_S)
