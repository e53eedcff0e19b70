"""Traffic as recipients get it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland_backend.schemas import ApiModel

Recipient = Literal["public", "ussp", "ats", "authority"]


class Pilot(ApiModel):
    """Where the remote pilot is, or where the drone took off."""

    lat_e7: int
    lon_e7: int
    place: Literal["pilot", "takeoff", "fixed"] | None = Field(
        default=None, description="Which of them, if it was said"
    )


class TrafficItem(ApiModel):
    """A drone in flight (EU 2021/664, article 8(2)), as it says itself. Unverified."""

    flight_id: str = Field(description="Random for each flight; tells nothing about the drone")
    t_ms: int = Field(description="When the drone was there")
    heard_ms: int = Field(description="When a pad heard it")
    lat_e7: int
    lon_e7: int
    altitude_amsl_mm: int | None = Field(
        default=None, description="Above mean sea level (EGM96); missing where the server has no geoid"
    )
    altitude_wgs84_mm: int | None = Field(default=None, description="Above the WGS-84 ellipsoid, as broadcast")
    height_mm: int | None = None
    height_above: Literal["takeoff", "ground"] | None = None
    course_cdeg: int | None = Field(default=None, description="Clockwise from true north, degrees × 100")
    ground_speed_mm_s: int | None = None
    emergency: Literal["none", "emergency", "remote_id_failure", "unknown"]
    operator_registration: str | None = Field(
        default=None, description="As broadcast, never with its secret characters; not for the public"
    )
    serial: str | None = Field(default=None, description="Not for the public")
    pilot: Pilot | None = Field(default=None, description="Not for the public")
    source: Literal["service_provider", "broadcast"] = Field(
        description="Whether we are the drone's service provider, or only heard it"
    )
    verified: Literal[False]


class Traffic(ApiModel):
    """Drones in flight now."""

    t_ms: int
    recipient: Recipient
    items: list[TrafficItem]
