"""Shapes of tracks and of running estimates."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from backend.schemas import ApiModel, page_of


class Track(ApiModel):
    """A Remote ID position of a drone, as a pad heard it. Unverified."""

    uav_id: str
    lat_e7: int
    lon_e7: int
    height_mm: int | None = Field(default=None, description="Height above the WGS-84 ellipsoid")
    accuracy_mm: int | None = Field(default=None, description="Broadcast horizontal accuracy, 95 %")
    speed_mm_s: int | None = None
    track_cdeg: int | None = Field(default=None, description="Direction of movement, degrees × 100 from true north")
    vertical_mm_s: int | None = None
    status: str | None = None
    operator_id: str | None = None
    claim_t_ms: int | None = Field(default=None, description="The broadcast's own time")
    rssi: int | None = Field(default=None, description="dBm")
    t_ms: int = Field(description="When the pad heard it, by the pad's clock")
    pad_id: str
    transport: str
    verified: Literal[False]


class Estimate(ApiModel):
    """A pad's running estimate of a drone during a session. Unverified."""

    session_id: str
    uav_id: str
    pad_id: str
    t_ms: int
    lat_e7: int
    lon_e7: int
    east_mm: int
    north_mm: int
    ee_mm2: int
    en_mm2: int
    nn_mm2: int
    rounds: int
    likelihood_ppm: int
    ranges: dict[str, int] = Field(description="Last range of each anchor, mm")
    verified: Literal[False]


class TrackHistory(ApiModel):
    """Positions of one drone, oldest first."""

    uav_id: str
    items: list[Track]
    next: str | None = Field(default=None, description="Pass it as `cursor` to get the next page")


TrackPage = page_of("TrackPage", Track)
