"""What the console shows of networked flights."""

from __future__ import annotations

from pydantic import Field

from wonderland_backend.schemas import ApiModel


class NetworkedPosition(ApiModel):
    """Where a flight was."""

    lat_e7: int
    lon_e7: int
    t_ms: int


class NetworkedFlight(ApiModel):
    """A flight as its service provider tells it. Unverified."""

    flight_id: str = Field(description="Good for its details for a minute; tells nothing about the drone")
    provider: str | None = Field(default=None, description="Host name of who tells it; missing: we do")
    aircraft_type: str
    status: str
    lat_e7: int
    lon_e7: int
    height_mm: int | None = Field(default=None, description="Height above the WGS-84 ellipsoid")
    above_mm: int | None = Field(default=None, description="Height above take-off or ground")
    speed_mm_s: int | None = None
    track_cdeg: int | None = None
    vertical_mm_s: int | None = None
    t_ms: int
    trail: list[NetworkedPosition] = Field(description="Positions of the last minute within the view, oldest first")
    simulated: bool
    verified: bool = Field(description="Always false: a provider's word")


class FlightCluster(ApiModel):
    """An area that holds so many flights: in a view of more than 2 km none is shown by itself (F3411-22a)."""

    south_e7: int
    west_e7: int
    north_e7: int
    east_e7: int
    flights: int


class FlightProvider(ApiModel):
    """A service provider in the view."""

    provider: str
    problem: str | None = Field(default=None, description="Why its flights may be missing or old")


class NetworkedFlights(ApiModel):
    """What Network Remote ID shows of a view."""

    t_ms: int
    flights: list[NetworkedFlight]
    clusters: list[FlightCluster]
    providers: list[FlightProvider] = Field(description="Those besides us")


class NetworkedFlightDetails(ApiModel):
    """Who flies, as the drone or its provider says. Unverified."""

    flight_id: str
    uas_id: dict[str, str]
    operator_registration: str | None = None
    operator_lat_e7: int | None = None
    operator_lon_e7: int | None = None
    eu_category: str | None = None
    eu_class: str | None = None
    description: str | None = None
    verified: bool
