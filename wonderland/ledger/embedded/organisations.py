"""The organisations of an embedded ledger, and the roles that a first start enrols."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

AUTHORITY: Final = "AuthorityMSP"
PAD: Final = "PadMSP"
FLEET: Final = "FleetMSP"
ORDERER: Final = "OrdererMSP"
APPLICATIONS: Final = (AUTHORITY, PAD, FLEET)
ENDORSING: Final = (AUTHORITY, PAD)
"""Both must endorse every transaction."""
ALL: Final = (*APPLICATIONS, ORDERER)

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
