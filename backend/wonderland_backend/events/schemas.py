"""Shapes of events."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.events.queries import PATTERN, Filter
from wonderland_backend.schemas import ApiModel

_ID = f"^{ID_PATTERN}$"
EventType = Annotated[str, Field(min_length=1, max_length=64, pattern="^[A-Za-z0-9_.]+$")]


class LedgerEvent(ApiModel):
    """Something that was committed to the ledger."""

    id: str = Field(description="block.index: events are in this order, and a stream goes on after it")
    type: str = Field(description="ProofRequested, ProofDecided, InteractionCompleted, ProofCancelled, PadUpdated, …")
    t_ms: int = Field(description="The transaction's time: its sender's word")
    tx_id: str
    block: int
    tx_index: int
    record: dict[str, Any] = Field(description="The record after the change; of ProofDecided the verdict")


class EventPage(ApiModel):
    """Events in the ledger's order."""

    items: list[LedgerEvent]
    after: str = Field(description="Pass it as `after` to go on; it moves on even where nothing passed the filter")
    more: bool = Field(description="Whether there is more at once; if not, ask again later, or take the stream")


class EventQuery(BaseModel):
    """What a list of events is narrowed by."""

    model_config = ConfigDict(extra="forbid")

    after: str | None = Field(
        default=None,
        pattern=PATTERN,
        description="The id of the last event seen; 0.0: from the beginning; none: new ones",
    )
    type: list[EventType] = Field(default_factory=list, max_length=32, description="Only of these types")
    pad: list[Annotated[str, Field(pattern=_ID, max_length=64)]] = Field(default_factory=list, max_length=100)
    drone: list[Annotated[str, Field(pattern=_ID, max_length=40)]] = Field(default_factory=list, max_length=100)
    outcome: list[Literal["verified", "refuted", "inconclusive"]] = Field(
        default_factory=list, max_length=3, description="Only verdicts with these outcomes"
    )
    limit: int = Field(default=100, ge=1, le=200, description="Of a page; a stream has no end")

    def filter(self) -> Filter:
        """What the feed filters by."""
        return Filter(frozenset(self.type), frozenset(self.pad), frozenset(self.drone), frozenset(self.outcome))


EventFilters = Annotated[EventQuery, Query()]
