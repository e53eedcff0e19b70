"""Zones by REST: lists, import, export, the geo-awareness service, and what zones mean for pads."""

from __future__ import annotations

from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.closures import ZONE_ID_PATTERN
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend import errors, geojson
from wonderland_backend.access import Administrator, SignedInPerson
from wonderland_backend.areas import Box
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.db.tables.zones import ZoneSetRow
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, NotFound, TooManyRequests, Unprocessable
from wonderland_backend.filters import Paging
from wonderland_backend.languages import HEADER, language_of
from wonderland_backend.responses import Json, page, resource
from wonderland_backend.zones import awareness, importing, pads, queries, store
from wonderland_backend.zones.heights import Band
from wonderland_backend.zones.schemas import (
    Awareness,
    AwarenessArea,
    AwarenessQuery,
    ClosurePlan,
    ExportQuery,
    ImportQuery,
    ImportReport,
    ImportsQuery,
    PadClosures,
    PadClosuresPage,
    PlanQuery,
    Zone,
    ZoneImportPage,
    ZonePage,
    ZoneQuery,
)
from wonderland_backend.zones.shown import taken_geometry, zone_json

router = APIRouter(tags=["zones"])
service = APIRouter(tags=["geo-awareness"])
_LANGUAGE: Final = {"parameters": [HEADER]}
_ED318: Final = geojson.collection_of(
    {
        "type": "object",
        "description": "A zone as ED-318 writes it",
        "examples": [
            {
                "type": "Feature",
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [[[22.2, 60.4], [22.3, 60.4], [22.3, 60.5], [22.2, 60.5], [22.2, 60.4]]],
                },
                "properties": {
                    "identifier": "EFP20",
                    "country": "FIN",
                    "type": "PROHIBITED",
                    "variant": "COMMON",
                    "reason": ["SENSITIVE"],
                    "zoneAuthority": [{"name": [{"text": "Traficom", "lang": "en-GB"}], "purpose": "AUTHORIZATION"}],
                },
            }
        ],
    }
)
_FILE: Final = {
    "requestBody": {
        "required": True,
        "description": "ED-318 (GeoJSON) or ED-269 (JSON), in UTF-8",
        "content": {
            "application/geo+json": {"schema": _ED318},
            "application/json": {"schema": {"type": "object"}, "example": {"title": "Zones", "features": []}},
        },
    }
}
_NO_PAD: Final = NotFound(said("no_pad_in_service", pad_id="aurajoki-2"))
_GEOMETRY: Final = BadRequest(said("bad_geometry"), ("body.geometry", "a ring is open"))
PadId = Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=64)]
ZoneId = Annotated[str, Path(pattern=f"^{ZONE_ID_PATTERN}$", max_length=11)]


@router.get(
    "/zones",
    responses=geojson.documented(ZonePage) | errors.documented(BadRequest),
    openapi_extra=_LANGUAGE,
)
async def list_zones(
    request: Request, context: ContextDep, filters: Annotated[ZoneQuery, Query()], _: SignedInPerson
) -> Response:
    """The zones of all data sets that hold, by identifier; as JSON with their ED-318 features, or as plain GeoJSON."""
    now = context.clock() if filters.at_ms is None else filters.at_ms
    async with context.database.read() as database:
        found = await queries.listing(database, filters, after=filters.after_key(str))
    language = language_of(request)
    return geojson.page(
        request,
        ((row, zone_json(row, language, now)) for row in found),
        filters.limit,
        cursor_of=lambda row: (row[0].zone_id,),
        id_of=lambda item: str(item["zone_id"]),
        geometry_of=taken_geometry,
    )


@router.post(
    "/zones/imports",
    status_code=201,
    response_model=ImportReport,
    responses=errors.documented(Forbidden, Conflict, Unprocessable, TooManyRequests)
    | {200: {"model": ImportReport, "description": "A dry run, or a file that is in force already"}},
    openapi_extra=_FILE,
)
async def import_zones(
    request: Request, context: ContextDep, asked: Annotated[ImportQuery, Query()], person: Administrator
) -> Response:
    """Import a file of zones: all of it takes the place of its source's data set, or nothing does.

    With `dry_run` the report says what the file holds and all that is wrong with it, line by line. An empty list of
    features empties the data set. At most 32 MiB (`max_zone_file_bytes`).
    """
    report = await importing.import_file(context, person, request, asked.source, dry_run=asked.dry_run)
    new = not asked.dry_run and report.pop("new")
    return Json(report, status_code=201 if new else 200)


