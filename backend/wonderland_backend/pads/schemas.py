"""Shapes of pads."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland.proofs.records import pads, reservations
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


class QueueOccupant(ApiModel):
    """The drone that has the pad: it stands there, or is permitted to act."""

    session_id: str
    uav_id: str
    action: Literal["land", "takeoff", "dock"]
    landed: bool = Field(description="It landed, and nothing says that it left; else it has a permission that it uses")
    since_ms: int
    until_ms: int = Field(description="Until then at most, if nothing is heard of it")


Reservation = extended("Reservation", reservations.Reservation, "A span of time in which a pad is kept for a drone.")


class QueueSummary(ApiModel):
    """A pad's queue on the live map; `/pads/{pad_id}/queue` tells all of it."""

    waiting: int
    occupant: QueueOccupant | None = None
    reservation: Reservation | None = Field(  # type: ignore[valid-type]
        default=None, description="The one that holds, or the next one, as of the pad’s last change"
    )


Pad = extended(
    "Pad",
    pads.Pad,
    "A landing pad: the ledger's record, the anchors' positions and the agent's own word on its health.",
    anchors=(list[AnchorPosition], Field(description="Empty until the pad is commissioned")),
    health=(Health | None, Field(default=None)),
    queue=(QueueSummary | None, Field(default=None, description="In live frames, where the pad is in use")),
)
PadPage = page_of("PadPage", Pad)


class PutFirst(ApiModel):
    """Who put a waiting drone before all others, when and why."""

    by: Literal["pad", "operator", "authority"]
    name: str
    reason: str
    t_ms: int


class QueuePlace(ApiModel):
    """A drone that waits for the pad."""

    place: int = Field(ge=1)
    session_id: str
    uav_id: str
    msp_id: str
    action: Literal["land", "takeoff", "dock"]
    rank: Literal["leaves", "precedence", "emergency", "reserved", "low_battery", "normal"] = Field(
        description="Why it stands there: leaves the pad, was put first, reserved, signed a priority, as it came"
    )
    being_measured: bool = Field(description="It is its turn already, as the pad’s agent says")
    since_ms: int = Field(description="It waits since then; who asks again in time keeps its place")
    at_most_ms: int = Field(description="Until its turn, if nobody comes who goes first")
    claim_ignored: bool = Field(description="It signed a priority; its organisation had used up those that count")
    blocked_by: str | None = Field(
        default=None, description="The drone that has to leave the pad first, or that it is kept for"
    )
    kept: bool | None = Field(default=None, description="A reservation of `blocked_by` is what it waits for")
    priority: Literal["low_battery", "emergency"] | None = Field(default=None, description="As it signed it")
    battery_percent: int | None = Field(default=None, description="By its own word")
    precedence: PutFirst | None = None


class PadQueue(ApiModel):
    """Who has a pad, and who waits for it in which order: follows from the ledger alone (decision 0042)."""

    pad_id: str
    t_ms: int = Field(description="The moment that it is of")
    occupant: QueueOccupant | None = None
    waiting: list[QueuePlace]
    reservations: list[Reservation] = Field(  # type: ignore[valid-type]
        description="Those that hold or are to come and are not used up, by their beginning"
    )
