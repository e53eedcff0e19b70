"""Which of the contract's transactions people may send through the console, and what each of them changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.schema import Record


@dataclass(frozen=True)
class Change:
    """A transaction of the registry."""

    function: str
    subject_of: Callable[[Any], str]
    """What it is about, as the audit log names it: ``kind/id``."""
    key_of: Callable[[Any], str]
    """The state's key that it changes."""

    @property
    def step_up(self) -> str:
        """What its sender has to prove besides: `FRESH`, `RECENT` or nothing."""
        return _STEP_UP.get(self.function, "")

    @property
    def argument(self) -> type[Record]:
        """The record that is its argument."""
        return tx.TRANSACTIONS[self.function].argument

    @property
    def roles(self) -> tuple[str, ...]:
        """Whom the contract lets send it; it checks in addition whose pad or drone it is."""
        return tx.TRANSACTIONS[self.function].roles


FRESH, RECENT = "fresh", "recent"
_STEP_UP: Final = {
    "ProposePolicy": FRESH,
    "ProposeReinstatement": FRESH,
    "ApproveChange": FRESH,
    # These take away, and may be urgent.
    "SetClosures": RECENT,
    "SetUavStatus": RECENT,
}


def _of_pad(function: str) -> Change:
    return Change(function, lambda its: f"pad/{its.pad_id}", lambda its: keys.composite(keys.PAD, its.pad_id))


def _of_drone(function: str) -> Change:
    return Change(function, lambda its: f"drone/{its.uav_id}", lambda its: keys.composite(keys.UAV, its.uav_id))


def _of_authorisation(function: str) -> Change:
    return Change(
        function,
        lambda its: f"drone/{its.uav_id}",
        lambda its: keys.composite(keys.AUTHORISATION, its.uav_id, its.authorisation_id),
    )


def _of_session(function: str) -> Change:
    return Change(
        function, lambda its: f"session/{its.session_id}", lambda its: keys.composite(keys.SESSION, its.session_id)
    )


def _of_reservations(function: str) -> Change:
    return Change(function, lambda its: f"pad/{its.pad_id}", lambda its: keys.composite(keys.RESERVATIONS, its.pad_id))


def _of_proposal(function: str) -> Change:
    return Change(
        function, lambda its: f"change/{its.change_id}", lambda its: keys.composite(keys.CHANGE, its.change_id)
    )


CHANGES: Final = {
    change.function: change
    for change in (
        *map(_of_pad, ("RegisterPad", "UpdatePad", "RetirePad", "CommissionPad", "SetSitePlan")),
        *map(
            _of_drone,
            ("RegisterUav", "SetUavStatus", "ProposeReinstatement", "RecordMaintenance", "WithdrawCalibration"),
        ),
        *map(_of_authorisation, ("GrantAuthorisation", "RevokeAuthorisation")),
        *map(_of_session, ("GivePrecedence", "RecordDeparture", "CancelProof")),
        *map(_of_reservations, ("ReservePad", "CancelReservation")),
        *map(_of_proposal, ("ApproveChange", "WithdrawChange")),
        Change(
            "ProposePolicy",
            lambda its: f"policy/{its.pad_id}/{its.action}",
            lambda its: keys.composite(keys.POLICY, its.pad_id, its.action),
        ),
        Change(
            "SetClosures",
            lambda its: f"closures/{its.pad_id}",
            lambda its: keys.composite(keys.CLOSURES, its.pad_id),
        ),
    )
}
"""By name; nothing else is passed on."""
SIGNING_ROLES: Final = frozenset({tx.ADMIN, tx.INSPECTOR, tx.PAD_OPERATOR, tx.FLEET_OPERATOR})
"""Roles of people; machines have their own ways to the ledger."""
