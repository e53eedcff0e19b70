"""Shapes of proofs."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from pydantic import Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.filters import AboutQuery
from wonderland_backend.schemas import ApiModel, page_of

_ID = f"^{ID_PATTERN}$"
Outcome = Literal["verified", "refuted", "inconclusive"]


class ProofReason(ApiModel):
    """Why: a code and its facts for machines, and a sentence for people, in the language that was asked for."""

    code: str
    facts: dict[str, int | str] = Field(
        description="Figures and names; units end their names: _mm, _ms, _percent, _milli (thousandths)",
        examples=[{"error_mm": 120, "buffer_mm": 1000}],
    )
    text: str


class Place(ApiModel):
    """A place on the globe."""

    lat_e7: int
    lon_e7: int
    height_mm: int = Field(description="Above the WGS-84 ellipsoid")


class Uncertainty(ApiModel):
    """Of the measured place, horizontal: east-east, east-north, north-north."""

    ee_mm2: int
    en_mm2: int
    nn_mm2: int


class JudgedClaim(ApiModel):
    """A claim of the drone, and what the measurement says about it."""

    outcome: Outcome
    place: Place = Field(description="Where the drone said it was")
    error_mm: int = Field(description="From there to the measured place")
    likelihood_ppm: int = Field(description="That the drone was within the buffer of its claim")
    reasons: list[ProofReason]


class BroadcastHeard(ApiModel):
    """What was heard under the drone's serial number on Remote ID.

    Anybody can send that: it convicts no drone unless the drone signed for it (`own_contradicted`).
    """

    outcome: Literal["supported", "contradicted", "own_contradicted", "undecided", "not_heard"]
    messages: int = Field(description="Heard near the session's claims, and judged")
    attributed: int = Field(description="Of these, signed for by the drone")
    supported: bool = Field(
        description="Whether a message was heard that the measurement supports; all the drone's own"
    )
    place: Place | None = Field(default=None, description="Where the message that decides puts the drone")
    error_mm: int | None = Field(default=None, description="From there to the measured place")
    likelihood_ppm: int | None = Field(default=None, description="That the drone was where that message can mean")
    tolerance_mm: int | None = Field(default=None, description="How far the drone can be from an honest one")


class HeightFound(ApiModel):
    """Whether the height is measured, or the drone's word."""

    outcome: Literal["proved", "contradicted", "claimed"]
    claimed_mm: int = Field(description="Above the pad's origin, as the drone says")
    measured_mm: int = Field(description="The height that fits the ranges best")
    lowest_mm: int = Field(description="The ranges leave what is between these open")
    highest_mm: int
    tolerance_mm: int = Field(description="Contradicted beyond this, for the accuracy that the drone states")
    likelihood_ppm: int = Field(description="That it is within the policy's height buffer of the claimed one")
    uu_mm2: int = Field(description="Vertical variance of the measured place, and its cross terms")
    eu_mm2: int
    nu_mm2: int


class Proof(ApiModel):
    """What the contract decided about a drone's place. It is on the ledger, and can be checked there by anybody."""

    proof_id: str = Field(description="The session's id, which is the transaction id of its request")
    uav_id: str
    pad_id: str
    action: Literal["land", "takeoff", "dock"]
    decided_ms: int
    outcome: Outcome
    permission: Literal["granted", "refused"]
    authorised: bool
    assurance: int = Field(
        ge=0,
        le=4,
        description="0 the drone's own ranges, 1 measured by the pad, 2 with keyed time stamps, "
        "3 with time differences, 4 with a second pad",
    )
    rounds: int
    buffer_mm: int
    measured: Place | None = Field(default=None, description="The measured place; none where it could not be told")
    covariance: Uncertainty | None = None
    signed: JudgedClaim | None = Field(default=None, description="The place that the drone signed for this proof")
    height: HeightFound | None = Field(
        default=None, description="What the ranges say of its height; none where their geometry says nothing"
    )
    broadcast: BroadcastHeard | None = Field(default=None, description="What the public was told meanwhile")
    reasons: list[ProofReason]
    evidence_sha256: str
    tx_id: str
    block: int
    tx_index: int


class ProofQuery(AboutQuery):
    """What a list of proofs is narrowed by."""

    outcome: Outcome | None = None


ProofFilters = Annotated[ProofQuery, Query()]
ProofPage = page_of("ProofPage", Proof)
