"""Pads by REST."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from backend.auth.endpoints import SIGNED_IN
from backend.context import context_of
from backend.errors import BadRequest, NotFound, documented
from backend.filters import Paging
from backend.pads import queries
from backend.pads.schemas import Pad, PadPage
from backend.pagination import decode_cursor
from backend.responses import page, resource
from wonderland.proofs.records.fields import ID_PATTERN

router = APIRouter(tags=["pads"], dependencies=SIGNED_IN)


@router.get("/pads", response_model=PadPage, responses=documented(BadRequest))
async def list_pads(request: Request, paging: Paging) -> Response:
    """Pads by identifier."""
    context = context_of(request)
    after = decode_cursor(paging.cursor, str)[0] if paging.cursor is not None else None
    async with context.database.read() as database:
        rows = await queries.listing(database, after=after, limit=paging.limit + 1)
        health = await queries.health_of(database, [row.pad_id for row in rows])
    items = (
        (row, queries.shown(row.record, health.get(row.pad_id), connected=context.agents.is_connected(row.pad_id)))
        for row in rows
    )
    return page(items, paging.limit, cursor_of=lambda row: (row.pad_id,))


@router.get("/pads/{pad_id}", response_model=Pad, responses=documented(NotFound))
async def read_pad(
    request: Request, pad_id: Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=64)]
) -> Response:
    """A pad."""
    context = context_of(request)
    async with context.database.read() as database:
        row = await queries.find(database, pad_id)
        if row is None:
            raise NotFound(f"No pad {pad_id} is registered.")
        health = await queries.health_of(database, [pad_id])
    connected = context.agents.is_connected(pad_id)
    return resource(request, queries.shown(row.record, health.get(pad_id), connected=connected))