@router.get("/zones/imports", response_model=ZoneImportPage, responses=errors.documented(BadRequest, etag=True))
async def list_zone_imports(
    request: Request, context: ContextDep, filters: Annotated[ImportsQuery, Query()], _: SignedInPerson
) -> Response:
    """Every import, newest first: who, when, of which source; the one without `replaced_ms` holds."""
    place = filters.after_place(int, str)
    async with context.database.read() as database:
        rows = await queries.imports(database, filters, before=(place[0], place[1]) if place else None)
    return page(
        request,
        ((row, _import(row)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.imported_ms, row.import_id),
    )


def _import(row: ZoneSetRow) -> dict[str, Any]:
    content = {
        "import_id": row.import_id,
        "source": row.source,
        "format": row.format,
        "sha256": row.file_sha256,
        "size_bytes": row.size_bytes,
        "zones": row.zones,
        "notices": orjson.Fragment(row.notices),
        "about": orjson.Fragment(row.about),
        "imported_ms": row.imported_ms,
        "imported_by": row.imported_by,
    }
    return content if row.replaced_ms is None else content | {"replaced_ms": row.replaced_ms}


@router.get(
    "/zones/export",
    response_class=Response,
    responses=errors.documented(etag=True) | {200: {"content": {geojson.MEDIA_TYPE: {"schema": _ED318}}}},
)
async def export_zones(
    request: Request, context: ContextDep, asked: Annotated[ExportQuery, Query()], _: SignedInPerson
) -> Response:
    """The data sets that hold as one ED-318 collection; of one source, with its own title and metadata."""
    about: dict[str, Any] = {}
    async with context.database.read() as database:
        zones = await queries.in_force(database, source=asked.source)
        if asked.source is not None and (data_set := await store.current(database, asked.source)) is not None:
            about = orjson.loads(data_set.about)
    return resource(
        request,
        {"type": "FeatureCollection", **about, "features": [orjson.Fragment(zone.feature) for zone, _ in zones]},
        geojson.MEDIA_TYPE,
    )


@router.get(
    "/zones/pads",
    response_model=PadClosuresPage,
    responses=errors.documented(BadRequest, etag=True),
    openapi_extra=_LANGUAGE,
)
async def list_pad_closures(request: Request, context: ContextDep, filters: Paging, person: SignedInPerson) -> Response:
    """Pads, the zones that come within their reach, and whether the ledger has the closures that follow."""
    after = filters.after_key(str)
    language, now = language_of(request), context.clock()
    async with context.database.read() as database:
        found = await pads.listing(database, person.scope, after=after, limit=filters.limit + 1)
    return page(
        request,
        ((its, pads.pad_closures_json(its, language, now)) for its in found),
        filters.limit,
        cursor_of=lambda its: (its.pad.pad_id,),
    )


@router.get(
    "/zones/pads/{pad_id}",
    response_model=PadClosures,
    responses=errors.documented(_NO_PAD, etag=True),
    openapi_extra=_LANGUAGE,
)
async def read_pad_closures(request: Request, context: ContextDep, pad_id: PadId, person: SignedInPerson) -> Response:
    """One pad with its zones and closures."""
    its = await _pad(context, pad_id, person)
    return resource(request, pads.pad_closures_json(its, language_of(request), context.clock()))


@router.get(
    "/zones/pads/{pad_id}/plan", response_model=ClosurePlan, responses=errors.documented(_NO_PAD, Unprocessable)
)
async def plan_closures(
    context: ContextDep, pad_id: PadId, asked: Annotated[PlanQuery, Query()], person: SignedInPerson
) -> Response:
    """The argument of SetClosures by today's zones, for an officer to sign: schedules and daylight written out.

    It ends sooner than asked for where a record has no room for so many closures.
    """
    its = await _pad(context, pad_id, person)
    due = pads.planned(its, context.clock(), asked.days)
    closures = [each.to_json() for each in due.closures]
    return Json({"pad_id": pad_id, "closures": closures, "valid_until_ms": due.valid_until_ms})


async def _pad(context: Context, pad_id: str, person: SignedInPerson) -> pads.PadZones:
    async with context.database.read() as database:
        found = await pads.find_pad_zones(database, person.scope, pad_id)
    if found is None:
        raise NotFound(said("no_pad_in_service", pad_id=pad_id))
    return found


@router.get(
    "/zones/{zone_id}",
    responses=geojson.documented(Zone) | errors.documented(NotFound(said("no_zone_holds", zone_id="FIN:EFP20"))),
    openapi_extra=_LANGUAGE,
)
async def read_zone(request: Request, context: ContextDep, zone_id: ZoneId, _: SignedInPerson) -> Response:
    """One zone that is in force."""
    async with context.database.read() as database:
        row = await queries.find_zone(database, zone_id)
    if row is None:
        raise NotFound(said("no_zone_holds", zone_id=zone_id))
    return geojson.one(
        request,
        zone_json(row, language_of(request), context.clock()),
        id_of=lambda item: str(item["zone_id"]),
        geometry_of=taken_geometry,
    )


@service.get("/geo-awareness", response_model=Awareness, responses=errors.documented(), openapi_extra=_LANGUAGE)
async def zones_at(
    request: Request, context: ContextDep, asked: Annotated[AwarenessQuery, Query()], _: SignedInPerson
) -> Response:
    """Which zones hold at a place, in which heights, and when within a span of time."""
    geometry = {"type": "Point", "coordinates": [asked.lon, asked.lat]}
    heights = None if asked.height_m is None else Band(asked.height_m, asked.height_m, asked.height_reference)
    return await _awareness(request, context, geometry, 0, heights, (asked.from_ms, asked.until_ms))


@service.post(
    "/geo-awareness", response_model=Awareness, responses=errors.documented(_GEOMETRY), openapi_extra=_LANGUAGE
)
async def zones_along(request: Request, context: ContextDep, asked: AwarenessArea, _: SignedInPerson) -> Response:
    """The same for a route or an area. It changes nothing, although it is a POST."""
    heights = None
    if asked.lower_m is not None or asked.upper_m is not None:
        lower = -1_000 if asked.lower_m is None else asked.lower_m
        upper = 100_000 if asked.upper_m is None else asked.upper_m
        heights = Band(lower, upper, asked.height_reference)
    return await _awareness(request, context, asked.geometry, asked.margin_m, heights, (asked.from_ms, asked.until_ms))


async def _awareness(
    request: Request,
    context: Context,
    geometry: dict[str, Any],
    margin_m: float,
    heights: Band | None,
    span: tuple[int | None, int | None],
) -> Response:
    now = context.clock()
    start = now if span[0] is None else span[0]
    until = start if span[1] is None else span[1]
    area = awareness.area_of(geometry, margin_m)
    west, south, east, north = area.bounds
    limits = max(west, -180.0), max(south, -90.0), min(east, 180.0), min(north, 90.0)
    box = Box(*(round(each * 1e7) for each in limits))
    async with context.database.read() as database:
        rows = await queries.in_force(database, box=box)
        sets = await store.data_sets(database)
    found = awareness.holding(rows, awareness.Question(area, heights, start, until))
    language = language_of(request)
    content: dict[str, Any] = {
        "t_ms": now,
        "from_ms": start,
        "until_ms": until,
        "zones": [_there(each, zone_json(each.row, language, now)) for each in found[: awareness.MAX_LISTED]],
        "more": len(found) > awareness.MAX_LISTED,
        "data_sets": [_data_set(each) for each in sets],
    }
    if found:
        content["most_restrictive"] = found[0].row[0].type
    return Json(content)


def _there(each: awareness.There, content: dict[str, Any]) -> dict[str, Any]:
    when = [{"from_ms": start, "until_ms": until} for start, until in each.spans]
    return content | {"spans": when, "reaches": each.reaches}


def _data_set(row: ZoneSetRow) -> dict[str, Any]:
    start, until = store.validity(row.about)
    content = {"source": row.source, "import_id": row.import_id, "imported_ms": row.imported_ms}
    optional = {"valid_from_ms": start, "valid_until_ms": until}
    return content | {name: value for name, value in optional.items() if value is not None}
