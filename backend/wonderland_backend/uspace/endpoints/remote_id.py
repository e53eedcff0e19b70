"""What other U-space systems ask of us, at the addresses that F3411-22a gives.

Unknown parameters are ignored here: the standard asks for that.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from uas_standards.astm.f3411.v22a.constants import Scope

from wonderland.problems import said
from wonderland_backend.errors import BadRequest, NotFound, documented, field_errors, unreadable
from wonderland_backend.responses import Json
from wonderland_backend.tokens import Caller, ScopeMissing, TokenRefused
from wonderland_backend.uspace.access import system_with
from wonderland_backend.uspace.dss.models import UUID4, AreaNotification
from wonderland_backend.uspace.netrid.provider import MAX_RECENT_S
from wonderland_backend.uspace.netrid.schemas import RidArea, RidDetails, RidFlights
from wonderland_backend.uspace.netrid.views import BadView, ViewTooLarge, parse_view
from wonderland_backend.uspace.netrid.watches import NotTheOwner, OtherArea
from wonderland_backend.uspace.service import USpaceDep

_INVALID: Final = BadRequest(said("rid_parameters"))


class StandardRoute(APIRoute):
    """A route whose refusals of parameters and bodies are 400, as the standard has them."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The route's handler, with refused parameters turned into 400."""
        handle = super().get_route_handler()

        async def handling(request: Request) -> Response:
            try:
                return await handle(request)
            except RequestValidationError as error:
                raise BadRequest(_INVALID.said, *field_errors(error)) from None
            except HTTPException as error:
                if (why := unreadable(error)) is None:
                    raise
                raise BadRequest(_INVALID.said, why) from None

        return handling


router = APIRouter(prefix="/uss", tags=["network remote id"], route_class=StandardRoute)

DISPLAY_PROVIDER: Final = Scope.DisplayProvider.value
SERVICE_PROVIDER: Final = Scope.ServiceProvider.value
NO_STORE: Final = {"Cache-Control": "no-store"}
View = Annotated[str, Query(description="lat1,lng1,lat2,lng2 in degrees", examples=["60.44,22.25,60.46,22.29"])]
AreaId = Annotated[str, Path(pattern=UUID4)]
FlightId = Annotated[str, Path(min_length=1, max_length=255)]


@router.get(
    "/flights",
    response_model=RidFlights,
    dependencies=[Depends(system_with(DISPLAY_PROVIDER))],
    responses=documented(BadView, _INVALID, TokenRefused, ScopeMissing, ViewTooLarge),
)
async def search_flights(
    uspace: USpaceDep,
    view: View,
    recent_positions_duration: Annotated[
        float, Query(ge=0, le=MAX_RECENT_S, allow_inf_nan=False, description="Seconds of recent positions")
    ] = 0,
) -> Response:
    """Flights with a position of the last minute in a view of at most 7 km across (F3411-22a, searchFlights)."""
    uspace.harness.advance()
    box = parse_view(view)
    content = uspace.provider.flights_in(box, recent_positions_duration, has_areas=uspace.covers(box))
    return Json(content, headers=NO_STORE)


@router.get(
    "/flights/{flight_id}/details",
    response_model=RidDetails,
    dependencies=[Depends(system_with(DISPLAY_PROVIDER))],
    responses=documented(_INVALID, TokenRefused, ScopeMissing, NotFound(said("no_such_rid_flight"))),
)
async def read_flight_details(uspace: USpaceDep, flight_id: FlightId) -> Response:
    """Who flies, as far as the drone said (F3411-22a, getFlightDetails)."""
    content = uspace.provider.details(flight_id)
    if content is None:
        raise NotFound(said("no_such_rid_flight"))
    return Json(content, headers=NO_STORE)


@router.get(
    "/identification_service_areas/{area_id}",
    response_model=RidArea,
    dependencies=[Depends(system_with(DISPLAY_PROVIDER))],
    responses=documented(_INVALID, TokenRefused, ScopeMissing, NotFound(said("no_such_rid_area"))),
)
async def read_identification_service_area(uspace: USpaceDep, area_id: AreaId) -> Response:
    """The extents of an identification service area of ours (F3411-22a, getIdentificationServiceAreaDetails)."""
    extents = uspace.areas.find_extents(area_id)
    if extents is None:
        raise NotFound(said("no_such_rid_area"))
    return Json({"extents": extents}, headers=NO_STORE)


@router.post(
    "/identification_service_areas/{area_id}",
    status_code=204,
    responses=documented(_INVALID, TokenRefused, ScopeMissing, NotTheOwner, OtherArea),
)
async def notify_identification_service_area(
    uspace: USpaceDep,
    area_id: AreaId,
    body: AreaNotification,
    caller: Annotated[Caller, Depends(system_with(SERVICE_PROVIDER))],
) -> Response:
    """Take in a changed or ended area of another provider (F3411-22a, postIdentificationServiceArea)."""
    uspace.display.watches.take_notification(area_id, body, caller.subject)
    return Response(status_code=204)
