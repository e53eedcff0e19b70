"""Shapes of the search."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend.schemas import ApiModel


class SearchQuery(BaseModel):
    """What is looked for."""

    model_config = ConfigDict(extra="forbid")

    q: str = Field(min_length=1, max_length=128, description="Part of a name, or the beginning of an id")
    limit: int = Field(default=12, ge=1, le=50)


class Hit(ApiModel):
    """Something that fits."""

    kind: Literal["pad", "drone", "broadcast", "session", "transaction", "block"]
    id: str = Field(description="By which it is found: pad_id, uav_id, session_id, tx_id, number")
    name: str = Field(description="What people call it")
    detail: str | None = Field(default=None, description="What tells it apart: registration, operator, function, pad")
    heard_ms: int | None = Field(default=None, description="When what is not registered was heard last")


class Hits(ApiModel):
    """What fits, the likeliest first."""

    items: list[Hit]
