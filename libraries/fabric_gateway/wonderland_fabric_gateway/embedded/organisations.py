"""The organisations of an embedded ledger, and the roles that a first start enrols."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

AUTHORITY: Final = "AuthorityMSP"
PAD: Final = "PadMSP"
FLEET: Final = "FleetMSP"
ORDERER: Final = "OrdererMSP"
APPLICATIONS: Final = (AUTHORITY, PAD, FLEET)
ALL: Final = (*APPLICATIONS, ORDERER)
"""Those of every embedded ledger; a ledger may have further operators of pads."""
PAD_ROLES: Final = ("pad_operator", "pad")

DEFAULT_CHANNEL: Final = "wonderland"
DEFAULT_CHAINCODE: Final = "pol"


@dataclass(frozen=True, slots=True)
class Role:
    """A role: its organisation, and the ``pol.id`` that the identity of a first start gets."""

    name: str
    msp_id: str
    pol_id: str


ROLES: Final = {
    role.name: role
    for role in (
        Role("admin", AUTHORITY, "admin"),
        Role("inspector", AUTHORITY, "inspector"),
        Role("mirror", AUTHORITY, "mirror"),
        Role("pad_operator", PAD, "pad_operator"),
        Role("pad", PAD, "pad-1"),
        Role("fleet_operator", FLEET, "fleet_operator"),
        Role("uav", FLEET, "uav-1"),
    )
}
"""Each role by the name that the certificate attribute ``pol.role`` has."""


def endorsing(pad_operators: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Who must endorse every transaction: the authority, and one of the operators of pads."""
    return (AUTHORITY,), (PAD, *pad_operators)
