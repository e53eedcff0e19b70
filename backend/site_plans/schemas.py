"""Shapes of site plans."""

from __future__ import annotations

from pydantic import Field

from backend.schemas import ApiModel


class StoredSitePlan(ApiModel):
    """A site plan that was checked and is kept; it holds as soon as SetSitePlan has put its hash on the ledger."""

    pad_id: str
    sha256: str = Field(description="Of the file, as SetSitePlan takes it", examples=["9f86d08" + "0" * 57])
    size_bytes: int
    features: int
    image: bool = Field(description="Whether it has one")
