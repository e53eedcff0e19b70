"""Shapes of flights."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from pydantic import Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.areas import DESCRIPTION, PATTERN
from wonderland_backend.filters import TimeQuery
from wonderland_backend.schemas import ApiModel, page_of

_ID = f"^{ID_PATTERN}$"


class Spot(ApiModel):
    """A position that the drone broadcast."""

    lat_e7: int
    lon_e7: int


class Extent(ApiModel):
    """The box that holds all of its positions."""

    west_e7: int
    south_e7: int
    east_e7: int
    north_e7: int


class Flight(ApiModel):
    """Positions that one drone broadcast without a pause of more than five minutes. Unverified."""

    flight_id: str
    uav_id: str
    start_ms: int
    end_ms: int = Field(description="When it was heard last")
    active: bool = Field(description="Heard within the last five minutes")
    positions: int
    first: Spot
    last: Spot
    extent: Extent
    proofs: list[str] | None = Field(default=None, description="Proofs decided meanwhile; of a single flight only")
    verified: Literal[False]


class FlightQuery(TimeQuery):
    """Which flights: those that were under way at some time of the span."""

    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only of this drone")
    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator's drones")
    bbox: str | None = Field(default=None, pattern=PATTERN, description=f"Only those that touch: {DESCRIPTION}")


FlightFilters = Annotated[FlightQuery, Query()]
FlightPage = page_of("FlightPage", Flight)
