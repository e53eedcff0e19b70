"""Authorisations by REST."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from pydantic import Field
from sqlalchemy import or_, select, tuple_

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.access import SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.db.tables.ledger import AuthorisationRow
from wonderland_backend.drones.schemas import Authorisation
from wonderland_backend.errors import BadRequest, documented
from wonderland_backend.filters import PageQuery
from wonderland_backend.narrowing import drones_of, field
from wonderland_backend.responses import page, record
from wonderland_backend.schemas import page_of

router = APIRouter(tags=["authorisations"])
_ID = f"^{ID_PATTERN}$"
AuthorisationPage = page_of("AuthorisationPage", Authorisation)


class AuthorisationQuery(PageQuery):
    """Which authorisations."""

    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only of this drone")
    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator's drones")
    pad: str | None = Field(
        default=None, pattern=_ID, max_length=64, description="Only for this pad; those for every pad count"
    )
    revoked: bool | None = Field(default=None, description="Only revoked ones, or only those that are not")


@router.get("/authorisations", response_model=AuthorisationPage, responses=documented(BadRequest, etag=True))
async def list_authorisations(
    request: Request, context: ContextDep, filters: Annotated[AuthorisationQuery, Query()], person: SignedInPerson
) -> Response:
    """Authorisations by drone, past and future ones included."""
    query = (
        select(AuthorisationRow)
        .order_by(AuthorisationRow.uav_id, AuthorisationRow.authorisation_id)
        .limit(filters.limit + 1)
    )
    query = person.scope.narrow(query, drone=AuthorisationRow.uav_id)
    if (after := filters.after_place(str, str)) is not None:
        query = query.where(tuple_(AuthorisationRow.uav_id, AuthorisationRow.authorisation_id) > after)
    if filters.drone is not None:
        query = query.where(AuthorisationRow.uav_id == filters.drone)
    if filters.operator is not None:
        query = query.where(AuthorisationRow.uav_id.in_(drones_of(filters.operator)))
    if filters.pad is not None:
        named = (field("pad_id", pad) for pad in (filters.pad, "*"))
        query = query.where(or_(*(AuthorisationRow.record.contains(each, autoescape=True) for each in named)))
    if filters.revoked is not None:
        state = "true" if filters.revoked else "false"
        query = query.where(AuthorisationRow.record.contains(f'"revoked":{state}'))
    async with context.database.read() as database:
        rows = (await database.scalars(query)).all()
    return page(
        request,
        ((row, record(row.record)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.uav_id, row.authorisation_id),
    )
