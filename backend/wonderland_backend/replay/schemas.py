"""Shapes of the past."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.fields import MAX_TIME_MS
from wonderland_backend.alerts.schemas import Alert
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.ledger.schemas import Status
from wonderland_backend.pads.schemas import Pad
from wonderland_backend.replay.film import MAX_STEPS
from wonderland_backend.schemas import ApiModel
from wonderland_backend.sessions.schemas import SessionSummary
from wonderland_backend.tracks.schemas import Estimate, Track
from wonderland_backend.verdicts.schemas import VerdictSummary

TimeMs = Annotated[int, Field(ge=0, le=MAX_TIME_MS, description="Unix, ms")]


class PastState(ApiModel):
    """What the live map showed at a moment: what was known then, not what has become known since."""

    t_ms: int
    block: int = Field(description="The last block that was known then; −1: none")
    pads: list[Pad]  # type: ignore[valid-type]
    tracks: list[Track]
    estimates: list[Estimate]
    sessions: list[SessionSummary]
    verdicts: list[VerdictSummary] = Field(description="The last 200, oldest first")  # type: ignore[valid-type]
    alerts: list[Alert] = Field(description="Those that were open, oldest first, as they stood")
    status: Status


class PastMark(ApiModel):
    """A moment that is worth a look."""

    kind: Literal["refusal", "verdict", "alert"]
    t_ms: int = Field(description="When it became known here")
    session_id: str | None = None
    pad_id: str | None = None
    uav_id: str | None = None
    outcome: Literal["verified", "refuted", "inconclusive"] | None = None
    permission: Literal["granted", "refused"] | None = None
    alert_id: str | None = None
    alert: str | None = Field(default=None, description="The alert's kind")
    severity: Literal["critical", "warning", "notice"] | None = None


class PastDensity(ApiModel):
    """How many there were in each of the equal parts of the span."""

    positions: list[int]
    sessions: list[int]
    refusals: list[int]
    alerts: list[int]


class PastMarks(ApiModel):
    """What a time scrubber shows."""

    stored_from_ms: int | None = Field(default=None, description="Nothing is stored of before")
    stored_until_ms: int | None = None
    from_ms: int
    until_ms: int
    density: PastDensity
    marks: list[PastMark] = Field(description="Oldest first; of more than 1,000 the newest")


class PastRefusal(ApiModel):
    """The refusal that was looked for."""

    found: PastMark | None = Field(default=None, description="Left out where there is none")


class MomentQuery(BaseModel):
    """The moment whose picture is rebuilt."""

    model_config = ConfigDict(extra="forbid")

    at_ms: TimeMs


class SpanQuery(BaseModel):
    """The span of which marks are listed."""

    model_config = ConfigDict(extra="forbid")

    from_ms: TimeMs
    until_ms: TimeMs

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.until_ms <= self.from_ms:
            raise FieldRefused(said("fields_order", later="until_ms", earlier="from_ms"))
        return self


class FramesQuery(SpanQuery):
    """The span to play, and how finely."""

    step_ms: int = Field(default=200, ge=50, le=60_000, description="A frame for each such step of the past")
    snapshot: bool = Field(default=True, description="Begin with a hello and a snapshot; false: continue a film")

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.until_ms - self.from_ms > MAX_STEPS * self.step_ms:
            raise FieldRefused(said("fields_steps", most=MAX_STEPS))
        return self


class MarksQuery(SpanQuery):
    """Which part of a scrubber."""

    buckets: int = Field(default=240, ge=1, le=1_000, description="Parts of the density")


class RefusalQuery(MomentQuery):
    """The refusal to go to: the next one after, or the last one before, a moment."""

    direction: Literal["next", "previous"]


AtMoment = Annotated[MomentQuery, Query()]
FramesWanted = Annotated[FramesQuery, Query()]
MarksWanted = Annotated[MarksQuery, Query()]
RefusalWanted = Annotated[RefusalQuery, Query()]
