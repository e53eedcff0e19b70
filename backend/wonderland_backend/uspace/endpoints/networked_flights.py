"""Networked flights for people: what other service providers tell, as F3411-22a lets a display show it."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import SIGNED_IN, Officer
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import NotFound, TooManyRequests, documented
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.responses import Json
from wonderland_backend.uspace.claims import State
from wonderland_backend.uspace.endpoints.remote_id import FlightId
from wonderland_backend.uspace.flights import Flight
from wonderland_backend.uspace.geo import Box
from wonderland_backend.uspace.netrid.console_schemas import NetworkedFlightDetails, NetworkedFlights
from wonderland_backend.uspace.netrid.display import DisplayProvider
from wonderland_backend.uspace.netrid.provider import within
from wonderland_backend.uspace.netrid.views import MAX_TEXT, BadView, ViewTooLarge, parse_view
from wonderland_backend.uspace.peers import ProviderAway
from wonderland_backend.uspace.service import USpaceDep

router = APIRouter(tags=["networked flights"])
PRIVATE = {"Cache-Control": "private, no-store"}


class ViewQuery(BaseModel):
    """Which part of the map."""

    model_config = ConfigDict(extra="forbid")

    view: str = Field(max_length=MAX_TEXT, description="lat1,lng1,lat2,lng2 in degrees, at most 7 km across")


@router.get(
    "/networked-flights",
    response_model=NetworkedFlights,
    dependencies=SIGNED_IN,
    responses=documented(BadView, ViewTooLarge, TooManyRequests),
)
async def list_networked_flights(
    context: ContextDep, uspace: USpaceDep, query: Annotated[ViewQuery, Query()]
) -> Response:
    """What Network Remote ID shows of a view: flights up to 2 km across, areas with some up to 7 km. Unverified."""
    view = parse_view(query.view)
    display = uspace.display
    shown = await display.look_at_view(view)
    content = {
        "t_ms": context.clock(),
        "flights": [_flight(flight, view, display) for flight in shown.flights],
        "clusters": [
            {
                "south_e7": cluster.box.south,
                "west_e7": cluster.box.west,
                "north_e7": cluster.box.north,
                "east_e7": cluster.box.east,
                "flights": cluster.flights,
            }
            for cluster in shown.clusters
        ],
        "providers": [
            {"provider": name, **({"problem": problem} if problem else {})}
            for name, problem in sorted(shown.providers.items())
        ],
    }
    return Json(content, headers=PRIVATE)


@router.get(
    "/networked-flights/{flight_id}",
    response_model=NetworkedFlightDetails,
    responses=documented(NotFound, ProviderAway),
)
async def read_networked_flight(
    context: ContextDep, uspace: USpaceDep, flight_id: FlightId, person: Officer
) -> Response:
    """Who flies, asked of the flight's provider: only for a flight shown by itself within the last minute. Audited."""
    try:
        details = await uspace.display.details(flight_id)
    except TransferError as error:
        raise ProviderAway(said("provider_away", why=error)) from None
    if details is None:
        raise NotFound(said("no_flight_shown"))
    operator = details.operator
    content: dict[str, Any] = {
        "flight_id": flight_id,
        "uas_id": details.uas_id,
        "operator_registration": operator.registration,
        "operator_lat_e7": operator.lat,
        "operator_lon_e7": operator.lng,
        "eu_category": details.eu_category,
        "eu_class": details.eu_class,
        "description": details.description,
        "verified": False,
    }
    async with context.database.write() as connection:
        subject = f"networked-flight/{flight_id}"
        await audit.record_read(connection, person, subject, t_ms=context.clock())
    return Json({name: value for name, value in content.items() if value is not None}, headers=PRIVATE)


def _flight(flight: Flight, view: Box, display: DisplayProvider) -> dict[str, Any]:
    state = flight.current
    content: dict[str, Any] = {
        "flight_id": flight.flight_id,
        "provider": display.provider_of(flight),
        "aircraft_type": flight.details.aircraft_type,
        "status": state.status,
        **_place(state),
        "height_mm": _thousandths(state.altitude_m),
        "above_mm": _thousandths(state.height_m),
        "speed_mm_s": _thousandths(state.speed_m_s),
        "track_cdeg": None if state.track_deg is None else round(state.track_deg * 100) % 36_000,
        "vertical_mm_s": _thousandths(state.vertical_m_s),
        "trail": [_place(each) for each in within(flight, view)],
        "simulated": flight.simulated,
        "verified": False,
    }
    return {name: value for name, value in content.items() if value is not None}


def _place(state: State) -> dict[str, int]:
    return {"lat_e7": state.lat, "lon_e7": state.lng, "t_ms": state.t_ms}


def _thousandths(value: float | None) -> int | None:
    return None if value is None else round(value * 1000)
