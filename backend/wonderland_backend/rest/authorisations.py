"""Authorisations by REST."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from wonderland_backend.access import SignedInPerson
from wonderland_backend.authorisations import queries
from wonderland_backend.authorisations.schemas import AuthorisationPage, AuthorisationQuery
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, documented
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.responses import page, record

router = APIRouter(tags=["authorisations"])


@router.get(
    "/authorisations", response_model=AuthorisationPage, responses=documented(BadRequest, OPERATORS_MASKED, etag=True)
)
async def list_authorisations(
    request: Request, context: ContextDep, filters: Annotated[AuthorisationQuery, Query()], person: SignedInPerson
) -> Response:
    """Authorisations by drone, past and future ones included."""
    async with context.database.read() as database:
        rows = await queries.listing(database, filters, person.scope, after=filters.after_place(str, str))
    return page(
        request,
        ((row, record(row.record)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.uav_id, row.authorisation_id),
    )
