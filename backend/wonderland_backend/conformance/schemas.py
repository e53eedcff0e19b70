"""Shapes of the question and the answer."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN, MAX_TIME_MS
from wonderland_backend.conformance.rules import Limit, Status
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.proofs.schemas import Proof
from wonderland_backend.schemas import ApiModel
from wonderland_backend.tracks.schemas import SessionSignature

NEAR_MM = 300_000
"""ASTM F3411's obfuscation distance: what is closer counts as the same place there."""
FASTEST_MM_S = 50_000
"""The highest speed of an EU class (C6)."""


class ConformanceQuery(BaseModel):
    """Whose broadcast, which one, and what is enough."""

    model_config = ConfigDict(extra="forbid")

    serial: str = Field(pattern=f"^{ID_PATTERN}$", max_length=40, description="The drone's serial number")
    lat_e7: int | None = Field(
        default=None, ge=-900_000_000, le=900_000_000, description="A broadcast of your own; else the last one heard"
    )
    lon_e7: int | None = Field(default=None, ge=-1_800_000_000, le=1_800_000_000)
    t_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Of that broadcast; else now")
    accuracy_mm: int = Field(default=0, ge=0, le=10_000_000, description="Of that broadcast, horizontal, 95 %")
    within_mm: int = Field(
        default=NEAR_MM, ge=1_000, le=10_000_000, description="Supported means: proven to be within this distance"
    )
    max_speed_mm_s: int = Field(
        default=FASTEST_MM_S,
        ge=1_000,
        le=300_000,
        description="The drone is taken to fly no faster; if you know the type, say so and proofs reach further",
    )
    min_assurance: int = Field(default=1, ge=0, le=4, description="Proofs below this level support nothing")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.lat_e7 is None) != (self.lon_e7 is None):
            raise FieldRefused(said("fields_together", first="lat_e7", second="lon_e7"))
        if self.lat_e7 is None and self.t_ms is not None:
            raise FieldRefused(said("fields_time_of_place"))
        return self


class BroadcastUsed(ApiModel):
    """The broadcast that was judged."""

    lat_e7: int
    lon_e7: int
    t_ms: int
    accuracy_mm: int = Field(description="0: it does not say")
    source: Literal["heard", "asked"]
    verified: Literal[False]


class ConformanceLimit(ApiModel):
    """What keeps the answer from being better."""

    code: Limit
    text: str


class Conformance(ApiModel):
    """Whether a proof supports where a drone says it is."""

    serial: str
    status: Status = Field(
        description="supported: proven to be within `within_mm` of its broadcast; contradicted: it cannot be there; "
        "unproven: no proof tells; unknown: nobody has registered or heard this drone"
    )
    text: str
    t_ms: int = Field(description="When this was answered")
    limits: list[ConformanceLimit]
    broadcast: BroadcastUsed | None = None
    proof: Proof | None = Field(default=None, description="The newest one that settled something, else the newest")
    signature: SessionSignature | None = Field(
        default=None,
        description="Who signed its broadcasts during the proof's session (DRIP), as the pad heard it. Another answer "
        "than `status`: who said it, not whether it is true",
    )
    measured_ms: int | None = Field(default=None, description="When the place was measured")
    age_ms: int | None = Field(default=None, description="From the measurement to the broadcast")
    assurance: int | None = Field(default=None, description="How strong the proof is; see Proof")
    distance_mm: int | None = Field(default=None, description="From the broadcast to the measured place")
    proven_within_mm: int | None = Field(
        default=None, description="The drone is at most so far from its broadcast, by the proof and its speed"
    )
    proven_beyond_mm: int | None = Field(
        default=None, description="The drone is at least so far from its broadcast; above 0 it cannot be there"
    )
    supported_until_ms: int | None = Field(
        default=None, description="While it goes on broadcasting this place, until when the proof supports that"
    )


ConformanceFor = Annotated[ConformanceQuery, Query()]
