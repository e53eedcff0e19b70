"""Shapes of tracks and of running estimates."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland_backend.schemas import ApiModel, page_of


class Drip(ApiModel):
    """Who signed a drone's broadcasts (RFC 9575). It says nothing about whether its position is true."""

    state: Literal["verified", "endorsed", "unknown_signer", "refused"] = Field(
        description="`endorsed`: a registry vouches for the key, which has signed nothing yet; anybody can repeat that"
    )
    det: str = Field(description="The DRIP entity tag that signed or is endorsed, as an IPv6 address")
    format: Literal["link", "wrapper", "manifest", "frame"]
    t_ms: int = Field(description="When the pad verified it")
    signer: str | None = Field(default=None, description="What the registry calls it")
    reason: str | None = Field(default=None, description="Why it was refused")
    covers_location: bool = Field(
        default=False, description="Whether a position that was heard is among what is signed"
    )
    bound: bool = Field(
        default=False,
        description="Whether the drone's identity is this entity tag; otherwise the two were only heard together",
    )


class SessionSignature(Drip):
    """Who signed a drone's broadcasts during a session, as its pad heard them. Apart from the verdict, no part of it.

    The strongest that was heard; the verdict says whether the place is true.
    """

    refused: int = Field(default=0, description="How many authentication messages were refused besides")


class Finding(ApiModel):
    """Something odd about a drone's broadcasts, as a pad's receiver saw it. Unverified, and never part of a verdict."""

    uav_id: str
    pad_id: str
    t_ms: int
    kind: Literal[
        "two_places",
        "impossible_speed",
        "time_stuck",
        "time_backwards",
        "time_off",
        "several_identities",
        "rate_high",
        "signature_bad",
    ]
    count: int = Field(description="How often it was seen since it was last told; at most once a minute")
    lat_e7: int | None = None
    lon_e7: int | None = None
    other_lat_e7: int | None = Field(default=None, description="The place that does not fit to it")
    other_lon_e7: int | None = None
    transport: str | None = None
    other_transport: str | None = None
    distance_mm: int | None = None
    interval_ms: int | None = None
    other_uav_id: str | None = None
    verified: Literal[False]


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
    operator_id: str | None = Field(default=None, description="Masked; POST /unmask shows it to those who may")
    claim_t_ms: int | None = Field(default=None, description="The broadcast's own time")
    rssi: int | None = Field(default=None, description="dBm")
    latency_ms: int | None = Field(default=None, description="How long after its own time it was heard")
    lost: int | None = Field(default=None, description="Frames missed so far, by their counters")
    duplicates: int | None = Field(default=None, description="Positions heard again so far, over other transports")
    transports: list[str] | None = Field(default=None, description="Transports heard lately, where several")
    drip: Drip | None = Field(default=None, description="Who signed its broadcasts; not whether they are true")
    description: str | None = Field(
        default=None, description="What the operator says that it does (Self ID): anybody's text, never markup"
    )
    description_type: Literal["text", "emergency", "extended_status", "private"] | None = None
    area_count: int | None = Field(default=None, description="Aircraft under this identity, where there are several")
    area_radius_mm: int | None = Field(default=None, description="They are within this distance of the position")
    area_ceiling_mm: int | None = Field(default=None, description="Above the WGS-84 ellipsoid")
    area_floor_mm: int | None = None
    ua_type: int | None = Field(default=None, description="Aircraft type of ASTM F3411, 0 to 15; 2: multirotor")
    height_accuracy_mm: int | None = Field(default=None, description="Broadcast vertical accuracy, 95 %")
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
    truth_east_mm: int | None = Field(
        default=None, description="Where the pad’s reference (motion capture) has the drone then, in the pad’s frame"
    )
    truth_north_mm: int | None = None
    verified: Literal[False]


class TrackHistory(ApiModel):
    """Positions of one drone, oldest first."""

    uav_id: str
    items: list[Track]
    next: str | None = Field(default=None, description="Pass it as `cursor` to get the next page")


TrackPage = page_of("TrackPage", Track)
FindingPage = page_of("FindingPage", Finding)
