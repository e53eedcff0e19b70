"""The search by REST."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from backend.auth.access import SIGNED_IN, SignedInPerson
from backend.context import context_of
from backend.errors import documented
from backend.responses import Json
from backend.search import queries
from backend.search.schemas import Hits, SearchFor

router = APIRouter(tags=["search"], dependencies=SIGNED_IN)


@router.get("/search", response_model=Hits, responses=documented())
async def search(request: Request, person: SignedInPerson, wanted: SearchFor) -> Response:
    """Pads and drones by any part of a name, sessions and transactions by the beginning of their ids, blocks."""
    async with context_of(request).database.read() as database:
        items = await queries.search(database, person, wanted.q, wanted.limit)
    return Json({"items": items}, headers={"Cache-Control": "private, no-store"})
