"""What the registry on the ledger says now, from the blocks of one peer, which is believed; no backend is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from wonderland.proof_contract import ProofContract, parsed_answer
from wonderland.proofs.records.changes import APPROVED, ProposedChange
from wonderland.proofs.records.closures import Closures
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.transactions import TRANSACTIONS
from wonderland.proofs.records.uavs import Authorisation, Maintenance, Uav

_RECORDS: Final[dict[str, type[Record]]] = {
    **dict.fromkeys(("RegisterPad", "UpdatePad", "RetirePad", "CommissionPad", "SetSitePlan"), Pad),
    **dict.fromkeys(("RegisterUav", "SetUavStatus", "RecordMaintenance", "CalibrateUav", "WithdrawCalibration"), Uav),
    **dict.fromkeys(("GrantAuthorisation", "RevokeAuthorisation"), Authorisation),
    **dict.fromkeys(("ProposePolicy", "ProposeReinstatement", "ApproveChange", "WithdrawChange"), ProposedChange),
    "SetClosures": Closures,
}
EVENTS: Final = {TRANSACTIONS[name].event: kind for name, kind in _RECORDS.items()}
"""Every event that changes the registry, and the record that it carries."""


@dataclass
class Book:
    """The newest record of everything that is registered, by its id."""

    pads: dict[str, Pad] = field(default_factory=dict)
    drones: dict[str, Uav] = field(default_factory=dict)
    authorisations: dict[tuple[str, str], Authorisation] = field(default_factory=dict)
    """By drone and authorisation."""
    proposals: dict[str, ProposedChange] = field(default_factory=dict)
    policies: dict[tuple[str, str], ProposedChange] = field(default_factory=dict)
    """What was approved last, by pad (or *) and action (or *)."""
    closures: dict[str, Closures] = field(default_factory=dict)
    reinstated: set[str] = field(default_factory=set)
    """Drones whose record an approval changed, which no event carries."""

    def take(self, event: str, record: dict[str, Any]) -> None:
        """Note an event of a valid transaction, in the order of the blocks. Raises `RefusedError` for no record."""
        match parsed_answer(EVENTS[event], record):
            case Pad() as pad:
                self.pads[pad.pad_id] = pad
            case Uav() as drone:
                self.drones[drone.uav_id] = drone
            case Authorisation() as granted:
                self.authorisations[granted.uav_id, granted.authorisation_id] = granted
            case Closures() as closures:
                self.closures[closures.pad_id] = closures
            case ProposedChange() as change:
                self.proposals[change.change_id] = change
                if change.state == APPROVED and change.policy is not None:
                    self.policies[change.policy.pad_id, change.policy.action] = change
                if change.state == APPROVED and change.reinstatement is not None:
                    self.reinstated.add(change.reinstatement.uav_id)

    def maintenance(self) -> Iterator[tuple[str, Maintenance]]:
        """The last of each drone that had any."""
        for uav_id, drone in sorted(self.drones.items()):
            if drone.maintenance is not None:
                yield uav_id, drone.maintenance


async def read_book(contract: ProofContract, on_block: Callable[[int, int], None] | None = None) -> Book:
    """Everything, from the first block to the newest of now. Raises `RefusedError` and `AwayError`."""
    book = Book()
    async for event in contract.history(frozenset(EVENTS), on_block):
        book.take(event.name, event.record)
    for uav_id in book.reinstated:
        book.drones[uav_id] = await contract.read_uav(uav_id)
    return book
