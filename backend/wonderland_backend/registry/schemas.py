"""Shapes of the registry."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import Field

from wonderland.proofs.records import calibrations, changes, pads, policies, uavs
from wonderland_backend.drones.schemas import Authorisation
from wonderland_backend.filters import PageQuery
from wonderland_backend.numbers.schemas import RegistrationNumber
from wonderland_backend.schemas import ApiModel, model_of, page_of

Uav = model_of(uavs.Uav)
PadRecord = model_of(pads.Pad, "PadRecord")
Policy = model_of(policies.Policy)
Calibration = model_of(calibrations.Calibration)
ProposedChange = model_of(changes.ProposedChange)
Sort = Literal["id", "changed"]
_Text = Annotated[str | None, Field(default=None, min_length=1, max_length=128, description="Part of a name or id")]
_Msp = Annotated[str | None, Field(default=None, max_length=64, description="Only of this organisation")]


class DroneQuery(PageQuery):
    """What the registry's list of drones is narrowed by."""

    q: _Text
    msp: _Msp
    status: Literal["active", "suspended", "retired"] | None = None
    sort: Sort = "id"


class PadQuery(PageQuery):
    """What the registry's list of pads is narrowed by."""

    q: _Text
    msp: _Msp
    status: Literal["registered", "commissioned", "retired"] | None = None
    sort: Sort = "id"


class CertificateQuery(PageQuery):
    """Which certificates."""

    q: _Text
    msp: _Msp
    role: str | None = Field(default=None, max_length=32)
    expiring: bool = Field(default=False, description="Only those that are over, or will be within 30 days")


class ChangeQuery(PageQuery):
    """Which of the changes that take two people."""

    state: Literal["open", "approved", "withdrawn", "expired"] | None = None


class HistoryQuery(PageQuery):
    """The drone or pad whose changes are listed."""

    kind: Literal["drone", "pad"]
    id: str = Field(min_length=1, max_length=64)


DroneFilters = Annotated[DroneQuery, Query()]
PadFilters = Annotated[PadQuery, Query()]
CertificateFilters = Annotated[CertificateQuery, Query()]
ChangeFilters = Annotated[ChangeQuery, Query()]
HistoryFilters = Annotated[HistoryQuery, Query()]


class Version(ApiModel):
    """Which transaction wrote a record as it is: what a change of it names as `seen`."""

    block: int
    tx_index: int


class RegistryDrone(ApiModel):
    """A drone's record."""

    record: Uav  # type: ignore[valid-type]
    registration: RegistrationNumber
    version: Version
    in_force: int = Field(description="Authorisations that hold now")


class RegistryAuthorisation(ApiModel):
    """An authorisation's record."""

    record: Authorisation  # type: ignore[valid-type]
    version: Version


class RegistryCalibration(ApiModel):
    """What the drone's own node adds to every range at a pad, and whether it is judged with that there now."""

    record: Calibration  # type: ignore[valid-type]
    state: Literal["holds", "over", "withdrawn", "pad_changed"] = Field(
        description="`pad_changed`: the pad was commissioned anew since. Where none holds, the drone is judged with "
        "the prior, the pad's own uncertainty"
    )


class RegistryDroneDetail(ApiModel):
    """A drone with all that it was ever allowed and is still on record."""

    drone: RegistryDrone
    authorisations: list[RegistryAuthorisation]
    calibrations: list[RegistryCalibration] = Field(description="One for each pad at which somebody calibrated it")


class RegistryPad(ApiModel):
    """A pad's record."""

    record: PadRecord  # type: ignore[valid-type]
    version: Version


class RegistryPolicy(ApiModel):
    """What holds for an action at a pad, and where that was set."""

    action: Literal["*", "land", "takeoff", "dock"]
    policy: Policy  # type: ignore[valid-type]
    set_for: str = Field(description="pad/action, with * for any; empty: the defaults of the contract")
    own: bool = Field(description="Whether it was set for this very pad and action")
    version: Version | None = Field(default=None, description="Of the one for this very pad and action")


