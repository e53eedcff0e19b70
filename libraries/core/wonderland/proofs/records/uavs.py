"""Drones: who operates them, whether they are airworthy, what they may do where."""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, ClassVar, Final

from wonderland.proofs.records.calibrations import MAX_CALIBRATIONS, Calibration
from wonderland.proofs.records.fields import MspId, Name, Note, OperatorId, TimeMs, UavId
from wonderland.proofs.records.schema import Choice, Items, Record, Text

STATUSES = ("active", "suspended", "retired")
AuthorisationId = Annotated[
    str, Text(64, r"[A-Za-z0-9][A-Za-z0-9._:-]*", "Identifier of the authorisation", min_length=1)
]
PadPattern = Annotated[str, Text(64, r"\*|[A-Za-z0-9][A-Za-z0-9._:-]*", "A pad, or * for every pad", min_length=1)]
RegistrationCommitment = Annotated[
    str,
    Text(
        64,
        r"[0-9a-f]{64}",
        "SHA-256 of the opening of the operator's registration number; missing where there is no number. The number "
        "and its salt stand in the registry of the organisation's backend, never here",
    ),
]

_PUBLIC: Final = re.compile(r"[A-Za-z]{3}[A-Za-z0-9]{13}")
_WITH_SECRET: Final = re.compile(r"([A-Za-z]{3}[A-Za-z0-9]{13})(?:-[A-Za-z0-9-]*|[A-Za-z0-9]{3})\Z")


def without_secret(registration: str) -> str:
    """An operator's number without the three characters that only the operator may know (EN 4709-002)."""
    found = _WITH_SECRET.match(registration)
    return found.group(1) if found is not None else registration


def normalised_registration(registration: str) -> str:
    """The one spelling in which a number is kept and committed to: FIN87astrdge12k8; other forms as they are."""
    public = without_secret(registration.strip())
    return public[:3].upper() + public[3:].lower() if _PUBLIC.fullmatch(public) else public


NO_NUMBER: Final = MappingProxyType(
    {
        "registration": "a number in clear has no place on the ledger, where nothing is ever erased: give "
        "registration_commitment, and keep the number with its salt in the backend's registry. A ledger that has such "
        "records is of a version before the first release: begin a new one"
    }
)


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

    REFUSED: ClassVar = NO_NUMBER

    uav_id: UavId
    operator_id: OperatorId
    msp_id: MspId
    model: Name
    status: Annotated[str, Choice(STATUSES)]
    registered_ms: TimeMs
    updated_ms: TimeMs
    registration_commitment: RegistrationCommitment | None = None
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
