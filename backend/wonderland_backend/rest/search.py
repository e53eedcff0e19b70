"""The search by REST."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response

from wonderland_backend import audit
from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import documented
from wonderland_backend.responses import Json
from wonderland_backend.search import queries
from wonderland_backend.search.schemas import Hits, SearchQuery

router = APIRouter(tags=["search"], dependencies=SIGNED_IN)


@router.post("/search", response_model=Hits, responses=documented())
async def search(context: ContextDep, person: SignedInPerson, wanted: SearchQuery) -> Response:
    """Pads, drones, broadcasts by any part of a name, sessions and transactions by the beginning of their ids, blocks.

    An operator's number that is masked is found by the whole of it only; that is audited as showing it is. What is
    looked for may be somebody's number, so it is sent in the body: addresses end up in logs.
    """
    async with context.database.read() as database:
        items = await queries.search(database, person, wanted.q, wanted.limit)
    revealed = [hit["id"] for hit in items if hit.pop(queries.REVEALED, False)]
    if revealed:
        async with context.database.write() as connection:
            for uav_id in revealed:
                detail = {"field": "registration", "reason": "found by the whole number"}
                await audit.record_read(
                    connection, person, f"drone/{uav_id}", detail, act="unmask", t_ms=context.clock()
                )
    return Json({"items": items}, headers={"Cache-Control": "private, no-store"})
