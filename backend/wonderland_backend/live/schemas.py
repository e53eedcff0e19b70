"""Shapes of the live interface's frames."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from wonderland_backend.alerts.schemas import Alert
from wonderland_backend.ledger.schemas import Status
from wonderland_backend.pads.schemas import Pad
from wonderland_backend.schemas import ApiModel
from wonderland_backend.sessions.schemas import SessionSummary
from wonderland_backend.tracks.schemas import Estimate, Track
from wonderland_backend.verdicts.schemas import VerdictSummary


class LiveHello(ApiModel):
    """First frame. `resumed`: deltas after the client's position follow; else a snapshot does.

    It may come again on the same connection, where another backend goes on duty: everything begins anew with it.
    """

    type: Literal["hello"]
    epoch: str
    seq: int
    t_ms: int
    resumed: bool


class LiveSnapshot(ApiModel):
    """Part of the whole state as of the hello's `seq`; merge the parts `part` 1 to `of`."""

    type: Literal["snapshot"]
    part: int
    of: int
    pads: list[Pad] | None = None  # type: ignore[valid-type]
    tracks: list[Track] | None = None
    estimates: list[Estimate] | None = None
    sessions: list[SessionSummary] | None = None
    verdicts: list[VerdictSummary] | None = Field(default=None, description="Oldest first")  # type: ignore[valid-type]
    alerts: list[Alert] | None = Field(default=None, description="Those that are open or returned, oldest first")
    alerts_more: bool | None = Field(default=None, description="More are open than these: GET /alerts/count counts")
    status: Status | None = None


class LiveDelta(ApiModel):
    """What changed since the frame with `seq` one less.

    One with the same `seq` as the last is of a backend that is not on duty: its `status` says that the picture is old.
    """

    type: Literal["delta"]
    seq: int
    t_ms: int
    tracks: list[Track] | None = Field(default=None, description="Latest of each drone that moved")
    estimates: list[Estimate] | None = Field(default=None, description="Latest of each drone being ranged")
    sessions: list[SessionSummary] | None = Field(default=None, description="Every change, in order")
    verdicts: list[VerdictSummary] | None = Field(  # type: ignore[valid-type]
        default=None, description="Every verdict, in order"
    )
    pads: list[Pad] | None = None  # type: ignore[valid-type]
    alerts: list[Alert] | None = Field(default=None, description="Every change of every alert, in order")
    status: Status | None = None


FRAMES: Final[tuple[type[ApiModel], ...]] = (LiveHello, LiveSnapshot, LiveDelta)
