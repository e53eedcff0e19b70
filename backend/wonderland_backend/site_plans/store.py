"""Site plans in the database."""

from __future__ import annotations

import hashlib
from typing import Final

from sqlalchemy import func, insert, select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.problems import SaidError, said
from wonderland.site_plans import parse
from wonderland_backend.db.tables.site_plans import SitePlanRow

MOST_PLANS: Final = 100
"""Of one pad. Whoever needs more changes a plan every day; what the ledger names is never thrown away."""


class TooManyPlansError(SaidError):
    """A pad has as many plans as are kept."""


async def keep(connection: AsyncConnection, pad_id: str, body: bytes, now_ms: int) -> tuple[str, bool]:
    """Keep a plan; its SHA-256, and whether it is new. Raises SitePlanError, TooManyPlansError."""
    parse(body)
    sha256 = hashlib.sha256(body).hexdigest()
    of_pad = SitePlanRow.pad_id == pad_id
    if await connection.scalar(select(SitePlanRow.sha256).where(of_pad, SitePlanRow.sha256 == sha256)) is not None:
        return sha256, False
    count = await connection.scalar(select(func.count()).select_from(SitePlanRow).where(of_pad)) or 0
    if count >= MOST_PLANS:
        raise TooManyPlansError(said("too_many_site_plans", pad_id=pad_id, count=count))
    row = {"pad_id": pad_id, "sha256": sha256, "stored_ms": now_ms, "body": body}
    await connection.execute(insert(SitePlanRow), [row])
    return sha256, True


async def find_site_plan(database: AsyncSession, pad_id: str, sha256: str) -> bytes | None:
    """A kept plan's bytes, by its pad and SHA-256."""
    row = await database.get(SitePlanRow, (pad_id, sha256))
    return None if row is None else row.body
