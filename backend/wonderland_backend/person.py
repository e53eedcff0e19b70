"""Who a request comes from, and what of the ledger is theirs to see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from sqlalchemy import false, or_, select

from wonderland_backend.db.tables.ledger import DroneRow, PadRow

Role = Literal["admin", "inspector", "pad_operator", "fleet_operator", "viewer"]
ROLES: Final[tuple[Role, ...]] = ("admin", "inspector", "pad_operator", "fleet_operator", "viewer")
AUTHORITY: Final[tuple[Role, ...]] = ("admin", "inspector")
EVERYBODY: Final = "*"
_SEE_ALL: Final = frozenset({"admin", "inspector", "viewer"})


@dataclass(frozen=True)
class Scope:
    """Which pads and drones somebody sees: all, or those of an organisation on the ledger."""

    everything: bool = False
    pads_of: str = ""
    """MSP id; empty: no pads."""
    drones_of: str = ""
    operators_of: str = ""
    """MSP id of the drones whose operator ids they see whole, and may ask for; `EVERYBODY`; empty: of none."""

    def narrow(self, query: Any, *, pad: Any = None, drone: Any = None) -> Any:
        """The query, narrowed to rows whose pad or drone is within the scope.

        `pad` and `drone` are the columns with the pad's and the drone's id; a row is seen when either is theirs.
        """
        if self.everything:
            return query
        theirs = []
        if pad is not None and self.pads_of:
            theirs.append(pad.in_(select(PadRow.pad_id).where(PadRow.msp_id == self.pads_of)))
        if drone is not None and self.drones_of:
            theirs.append(drone.in_(select(DroneRow.uav_id).where(DroneRow.msp_id == self.drones_of)))
        return query.where(or_(*theirs) if theirs else false())


ALL: Final = Scope(everything=True, operators_of=EVERYBODY)


@dataclass(frozen=True)
class Account:
    """Somebody who acts before being signed in: who accepts an invitation, whose passkey is refused."""

    person_id: str
    name: str


@dataclass(frozen=True)
class Person:
    """Who a request comes from."""

    person_id: str
    name: str
    roles: tuple[Role, ...]
    msp_id: str
    """The organisation on the ledger whose pads or drones are theirs; empty: none."""
    method: str
    """How they signed in: ``passkey``, ``oidc``, ``link`` or ``display``."""
    signed_in_ms: int
    expires_ms: int
    cookie_sha256: str
    verified_ms: int = 0
    """When this sign-in's person last proved to be there, by a passkey; 0: not since it began."""

    def has(self, *roles: Role) -> bool:
        """Whether they have one of these roles."""
        return not set(roles).isdisjoint(self.roles)

    @property
    def scope(self) -> Scope:
        """Whose pads and drones they see, by their roles."""
        if self.has(*AUTHORITY):
            return ALL
        operators_of = self.msp_id if "fleet_operator" in self.roles else ""
        if not _SEE_ALL.isdisjoint(self.roles):
            return Scope(everything=True, operators_of=operators_of)
        return Scope(
            operators_of=operators_of,
            pads_of=self.msp_id if "pad_operator" in self.roles else "",
            drones_of=self.msp_id if "fleet_operator" in self.roles else "",
        )


def roles_of(text: str) -> tuple[Role, ...]:
    """The roles in a column's text, in their usual order."""
    named = set(text.split())
    return tuple(role for role in ROLES if role in named)
