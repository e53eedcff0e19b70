"""A new version of the contract, or another endorsement policy, agreed on by every organisation while the old one runs.

The new version's servers start beside the old ones; when the channel has agreed, the peers turn to them, and the old
servers finish what they have and end. Every step may be interrupted and run again.
"""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wonderland_fabric_network import lifecycle
from wonderland_fabric_network.agreement import Agreement, load_agreement, require_installed, save_agreement
from wonderland_fabric_network.bringing_up import ensure_contract_tls
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.connections import first_identity
from wonderland_fabric_network.contract import (
    SLOTS,
    ContractPackage,
    InstalledContract,
    build_package,
    installed_contract,
)
from wonderland_fabric_network.description import extended_endorsement
from wonderland_fabric_network.endorsement import endorsement_text
from wonderland_fabric_network.errors import DirectoryStateError
from wonderland_fabric_network.network import Network, contract_component
from wonderland_fabric_network.with_others import WithOthers

if TYPE_CHECKING:
    from collections.abc import Collection

    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.peers import CommittedDefinition, PeerAdmin


@dataclass(frozen=True)
class Upgrade:
    """What the organisations now agree on; `changed` says whether they did not before."""

    agreement: Agreement
    endorsement: str
    changed: bool

    def as_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {
            "sequence": self.agreement.sequence,
            "version": self.agreement.version,
            "package_id": self.agreement.package_id,
            "endorsement": self.endorsement,
            "changed": self.changed,
        }


async def upgrade(
    network: Network, report: Report, *, endorsement: str | None = None, without: Collection[str] = ()
) -> tuple[Network, Upgrade]:
    """Agree on the installed contract, and on `endorsement` where given. Raises `NetworkError`.

    Where each member has its own part this is one member's approval, and it waits for the others', except for those of
    `without`; the policy is then the channel's own, whatever this directory last knew. A newcomer that operates pads
    becomes part of the standard policy by itself. Returns the network with its changed description, too.
    """
    network.require_here()
    if not network.peers:
        raise DirectoryStateError(f"{', '.join(network.msp_ids)} orders blocks only, and has no say in the contract")
    async with AsyncExitStack() as stack:
        peers = await network.peer_admins(stack)
        committed = await peers[0].definition(network.channel, network.description.contract.name)
        if committed is None:
            raise DirectoryStateError("there is no contract on the channel yet; `wonderland network up` agrees on one")
        description = network.description
        if endorsement is not None:
            description = description.with_endorsement(endorsement)
        elif network.membership is not None:
            description = description.with_endorsement(endorsement_text(committed.validation_parameter))
        if endorsement is None and (extended := extended_endorsement(description)) is not None:
            description = description.with_endorsement(extended)
        network = network.with_description(description)
        installed = installed_contract(description.contract.package)
        former = load_agreement(network.directory.contract_file)
        if network.membership is not None and former is not None and former.version == installed.version:
            require_installed(former, installed)  # the others could not tell it from the one that they approved
        done = _Upgrading(network, report, peers, installed, committed, former, without)
        result = await done.run()
    network.description.save(network.directory.description_file)
    return network, result


class _Upgrading:
    def __init__(
        self,
        network: Network,
        report: Report,
        peers: list[PeerAdmin],
        installed: InstalledContract,
        committed: CommittedDefinition,
        former: Agreement | None,
        without: Collection[str],
    ) -> None:
        self._network = network
        self._report = report
        self._peers = peers
        self._installed = installed
        self._committed = committed
        self._former = former
        self._without = without
        self._name = network.description.contract.name

    async def run(self) -> Upgrade:
        network, committed = self._network, self._committed
        parameter = network.description.contract.policy.validation_parameter()
        wanted_is_there = (committed.version, committed.validation_parameter) == (self._installed.version, parameter)
        slot = await self._approved_slot()
        changed = not wanted_is_there or (slot is None and network.membership is None)
        package = self._package(slot or self._free_slot())
        sequence = committed.sequence + 1 if changed else committed.sequence
        agreement = Agreement(
            sequence, self._installed.version, self._installed.sha256, package.slot, package.package_id
        )
        wanted = lifecycle.Definition(self._name, sequence, self._installed.version, parameter)
        await self._serve(package)
        if changed:
            self._report("contract", f"agreeing on {self._name} {self._installed.version}, sequence {sequence}")
        if network.membership is not None:  # also where the others went on, and this member's approval is missing
            await WithOthers(network, self._report).settle(self._peers, wanted, package, self._without)
        elif changed:
            await lifecycle.agree(network, self._peers, wanted, package)
        await together(lifecycle.wait_definition(peer, network.channel, self._name, sequence) for peer in self._peers)
        save_agreement(network.directory.contract_file, agreement)
        await self._probe()
        await self._retire(package.slot)
        return Upgrade(agreement, network.description.contract.endorsement, changed)

    async def _approved_slot(self) -> str | None:
        """The slot for which every organisation that endorses has approved the installed contract; None: not all."""
        sequence = self._committed.sequence
        approved = {
            await lifecycle.approved_package(peer, self._network.channel, self._name, sequence)
            for peer in self._peers
            if peer.msp_id in self._network.endorsers
        }
        return next((each for each in SLOTS if approved == {self._package(each).package_id}), None)

    def _free_slot(self) -> str:
        """The slot for what is to run: another one than what runs now, unless that is the same."""
        if self._former is not None and self._former.fits(self._installed):
            return self._former.slot
        return next(each for each in SLOTS if self._former is None or each != self._former.slot)

    def _package(self, slot: str) -> ContractPackage:
        return build_package(self._name, self._installed, slot)

    async def _serve(self, package: ContractPackage) -> None:
        network = self._network
        for msp_id in network.endorsers:
            async with network.authority(msp_id) as authority:
                await ensure_contract_tls(authority)
            network.configure_contract(msp_id, package)
            launch = network.launch_contract(msp_id, package.slot)
            # Something may be left there by an upgrade that was broken off, and serve another package.
            if self._former is None or package.slot != self._former.slot:
                await network.processes.stop(launch.name)
            if network.processes.pid(launch.name) is None:
                network.processes.start(launch)
            await network.processes.wait_ready(launch)
            self._report("contract", f"{launch.name} serves {package.label}")

    async def _probe(self) -> None:
        identity = first_identity(self._network)
        await lifecycle.wait_answering(self._peers[0], identity, self._network.channel, self._name, lifecycle.PROBE)

    async def _retire(self, slot: str) -> None:
        """End the servers of the version before; they finish what they have."""
        for msp_id in self._network.msp_ids:
            for each in SLOTS:
                name = contract_component(msp_id, each)
                unused = each != slot or msp_id not in self._network.endorsers
                if unused and await self._network.processes.stop(name):
                    self._report("contract", f"{name} ended")
