"""What was asked of a browser until it answers: kept in the database, so that any replica can take the answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import orjson
from sqlalchemy import delete, insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import said
from wonderland_backend.auth.secret import MAX_SECRET, new_secret, sha256
from wonderland_backend.db.tables.people import CeremonyRow
from wonderland_backend.errors import BadRequest

LIFE_MS: Final = 10 * 60_000


class CeremonyOver(BadRequest):
    """It was answered before, took too long, or never began."""

    code = "ceremony-over"
    example = said("ceremony_over")


async def begin(
    connection: AsyncConnection, kind: str, content: dict[str, Any], *, now_ms: int, randomness: Callable[[int], bytes]
) -> str:
    """Keep what the answer will be checked against; what the browser has to bring back with it."""
    secret = new_secret(randomness)
    await connection.execute(delete(CeremonyRow).where(CeremonyRow.expires_ms < now_ms))
    row = {
        "ceremony_sha256": sha256(secret),
        "kind": kind,
        "content": orjson.dumps(content).decode(),
        "expires_ms": now_ms + LIFE_MS,
    }
    await connection.execute(insert(CeremonyRow), [row])
    return secret


async def finish(connection: AsyncConnection, kind: str, secret: str, now_ms: int) -> dict[str, Any] | None:
    """What was kept; None when it is over, or never began. Either way it is over now, once this is committed."""
    digest = sha256(secret[: MAX_SECRET + 1])
    found = await connection.execute(
        select(CeremonyRow.content).where(
            CeremonyRow.ceremony_sha256 == digest, CeremonyRow.kind == kind, CeremonyRow.expires_ms > now_ms
        )
    )
    content = found.scalar_one_or_none()
    gone = await connection.execute(delete(CeremonyRow).where(CeremonyRow.ceremony_sha256 == digest))
    if content is None or gone.rowcount != 1:
        return None
    return dict(orjson.loads(content))
