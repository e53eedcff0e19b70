"""Drones: who operates them, whether they are airworthy, what they may do where."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs.records.calibrations import MAX_CALIBRATIONS, Calibration
from wonderland.proofs.records.fields import MspId, Name, Note, OperatorId, TimeMs, UavId
from wonderland.proofs.records.schema import Choice, Items, Record, Text

STATUSES = ("active", "suspended", "retired")
AuthorisationId = Annotated[
    str, Text(64, r"[A-Za-z0-9][A-Za-z0-9._:-]*", "Identifier of the authorisation", min_length=1)
]
PadPattern = Annotated[str, Text(64, r"\*|[A-Za-z0-9][A-Za-z0-9._:-]*", "A pad, or * for every pad", min_length=1)]
Registration = Annotated[
    str, Text(32, r"[A-Za-z0-9-]*", "Operator registration number without its secret digits (EN 4709-002)")
]

_WITH_SECRET: Final = re.compile(r"([A-Za-z]{3}[A-Za-z0-9]{13})(?:-[A-Za-z0-9-]*|[A-Za-z0-9]{3})\Z")


def without_secret(registration: str) -> str:
    """An operator's number without the three characters that only the operator may know (EN 4709-002).

    The pattern of the field takes them, since old blocks must read as they always did; the contract refuses them.
    """
    found = _WITH_SECRET.match(registration)
    return found.group(1) if found is not None else registration


@dataclass(frozen=True, kw_only=True, slots=True)
class Maintenance(Record):
    """The last recorded maintenance."""

    performed_ms: TimeMs
    valid_until_ms: TimeMs
    work: Note
    recorded_by: Name


@dataclass(frozen=True, kw_only=True, slots=True)
class Uav(Record):
    """A drone as the ledger knows it."""

    uav_id: UavId
    operator_id: OperatorId
    msp_id: MspId
    registration: Registration
    model: Name
    status: Annotated[str, Choice(STATUSES)]
    registered_ms: TimeMs
    updated_ms: TimeMs
    status_reason: Note | None = None
    maintenance: Maintenance | None = None
    calibrations: (
        Annotated[tuple[Calibration, ...], Items(1, MAX_CALIBRATIONS, "One for each pad, by its id")] | None
    ) = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Authorisation(Record):
    """What a drone may do at a pad, and when."""

    authorisation_id: AuthorisationId
    uav_id: UavId
    pad_id: PadPattern
    actions: Annotated[tuple[str, ...], Items(1, 3, of=Choice(("land", "takeoff", "dock")))]
    valid_from_ms: TimeMs
    valid_until_ms: TimeMs
    granted_by: Name
    granted_ms: TimeMs
    revoked: bool
    revoked_reason: Note | None = None
    revoked_ms: TimeMs | None = None
