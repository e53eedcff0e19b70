"""Tracks by REST. All of it is unverified, and says so."""

from __future__ import annotations

from typing import Annotated

import orjson
from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend import geojson
from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, documented
from wonderland_backend.filters import FindingFilters, LatestFilters, Spanning
from wonderland_backend.pagination import encode_cursor
from wonderland_backend.responses import Json, page
from wonderland_backend.tracks import queries
from wonderland_backend.tracks.schemas import FindingPage, TrackHistory, TrackPage

router = APIRouter(tags=["tracks"], dependencies=SIGNED_IN)


@router.get("/tracks", response_model=TrackPage, responses=documented(BadRequest) | geojson.documented(TrackPage))
async def list_tracks(
    request: Request, context: ContextDep, person: SignedInPerson, filters: LatestFilters
) -> Response:
    """The last broadcast position of each drone. Unverified."""
    after = filters.after_key(str)
    async with context.database.read() as database:
        rows = await queries.latest(
            database, person.scope, since_ms=filters.since_ms, after=after, limit=filters.limit + 1
        )
    return geojson.page(
        request,
        ((row, orjson.Fragment(row.body)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.uav_id,),
        id_of=lambda item: str(item["uav_id"]),
    )


@router.get("/findings", response_model=FindingPage, responses=documented(BadRequest, etag=True))
async def list_findings(
    request: Request, context: ContextDep, person: SignedInPerson, filters: FindingFilters
) -> Response:
    """What was odd about broadcasts (one serial from two places, time that stands still), newest first. Unverified."""
    place = filters.after_place(int, int)
    async with context.database.read() as database:
        rows = await queries.findings(
            database,
            person.scope,
            uav_id=filters.drone,
            pad_id=filters.pad,
            since_ms=filters.since_ms,
            until_ms=filters.until_ms,
            before=(place[0], place[1]) if place else None,
            limit=filters.limit + 1,
        )
    fragments = ((row, orjson.Fragment(row.body)) for row in rows)
    return page(request, fragments, filters.limit, cursor_of=lambda row: (row.t_ms, row.id))


@router.get("/tracks/{uav_id}", response_model=TrackHistory, responses=documented(BadRequest))
async def read_track(
    context: ContextDep,
    person: SignedInPerson,
    uav_id: Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=40)],
    filters: Spanning,
) -> Response:
    """Broadcast positions of a drone, oldest first. Unverified; empty for a drone never heard."""
    place = filters.after_place(int, int)
    async with context.database.read() as database:
        rows = await queries.history(
            database,
            person.scope,
            uav_id,
            since_ms=filters.since_ms,
            until_ms=filters.until_ms,
            after=(place[0], place[1]) if place else None,
            limit=filters.limit + 1,
        )
    shown = rows[: filters.limit]
    content: dict[str, object] = {"uav_id": uav_id, "items": [orjson.Fragment(row.body) for row in shown]}
    if len(rows) > filters.limit:
        content["next"] = encode_cursor(shown[-1].t_ms, shown[-1].id)
    return Json(content, headers={"Cache-Control": "private, no-store"})
