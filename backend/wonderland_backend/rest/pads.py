"""Pads by REST."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend import geojson
from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.areas import Box
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, NotFound, documented
from wonderland_backend.filters import PadFilters
from wonderland_backend.live.hub import HubDep
from wonderland_backend.narrowing import pads_within
from wonderland_backend.pads import queries
from wonderland_backend.pads.queue import read_queue
from wonderland_backend.pads.schemas import Pad, PadPage, PadQueue
from wonderland_backend.responses import Json

router = APIRouter(tags=["pads"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_pad", pad_id="aurajoki-2"))
PadIdPath = Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=64)]


@router.get("/pads", response_model=PadPage, responses=documented(BadRequest) | geojson.documented(PadPage))
async def list_pads(
    request: Request, context: ContextDep, hub: HubDep, person: SignedInPerson, filters: PadFilters
) -> Response:
    """Pads by identifier."""
    after = filters.after_key(str)
    async with context.database.read() as database:
        within = await pads_within(database, Box.parse(filters.bbox)) if filters.bbox is not None else None
        rows = await queries.listing(
            database, person.scope, after=after, limit=filters.limit + 1, operator=filters.operator, within=within
        )
        health = await queries.health_of(database, [row.pad_id for row in rows])
    items = (
        (row, queries.pad_json(row.record, health.get(row.pad_id), connected=hub.board.is_connected(row.pad_id)))
        for row in rows
    )
    return geojson.page(request, items, filters.limit, cursor_of=lambda row: (row.pad_id,), id_of=_id)


@router.get("/pads/{pad_id}", response_model=Pad, responses=documented(_NOT_FOUND) | geojson.documented(Pad))
async def read_pad(
    request: Request,
    context: ContextDep,
    hub: HubDep,
    person: SignedInPerson,
    pad_id: PadIdPath,
) -> Response:
    """A pad."""
    async with context.database.read() as database:
        row = await queries.find_pad(database, person.scope, pad_id)
        if row is None:
            raise NotFound(said("no_such_pad", pad_id=pad_id))
        health = await queries.health_of(database, [pad_id])
    connected = hub.board.is_connected(pad_id)
    return geojson.one(request, queries.pad_json(row.record, health.get(pad_id), connected=connected), id_of=_id)


@router.get("/pads/{pad_id}/queue", response_model=PadQueue, responses=documented(_NOT_FOUND))
async def read_pad_queue(context: ContextDep, person: SignedInPerson, pad_id: PadIdPath) -> Response:
    """Who has the pad, and who waits for it in which order, as it is now."""
    async with context.database.read() as database:
        if await queries.find_pad(database, person.scope, pad_id) is None:
            raise NotFound(said("no_such_pad", pad_id=pad_id))
        return Json(await read_queue(database, pad_id, context.clock()))


def _id(item: geojson.Item) -> str:
    return str(item["pad_id"])
