"""Writes that may be sent twice: the same Idempotency-Key gets the first one's answer (draft-ietf-httpapi)."""

from __future__ import annotations

import hashlib
from collections.abc import Awaitable, Callable
from typing import Any, Final

from fastapi import Request
from fastapi.responses import Response
from sqlalchemy import delete, insert, update
from sqlalchemy.exc import IntegrityError

from backend.auth.person import Person
from backend.context import Context, context_of
from backend.db.tables.clients import IdempotencyRow
from backend.errors import BadRequest, Conflict, Unprocessable

HEADER: Final = "Idempotency-Key"
REPLAYED: Final = "Idempotency-Replayed"
MAX_KEY: Final = 128
KEPT_MS: Final = 86_400_000
BAD_KEY: Final = BadRequest(f"{HEADER} is a printable text of at most {MAX_KEY} characters.")
BUSY: Final = Conflict("The first request with this key is under way; ask again in a moment.")
PARAMETER: Final[dict[str, Any]] = {
    "name": HEADER,
    "in": "header",
    "required": False,
    "description": "The same key with the same request gets the same answer for a day, and nothing is done twice.",
    "schema": {"type": "string", "minLength": 1, "maxLength": MAX_KEY},
    "example": "8e03978e-40d5-43dd-bc93-6894a57f9324",
}


async def once(request: Request, person: Person, write: Callable[[], Awaitable[Response]]) -> Response:
    """What `write` answers; for a request that was sent before, what was answered then.

    Raises `BadRequest` for a bad key, `Unprocessable` for a key of another request, `Conflict` while the first one
    is under way. A write that fails leaves no trace, so that it can be tried again.
    """
    key = request.headers.get(HEADER)
    if key is None:
        return await write()
    if not 0 < len(key) <= MAX_KEY or not key.isprintable():
        raise BadRequest(BAD_KEY.detail)
    context = context_of(request)
    place = {"principal": person.person_id, "key": key}
    digest = hashlib.sha256(
        b"\0".join((request.method.encode(), request.url.path.encode(), await request.body()))
    ).hexdigest()
    known = await _begin(context, place, digest)
    if known is not None:
        return _answered(known, digest)
    try:
        response = await write()
    except BaseException:
        async with context.database.write() as connection:
            await connection.execute(delete(IdempotencyRow).filter_by(**place))
        raise
    values = {
        "status": response.status_code,
        "location": response.headers.get("location"),
        "body": bytes(response.body).decode(),
    }
    async with context.database.write() as connection:
        await connection.execute(update(IdempotencyRow).filter_by(**place).values(**values))
    return response


async def _begin(context: Context, place: dict[str, str], digest: str) -> IdempotencyRow | None:
    """None: it is the first. Otherwise what is known of the first."""
    now = context.clock()
    row = {**place, "request_sha256": digest, "created_ms": now, "status": None, "location": None, "body": None}
    try:
        async with context.database.write() as connection:
            await connection.execute(delete(IdempotencyRow).where(IdempotencyRow.created_ms < now - KEPT_MS))
            await connection.execute(insert(IdempotencyRow), [row])
    except IntegrityError:
        async with context.database.read() as session:
            known = await session.get(IdempotencyRow, (place["principal"], place["key"]))
        return known or IdempotencyRow(**row)
    return None


def _answered(known: IdempotencyRow, digest: str) -> Response:
    if known.request_sha256 != digest:
        raise Unprocessable(f"This {HEADER} was used for another request; take a new one.")
    if known.status is None:
        raise Conflict(BUSY.detail)
    headers = {REPLAYED: "true", "Cache-Control": "private, no-store"}
    if known.location is not None:
        headers["Location"] = known.location
    return Response(known.body or "", known.status, headers, "application/json" if known.body else None)
