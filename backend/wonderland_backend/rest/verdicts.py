"""Verdicts by REST."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, documented
from wonderland_backend.filters import VerdictFilters
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.responses import page
from wonderland_backend.verdicts import queries
from wonderland_backend.verdicts.schemas import VerdictPage

router = APIRouter(tags=["verdicts"], dependencies=SIGNED_IN)


@router.get("/verdicts", response_model=VerdictPage, responses=documented(BadRequest, OPERATORS_MASKED, etag=True))
async def list_verdicts(
    request: Request, context: ContextDep, person: SignedInPerson, filters: VerdictFilters
) -> Response:
    """Verdicts, newest first. A block's verdicts appear all at once."""
    place = filters.after_place(int, int)
    async with context.database.read() as database:
        rows = await queries.listing(database, filters, person.scope, position=(place[0], place[1]) if place else None)
    return page(
        request,
        ((row, queries.verdict_json(row)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.block, row.tx_index),
    )
