"""Shapes of the statistics, and their filters."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN, MAX_TIME_MS
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.schemas import ApiModel

_ID = f"^{ID_PATTERN}$"
MAX_BINS: Final = 400
LIKELIHOOD_BINS: Final = 20
ERROR_EDGES_MM: Final = (50, 100, 200, 300, 500, 750, 1_000, 1_500, 2_000, 3_000, 5_000, 10_000, 30_000)


class StatisticsQuery(BaseModel):
    """Which verdicts, and how finely."""

    model_config = ConfigDict(extra="forbid")

    since_ms: int = Field(ge=0, le=MAX_TIME_MS, description="From this time on (Unix, ms)")
    until_ms: int = Field(ge=0, le=MAX_TIME_MS, description="Before this time")
    bin_ms: int = Field(ge=60_000, le=31 * 86_400_000, description="Width of a bin")
    pad: str | None = Field(default=None, pattern=_ID, max_length=64)
    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Of the drone")
    action: Literal["land", "takeoff", "dock"] | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.until_ms <= self.since_ms:
            raise FieldRefused(said("fields_order", later="until_ms", earlier="since_ms"))
        if (self.until_ms - self.since_ms) / self.bin_ms > MAX_BINS:
            raise FieldRefused(said("fields_bins", most=MAX_BINS))
        return self


class Counted(ApiModel):
    """How many of each outcome."""

    verified: int
    refuted: int
    inconclusive: int
    granted: int = Field(description="Permissions among them")


class TimeBin(Counted):
    """The verdicts of a bin."""

    start_ms: int


class Group(Counted):
    """The verdicts of a pad, an operator or an action."""

    id: str


class StepTotal(ApiModel):
    """How long a step took after the one before it."""

    step: str
    p50_ms: int
    p95_ms: int
    count: int


class StepBin(StepTotal):
    """The same, in a bin."""

    start_ms: int


class ErrorBin(ApiModel):
    """Verdicts whose claim was so far off: from the edge before, up to this one."""

    up_to_mm: int | None = Field(default=None, description="None: farther than all edges")
    count: int


class Statistics(ApiModel):
    """What the verdicts of a span come to."""

    total: Counted
    bins: list[TimeBin]
    pads: list[Group]
    operators: list[Group]
    actions: list[Group]
    likelihood: list[int] = Field(description="Counts in 20 bins from 0 to 1; only verdicts with a signed claim")
    error: list[ErrorBin]
    steps: list[StepBin]
    step_totals: list[StepTotal] = Field(description="Of all the span, which no average of its bins would give")
    proofs_per_hour: float
    busiest_hour: int = Field(description="Most proofs within one hour of the clock")


StatisticsFor = Annotated[StatisticsQuery, Query()]
