"""Shapes of pads."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland.proofs.records import pads
from wonderland_backend.schemas import ApiModel, extended, page_of


class AnchorPosition(ApiModel):
    """Where an anchor stands: in the pad's frame, and on the globe (computed from the commissioning)."""

    anchor_id: str
    lat_e7: int
    lon_e7: int
    east_mm: int
    north_mm: int
    up_mm: int


class AnchorHealth(ApiModel):
    """How an anchor does."""

    anchor_id: str
    state: Literal["up", "down", "silent"]
    firmware: str | None = None
    detail: str | None = Field(default=None, description="Why it is not up, in the agent's words")


class SpoolHealth(ApiModel):
    """What waits on the agent's disk to be taken in here."""

    records: int
    bytes: int
    dropped: int


class ReceiverHealth(ApiModel):
    """Remote ID frames heard since the agent's start."""

    frames: int
    bad: int


class DriftHealth(ApiModel):
    """Whether the anchors stand as they were commissioned, by the ranges that they measure to each other."""

    state: Literal["ok", "drifting", "moved"]
    checked_ms: int
    looks: int
    since_ms: int | None = None
    anchor_id: str | None = Field(default=None, description="The anchor that explains it best")
    off_mm: int | None = None
    sigma_mm: int | None = None
    common_mm: int | None = Field(default=None, description="Change of range that all anchors share")
    extra_sigma_mm: int | None = Field(default=None, description="What the pad adds to its anchors' uncertainty")


class Health(ApiModel):
    """The agent's last report of itself. Not from the ledger."""

    t_ms: int
    connected: bool = Field(description="Whether the agent's connection to this backend stands")
    anchors: list[AnchorHealth]
    spool: SpoolHealth | None = None
    receiver: ReceiverHealth | None = None
    prekeys: int | None = Field(default=None, description="Unused one-time keys on the ledger, as the agent counts")
    version: str | None = None
    drift: DriftHealth | None = None
    verified: Literal[False]


Pad = extended(
    "Pad",
    pads.Pad,
    "A landing pad: the ledger's record, the anchors' positions and the agent's own word on its health.",
    anchors=(list[AnchorPosition], Field(description="Empty until the pad is commissioned")),
    health=(Health | None, Field(default=None)),
)
PadPage = page_of("PadPage", Pad)
