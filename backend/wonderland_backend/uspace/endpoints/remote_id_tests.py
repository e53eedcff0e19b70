"""InterUSS' interfaces by which a system is tested (`injection`, `observation`, `versioning`), behind a switch."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Depends, Path
from fastapi.responses import Response
from uas_standards.interuss.automated_testing.rid.v1.constants import Scope
from uas_standards.interuss.automated_testing.versioning.constants import Scope as VersioningScope

from wonderland.problems import said
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, NotFound
from wonderland_backend.http.times import rfc3339, unix_ms
from wonderland_backend.responses import Json
from wonderland_backend.uspace.access import system_with
from wonderland_backend.uspace.claims import Details
from wonderland_backend.uspace.dss.models import parse
from wonderland_backend.uspace.endpoints.remote_id import NO_STORE, FlightId, StandardRoute, View
from wonderland_backend.uspace.flights import Flight
from wonderland_backend.uspace.geo import E7, Box
from wonderland_backend.uspace.netrid.clusters import Cluster
from wonderland_backend.uspace.netrid.harness import Harness, InjectedTest
from wonderland_backend.uspace.netrid.provider import within
from wonderland_backend.uspace.netrid.views import parse_view
from wonderland_backend.uspace.service import USpaceDep

router = APIRouter(tags=["test harness"], route_class=StandardRoute)

PATHS: Final = (
    "/uss/{path:path}",
    "/tests/{path:path}",
    "/user_notifications",
    "/display_data",
    "/display_data/{path:path}",
    "/versions/{path:path}",
)
"""Where nothing else may answer: these addresses are the standards', open or not."""
MAX_BODY: Final = 16 << 20
"""A test may bring many flights, each of them second by second."""
INJECT: Final = [Depends(system_with(Scope.Inject.value))]
OBSERVE: Final = [Depends(system_with(Scope.Observe.value))]
READ_VERSIONS: Final = [Depends(system_with(VersioningScope.ReadSystemVersions.value))]


async def _advanced(uspace: USpaceDep) -> Harness:
    """The harness, brought up to now."""
    uspace.harness.advance()
    return uspace.harness


HarnessDep = Annotated[Harness, Depends(_advanced)]
SystemIdentity = Annotated[str, Path(min_length=1, max_length=200)]
TestId = Annotated[str, Path(min_length=1, max_length=200)]


@router.put("/tests/{test_id}", dependencies=INJECT)
async def create_test(harness: HarnessDep, test_id: TestId, body: Annotated[dict[str, Any], Body()]) -> Response:
    """Inject flights."""
    try:
        test = parse(InjectedTest, body)
    except ValueError as error:
        raise BadRequest(said("test_unreadable", why=error)) from None
    return Json(harness.create(test_id, test, body), headers=NO_STORE)


@router.delete("/tests/{test_id}/{version}", dependencies=INJECT)
async def delete_test(harness: HarnessDep, test_id: TestId, version: TestId) -> Response:
    """Take injected flights away."""
    return Json(harness.delete(test_id, version), headers=NO_STORE)


@router.get("/user_notifications", dependencies=INJECT)
async def query_user_notifications(
    harness: HarnessDep, context: ContextDep, after: str, before: str | None = None
) -> Response:
    """What operators were told."""
    try:
        after_ms = unix_ms(after)
        before_ms = unix_ms(before) if before is not None else context.clock()
    except ValueError:
        raise BadRequest(said("no_rfc3339")) from None
    if before is not None and before_ms <= after_ms:
        raise BadRequest(said("before_not_after"))
    return Json(harness.notices(after_ms, before_ms), headers=NO_STORE)


@router.get("/display_data", dependencies=[*OBSERVE, Depends(_advanced)])
async def get_display_data(uspace: USpaceDep, view: View) -> Response:
    """What a person would see of a view."""
    box = parse_view(view)
    shown = await uspace.display.look_at_view(box)
    content = {
        "flights": [_flight(flight, box) for flight in shown.flights],
        "clusters": [_cluster(cluster) for cluster in shown.clusters],
    }
    return Json(content, headers=NO_STORE)


@router.get("/display_data/{flight_id}", dependencies=[*OBSERVE, Depends(_advanced)])
async def get_details(uspace: USpaceDep, flight_id: FlightId) -> Response:
    """What a person would see of a flight."""
    details = await uspace.display.details(flight_id)
    if details is None:
        raise NotFound(said("no_flight_shown"))
    return Json(_details(details), headers=NO_STORE)


@router.get("/versions/{system_identity}", dependencies=READ_VERSIONS)
async def get_version(context: ContextDep, system_identity: SystemIdentity) -> Response:
    """Which version of a system runs here."""
    if system_identity not in context.settings.uspace.system_identities:
        raise NotFound(said("no_such_system"))
    return Json({"system_identity": system_identity, "system_version": f"v{context.version}"}, headers=NO_STORE)


def _flight(flight: Flight, view: Box) -> dict[str, Any]:
    state = flight.current
    said = state.state()
    movement = {
        name: said[name]
        for name in (
            "timestamp_accuracy", "operational_status", "track", "speed", "speed_accuracy", "vertical_speed",
        )
    }  # fmt: skip
    return {
        "id": flight.flight_id,
        "aircraft_type": flight.details.aircraft_type,
        "current_state": {"timestamp": rfc3339(state.t_ms), **movement},
        "most_recent_position": state.position(),
        "recent_paths": [{"positions": [each.position() for each in within(flight, view)]}],
    }


def _cluster(cluster: Cluster) -> dict[str, Any]:
    box = cluster.box
    return {
        "corners": [{"lat": box.south / E7, "lng": box.west / E7}, {"lat": box.north / E7, "lng": box.east / E7}],
        "area_sqm": box.area_m2(),
        "number_of_flights": cluster.flights,
    }


def _details(details: Details) -> dict[str, Any]:
    operator = details.operator
    shown: dict[str, Any] = {}
    if operator.registration:
        shown["id"] = operator.registration
    if operator.lat is not None and operator.lng is not None:
        shown["location"] = {"lat": operator.lat / E7, "lng": operator.lng / E7}
    if operator.altitude_m is not None:
        shown["altitude"] = {"altitude": operator.altitude_m}
        if operator.place is not None:
            shown["altitude"]["altitude_type"] = operator.place
    uas: dict[str, Any] = {"id": next(iter(details.uas_id.values()), "")}
    if details.eu_category is not None or details.eu_class is not None:
        uas["eu_classification"] = details.content("")["eu_classification"]
    return {"operator": shown, "uas": uas}