class RegistryProposal(ApiModel):
    """A change that somebody proposed, and what became of it."""

    record: ProposedChange  # type: ignore[valid-type]
    version: Version
    state: Literal["open", "approved", "withdrawn", "expired"] = Field(
        description="As the ledger has it; `expired`: nobody approved it in time"
    )


class RegistryPolicies(ApiModel):
    """The policies that hold where no pad has one of its own."""

    policies: list[RegistryPolicy]


class Reach(ApiModel):
    """What can be verified at a distance, in every direction, by the policy for landing."""

    distance_mm: int
    buffer_mm: int


class RegistryPadDetail(ApiModel):
    """A pad with the policies that hold there."""

    pad: RegistryPad
    policies: list[RegistryPolicy]
    reach: list[Reach] = Field(description="By rising distance; where nothing can be verified there is no point")


class Actor(ApiModel):
    """Who signed a transaction."""

    msp_id: str
    name: str
    certificate_sha256: str


class RegistryChange(ApiModel):
    """One version of a record, and who made it."""

    kind: Literal["drone", "pad", "authorisation", "policy", "closures"]
    id: str
    record: dict[str, Any]
    before: dict[str, Any] | None = Field(default=None, description="The version before; missing for the first")
    tx_id: str
    block: int
    t_ms: int
    function: str
    by: Actor


class OrganisationCa(ApiModel):
    """A root or intermediate certificate that the channel trusts."""

    name: str
    not_after_ms: int
    serial: str


class RegistryOrganisation(ApiModel):
    """An organisation of the channel."""

    msp_id: str
    application: bool = Field(description="Whether it uses the channel; else it orders blocks only")
    authorities: list[OrganisationCa]
    revoked: int = Field(description="Certificates on its revocation lists")
    pads: int
    drones: int
    certificates: int = Field(description="Seen on the chain")
    version: Version = Field(description="The configuration that says so")


class RegistryOrganisations(ApiModel):
    """Every organisation of the channel."""

    items: list[RegistryOrganisation]


class RegistryCertificate(ApiModel):
    """A certificate that has acted on the chain."""

    certificate_sha256: str
    msp_id: str
    name: str
    node_ou: str
    role: str
    pol_id: str
    serial: str
    not_before_ms: int
    not_after_ms: int
    state: Literal["valid", "expiring", "expired", "revoked"]
    last_block: int


class ImportRow(ApiModel):
    """A line that can be signed."""

    line: int
    id: str
    exists: bool = Field(description="Already on the ledger: left out")
    argument: dict[str, Any]
    registration: str | None = Field(
        default=None, description="The operator's number, normalised: to be committed to in the argument"
    )


class ImportFault(ApiModel):
    """What is wrong with a line."""

    line: int
    column: str = Field(description="Empty: with the whole line")
    message: str


class ImportCheck(ApiModel):
    """A file, read and checked; nothing was changed."""

    function: str
    encoding: str
    delimiter: str
    rows: list[ImportRow]
    errors: list[ImportFault] = Field(description="At most 1,000")
    error_count: int


class RegistryForm(ApiModel):
    """A transaction's argument and whom the contract lets send it."""

    function: str
    roles: list[str]
    argument: dict[str, Any] = Field(description="JSON Schema of the argument")


class RegistryForms(ApiModel):
    """All that people may send."""

    items: list[RegistryForm]


RegistryDronePage = page_of("RegistryDronePage", RegistryDrone)
RegistryPadPage = page_of("RegistryPadPage", RegistryPad)
RegistryProposalPage = page_of("RegistryProposalPage", RegistryProposal)
RegistryChangePage = page_of("RegistryChangePage", RegistryChange)
RegistryCertificatePage = page_of("RegistryCertificatePage", RegistryCertificate)
