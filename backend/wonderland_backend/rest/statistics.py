"""Statistics by REST."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response

from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import documented
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.responses import Json
from wonderland_backend.statistics import queries
from wonderland_backend.statistics.schemas import Statistics, StatisticsFor

router = APIRouter(tags=["statistics"], dependencies=SIGNED_IN)


@router.get("/statistics", response_model=Statistics, responses=documented(OPERATORS_MASKED))
async def read_statistics(context: ContextDep, person: SignedInPerson, wanted: StatisticsFor) -> Response:
    """What the verdicts of a span come to, by time, pad, operator and action."""
    async with context.database.read() as database:
        found = await queries.statistics(database, wanted, person)
    return Json(found, headers={"Cache-Control": "private, no-store"})
