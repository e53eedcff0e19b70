"""Drones by REST."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend import geojson
from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.drones import queries
from wonderland_backend.drones.schemas import Drone, DronePage
from wonderland_backend.errors import BadRequest, NotFound, documented
from wonderland_backend.filters import DroneFilters
from wonderland_backend.narrowing import OPERATORS_MASKED

router = APIRouter(tags=["drones"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_drone", uav_id="OH-DRN-0417"))


@router.get(
    "/drones",
    response_model=DronePage,
    responses=documented(BadRequest, OPERATORS_MASKED) | geojson.documented(DronePage),
)
async def list_drones(request: Request, context: ContextDep, person: SignedInPerson, filters: DroneFilters) -> Response:
    """Drones by serial number. As GeoJSON each is where it broadcast last, unverified."""
    after = filters.after_key(str)
    async with context.database.read() as database:
        rows = await queries.listing(database, person.scope, filters, after=after)
        items = await queries.details(database, person, rows)
    return geojson.page(
        request,
        zip(rows, items, strict=True),
        filters.limit,
        cursor_of=lambda row: (row.uav_id,),
        id_of=_id,
        geometry_of=_heard,
    )


@router.get("/drones/{uav_id}", response_model=Drone, responses=documented(_NOT_FOUND) | geojson.documented(Drone))
async def read_drone(
    request: Request,
    context: ContextDep,
    person: SignedInPerson,
    uav_id: Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=40)],
) -> Response:
    """A drone."""
    async with context.database.read() as database:
        row = await queries.find_drone(database, person.scope, uav_id)
        if row is None:
            raise NotFound(said("no_such_drone", uav_id=uav_id))
        (item,) = await queries.details(database, person, [row])
    return geojson.one(request, item, id_of=_id, geometry_of=_heard)


def _id(item: geojson.Item) -> str:
    return str(item["uav_id"])


def _heard(item: geojson.Item) -> geojson.Geometry:
    return geojson.point(item.get("track"))
