"""Drones by REST."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from backend.auth.endpoints import SIGNED_IN
from backend.context import context_of
from backend.drones import queries
from backend.drones.schemas import Drone, DronePage
from backend.errors import BadRequest, NotFound, documented
from backend.filters import Paging
from backend.pagination import decode_cursor
from backend.responses import page, resource
from wonderland.proofs.records.fields import ID_PATTERN

router = APIRouter(tags=["drones"], dependencies=SIGNED_IN)


@router.get("/drones", response_model=DronePage, responses=documented(BadRequest))
async def list_drones(request: Request, paging: Paging) -> Response:
    """Drones by serial number."""
    after = decode_cursor(paging.cursor, str)[0] if paging.cursor is not None else None
    async with context_of(request).database.read() as database:
        rows = await queries.listing(database, after=after, limit=paging.limit + 1)
        items = await queries.details(database, rows)
    return page(zip(rows, items, strict=True), paging.limit, cursor_of=lambda row: (row.uav_id,))


@router.get("/drones/{uav_id}", response_model=Drone, responses=documented(NotFound))
async def read_drone(
    request: Request, uav_id: Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=40)]
) -> Response:
    """A drone."""
    async with context_of(request).database.read() as database:
        row = await queries.find(database, uav_id)
        if row is None:
            raise NotFound(f"No drone {uav_id} is registered.")
        (item,) = await queries.details(database, [row])
    return resource(request, item)
