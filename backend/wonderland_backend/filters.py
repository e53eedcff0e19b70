"""Query parameters of lists. Unknown ones are refused: a filter with a typing error must not look like no filter."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from wonderland.proofs.records.fields import ID_PATTERN, MAX_TIME_MS
from wonderland_backend import areas
from wonderland_backend.pagination import MAX_CURSOR, decode_cursor

_ID = f"^{ID_PATTERN}$"


class PageQuery(BaseModel):
    """Which page of a list."""

    model_config = ConfigDict(extra="forbid")

    limit: int = Field(default=50, ge=1, le=500, description="At most so many items")
    cursor: str | None = Field(
        default=None, max_length=MAX_CURSOR, description="`next` of the page before; leave out for the first page"
    )

    def after_place(self, *kinds: type) -> tuple[Any, ...] | None:
        """The position after which the page begins, its parts of these types; None: the first. Raises `BadRequest`."""
        return decode_cursor(self.cursor, *kinds) if self.cursor is not None else None

    def after_key(self, kind: type) -> Any:
        """The same where the position has one part."""
        place = self.after_place(kind)
        return None if place is None else place[0]


class TimeQuery(PageQuery):
    """Only what is of a span of time, both ends included."""

    since_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="From this time on (Unix, ms)")
    until_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Until this time, included (Unix, ms)")


class AboutQuery(TimeQuery):
    """About which pads and drones."""

    pad: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only at this pad")
    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only of this drone")
    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator's drones")
    bbox: str | None = Field(
        default=None, pattern=areas.PATTERN, description=f"Only at pads within: {areas.DESCRIPTION}"
    )


class PadQuery(PageQuery):
    """What a list of pads is narrowed by."""

    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator")
    bbox: str | None = Field(default=None, pattern=areas.PATTERN, description=f"Only within: {areas.DESCRIPTION}")


class DroneQuery(PageQuery):
    """What a list of drones is narrowed by."""

    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator")
    bbox: str | None = Field(
        default=None, pattern=areas.PATTERN, description=f"Only those heard last within: {areas.DESCRIPTION}"
    )


class SessionQuery(AboutQuery):
    """What a list of sessions is narrowed by."""

    state: Literal["requested", "decided", "completed", "cancelled"] | None = None
    outcome: Literal["verified", "refuted", "inconclusive"] | None = None
    action: Literal["land", "takeoff", "dock"] | None = None


class VerdictQuery(SessionQuery):
    """What a list of verdicts is narrowed by."""

    after_block: int | None = Field(
        default=None,
        ge=-1,
        le=2**53,
        description="Only of later blocks, and oldest first: for filling a gap without loss",
    )


class FindingQuery(TimeQuery):
    """What a list of receivers' findings is narrowed by."""

    pad: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this pad's receiver")
    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only of this drone")


class LatestQuery(PageQuery):
    """Which drones' last positions."""

    since_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Heard since (Unix, ms)")


Paging = Annotated[PageQuery, Query()]
Spanning = Annotated[TimeQuery, Query()]
PadFilters = Annotated[PadQuery, Query()]
DroneFilters = Annotated[DroneQuery, Query()]
SessionFilters = Annotated[SessionQuery, Query()]
VerdictFilters = Annotated[VerdictQuery, Query()]
FindingFilters = Annotated[FindingQuery, Query()]
LatestFilters = Annotated[LatestQuery, Query()]
