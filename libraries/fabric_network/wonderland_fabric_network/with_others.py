"""Agreeing on the contract where each member acts for itself alone: approve, wait for the others, commit.

Members come at different times. Whoever finds that all have approved commits; two that do so at once agree.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network import connections, lifecycle
from wonderland_fabric_network.agreement import Agreement, require_installed, save_agreement
from wonderland_fabric_network.certificates import signing_identity
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.contract import SLOTS, build_package
from wonderland_fabric_network.errors import ComponentError, NetworkError, UnreachableError

if TYPE_CHECKING:
    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.contract import ContractPackage, InstalledContract
    from wonderland_fabric_network.network import Network
    from wonderland_fabric_network.peers import PeerAdmin

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
        wanted = lifecycle.Definition(
            described.name,
            agreement.sequence if agreement else 1,
            contract.version,
            described.policy.validation_parameter(),
        )
        await together(lifecycle.install(peer, package) for peer in peers if peer.msp_id in network.endorsers)
        while not await self._committed(peers[0], wanted):
            await self._approve(peers, wanted, package)
            await self._commit(peers[0], wanted)
        save_agreement(
            network.directory.contract_file,
            Agreement(wanted.sequence, contract.version, contract.sha256, package.slot, package.package_id),
        )
        await self._answering(peers)

    async def _committed(self, peer: PeerAdmin, wanted: lifecycle.Definition) -> bool:
        definition = await peer.definition(self._network.channel, wanted.name)
        return definition is not None and definition.sequence >= wanted.sequence

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

    async def _commit(self, peer: PeerAdmin, wanted: lifecycle.Definition) -> None:
        """Commit once all have approved; else wait a little."""
        try:
            approvals = await lifecycle.approvals(peer, self._network.channel, wanted)
        except NetworkError as error:
            if await self._committed(peer, wanted):
                return
            await self._wait("its own peer", error)
            return
        missing = sorted(msp_id for msp_id, approved in approvals.items() if not approved)
        if missing:
            await self._wait(f"{', '.join(missing)} to approve", None)
            return
        self._report("contract", f"all approved: committing {wanted.name} {wanted.version}")
        try:
            await lifecycle.commit(peer, self._network.channel, wanted, list(approvals))
        except ComponentError as error:
            await self._wait("the others' peers", error)

    async def _answering(self, peers: list[PeerAdmin]) -> None:
        network = self._network
        self._report("contract", "waiting until the organisations that must endorse are reached")
        who = connections.first_identities(network.organisations[0].kind)[0].name
        home = network.organisations[0].msp_id
        identity = signing_identity(home, network.directory.organisation(home).identity(who))
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
