"""Attempts to sign in: so many a minute from one address, those that fail are in the audit log."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

from fastapi import Request

from wonderland_backend import audit
from wonderland_backend.auth.attempts import AttemptsDep
from wonderland_backend.context import Context, ContextDep, required
from wonderland_backend.errors import Problem


async def counted(request: Request, attempts: AttemptsDep, context: ContextDep) -> None:
    """A dependency of every way to sign in. Raises `TooManyRequests`."""
    attempts.count(address_of(request), context.clock())


def address_of(request: Request) -> str:
    """Where a request comes from, as the nearest proxy that is trusted says."""
    return request.client.host if request.client is not None else ""


@contextlib.asynccontextmanager
async def failures_audited(request: Request, way: str) -> AsyncIterator[None]:
    """What is refused within goes to the audit log."""
    try:
        yield
    except Problem as refused:
        context = required(request, Context)
        detail = {"why": refused.code, "address": address_of(request)}
        async with context.database.write() as connection:
            await audit.record(connection, "", "sign_in_failed", way, detail, t_ms=context.clock())
        request.state.audited = True
        raise
