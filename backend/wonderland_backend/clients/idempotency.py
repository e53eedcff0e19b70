"""Writes that may be sent twice: the same Idempotency-Key gets the first one's answer (draft-ietf-httpapi).

Answers may hold secrets that are shown once, so they are kept encrypted by the key itself, of which a hash is kept.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Awaitable, Callable
from typing import Any, Final

from cryptography.fernet import Fernet
from fastapi import Request
from fastapi.responses import Response
from sqlalchemy.exc import IntegrityError

from wonderland.problems import said
from wonderland_backend.clients import store
from wonderland_backend.context import Context, required
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.clients import IdempotencyRow
from wonderland_backend.errors import BadRequest, Conflict, Unprocessable
from wonderland_backend.person import Person

HEADER: Final = "Idempotency-Key"
REPLAYED: Final = "Idempotency-Replayed"
MAX_KEY: Final = 128
KEPT_MS: Final = 86_400_000
LEASE_MS: Final = 120_000
"""So long the first request may be under way; after that its server is held to have stopped, and the key is free."""
BAD_KEY: Final = BadRequest(said("bad_idempotency_key", header=HEADER, most=MAX_KEY))
BUSY: Final = Conflict(said("first_request_under_way"))
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
        raise BadRequest(BAD_KEY.said)
    context = required(request, Context)
    database, now = context.database, context.clock()
    place = {"principal": person.person_id, "key": _digest(b"key", key.encode()).hex()}
    digest = _digest(request.method.encode(), request.url.path.encode(), await request.body()).hex()
    cipher = Fernet(base64.urlsafe_b64encode(_digest(b"answer", person.person_id.encode(), key.encode())))
    known = await _begin(database, place, digest, now)
    if known is not None:
        return _answered(known, digest, cipher)
    ours = {**place, "created_ms": now}
    try:
        response = await write()
    except BaseException:
        async with database.write() as connection:
            await store.forget_request(connection, ours)
        raise
    values = {
        "status": response.status_code,
        "location": response.headers.get("location"),
        "body": cipher.encrypt(bytes(response.body)).decode(),
    }
    async with database.write() as connection:
        await store.keep_answer(connection, ours, values)
    return response


async def _begin(database: Database, place: dict[str, str], digest: str, now: int) -> IdempotencyRow | None:
    """None: it is the first, or the first one's lease is over. Otherwise what is known of the first."""
    row = {**place, "request_sha256": digest, "created_ms": now, "status": None, "location": None, "body": None}
    try:
        async with database.write() as connection:
            await store.begin_request(connection, row, kept_ms=KEPT_MS, lease_ms=LEASE_MS)
    except IntegrityError:
        async with database.read() as session:
            known = await session.get(IdempotencyRow, (place["principal"], place["key"]))
        return known or IdempotencyRow(**row)
    return None


def _answered(known: IdempotencyRow, digest: str, cipher: Fernet) -> Response:
    if known.request_sha256 != digest:
        raise Unprocessable(said("idempotency_key_reused", header=HEADER))
    if known.status is None:
        raise Conflict(BUSY.said)
    headers = {REPLAYED: "true", "Cache-Control": "private, no-store"}
    if known.location is not None:
        headers["Location"] = known.location
    body = cipher.decrypt(known.body or "")
    return Response(body, known.status, headers, "application/json" if body else None)


def _digest(*parts: bytes) -> bytes:
    return hashlib.sha256(b"\0".join(parts)).digest()
