"""Reading authorisations from the database."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import or_, select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.authorisations.schemas import AuthorisationQuery
from wonderland_backend.db.tables.ledger import AuthorisationRow
from wonderland_backend.narrowing import drones_of, field
from wonderland_backend.person import Scope


async def listing(
    database: AsyncSession, filters: AuthorisationQuery, scope: Scope, *, after: tuple[str, str] | None
) -> Sequence[AuthorisationRow]:
    """Authorisations by drone, one more than `filters.limit`; `after` is the last one of the page before."""
    query = (
        select(AuthorisationRow)
        .order_by(AuthorisationRow.uav_id, AuthorisationRow.authorisation_id)
        .limit(filters.limit + 1)
    )
    query = scope.narrow(query, drone=AuthorisationRow.uav_id)
    if after is not None:
        query = query.where(tuple_(AuthorisationRow.uav_id, AuthorisationRow.authorisation_id) > after)
    if filters.drone is not None:
        query = query.where(AuthorisationRow.uav_id == filters.drone)
    if filters.operator is not None:
        query = query.where(AuthorisationRow.uav_id.in_(drones_of(filters.operator, scope)))
    if filters.pad is not None:
        named = (field("pad_id", pad) for pad in (filters.pad, "*"))
        query = query.where(or_(*(AuthorisationRow.record.contains(each, autoescape=True) for each in named)))
    if filters.revoked is not None:
        state = "true" if filters.revoked else "false"
        query = query.where(AuthorisationRow.record.contains(f'"revoked":{state}'))
    return (await database.scalars(query)).all()
