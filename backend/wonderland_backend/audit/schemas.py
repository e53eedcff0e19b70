"""Shapes of the audit log, and its filters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend.audit.acts import Act
from wonderland_backend.filters import TimeQuery
from wonderland_backend.schemas import ApiModel, page_of


class AuditEntry(ApiModel):
    """What somebody did or read."""

    seq: int
    t_ms: int
    person_id: str | None = Field(default=None, description="Left out where nobody was signed in")
    person: str = Field(description="Empty where nobody knows")
    act: str
    subject: str = Field(description="kind/id")
    detail: dict[str, Any]
    tx_id: str | None = Field(default=None, description="The transaction that belongs to it")
    sha256: str


AuditPage = page_of("AuditPage", AuditEntry)


class AuditCheck(ApiModel):
    """Whether the log is what it was."""

    ok: bool
    rows: int
    broken_seq: int | None = Field(default=None, description="The first row that is missing or not what it was")
    ledger: Literal["checked", "off", "away"] = Field(description="Whether heads on the ledger were compared")
    anchors: int = Field(description="Heads on the ledger that were compared")
    anchored_seq: int | None = Field(default=None, description="Up to this row the ledger vouches for the log")
    anchored_ms: int | None = None
    contradicted_tx: str | None = Field(default=None, description="The transaction whose head the log does not have")
    misdated_seq: int | None = Field(
        default=None, description="The first row dated before the one above it, or after the head that covers it"
    )
    lost_tx: str | None = Field(default=None, description="The log names it as its anchor; no head is of it")
    late_seq: int | None = Field(default=None, description="A row older than an hour that no head on the ledger covers")


class AuditQuery(TimeQuery):
    """What the audit log is narrowed by."""

    person: str | None = Field(default=None, pattern="^[0-9a-f]{32}$", description="person_id")
    act: Act | None = None
    subject: str | None = Field(default=None, max_length=256, description="kind/id, or its beginning")


AuditFilters = Annotated[AuditQuery, Query()]


class Unmask(BaseModel):
    """Which hidden number to show, and why it has to be seen."""

    model_config = ConfigDict(extra="forbid")

    uav_id: str = Field(min_length=1, max_length=40)
    field: Literal["registration", "operator_id", "broadcast_operator_id"]
    reason: str = Field(min_length=5, max_length=500, pattern=r"\S.*\S.*\S", description="For the audit log")


class Unmasked(ApiModel):
    """The number; show it no longer than this."""

    value: str
    show_ms: int
