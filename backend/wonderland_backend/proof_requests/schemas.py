"""Shapes of requests for a proof."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.filters import PageQuery
from wonderland_backend.schemas import ApiModel, page_of

_ID = f"^{ID_PATTERN}$"
Action = Literal["land", "takeoff", "dock"]
State = Literal["pending", "asked", "decided", "ended", "declined", "expired", "cancelled"]


class NewProofRequest(BaseModel):
    """Which drone is to prove itself where."""

    model_config = ConfigDict(extra="forbid")

    uav_id: str = Field(pattern=_ID, max_length=40)
    pad_id: str = Field(pattern=_ID, max_length=64)
    action: Action = "land"
    valid_s: int = Field(default=600, ge=10, le=86_400, description="For so long it stands")
    note: str = Field(default="", max_length=500, description="For the drone's operator")


class ProofRequest(ApiModel):
    """A request, and what has become of it."""

    request_id: str
    uav_id: str
    pad_id: str
    action: Action
    state: State = Field(
        description="pending: the drone has not asked yet; asked: its session is under way; decided: there is a proof; "
        "ended: its session ended without a verdict; declined: its agent will not"
    )
    requested_by: str
    note: str
    created_ms: int
    expires_ms: int
    told_ms: int | None = Field(default=None, description="When the drone's agent was told")
    accepted: bool | None = Field(default=None, description="What the agent answered; nothing: it has not")
    answer: str | None = None
    cancelled_ms: int | None = None
    session_id: str | None = Field(default=None, description="Of the session that the drone opened; and its proof's id")
    outcome: Literal["verified", "refuted", "inconclusive"] | None = None


class RequestedProof(ApiModel):
    """Which drone is to prove itself where, as subscribers are told."""

    request_id: str
    uav_id: str
    pad_id: str
    action: Action
    note: str
    created_ms: int
    expires_ms: int


class ProofRequestCreated(ApiModel):
    """Somebody asks that a drone proves its location. Not of the ledger: there is no transaction."""

    id: str = Field(description="The request’s")
    type: Literal["proof_request.created"]
    t_ms: int
    record: RequestedProof


class ProofRequestQuery(PageQuery):
    """What a list of requests is narrowed by."""

    drone: str | None = Field(default=None, pattern=_ID, max_length=40)
    pad: str | None = Field(default=None, pattern=_ID, max_length=64)


ProofRequestFilters = Annotated[ProofRequestQuery, Query()]
ProofRequestPage = page_of("ProofRequestPage", ProofRequest)
