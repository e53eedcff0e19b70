"""Attempts to sign in: so many a minute from one address, those that fail are in the audit log."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from typing import Final

from fastapi import Request

from backend import audit
from backend.context import context_of
from backend.errors import Problem, TooManyRequests

WINDOW_MS: Final = 60_000
MAX_ADDRESSES: Final = 10_000


class Attempts:
    """Counts attempts by address, in this process, in windows of a minute."""

    def __init__(self, per_minute: int) -> None:
        self._per_minute = per_minute
        self._began_ms = 0
        self._counts: dict[str, int] = {}

    def count(self, address: str, now_ms: int) -> None:
        """Raises `TooManyRequests`."""
        if not 0 <= now_ms - self._began_ms < WINDOW_MS or len(self._counts) >= MAX_ADDRESSES:
            self._began_ms = now_ms
            self._counts = {}
        self._counts[address] = self._counts.get(address, 0) + 1
        if self._counts[address] > self._per_minute:
            wait_s = max(1, (self._began_ms + WINDOW_MS - now_ms) // 1000)
            raise TooManyRequests(
                f"Too many attempts to sign in from your address; try again in {wait_s} s.",
                headers={"Retry-After": str(wait_s)},
            )


async def counted(request: Request) -> None:
    """A dependency of every way to sign in. Raises `TooManyRequests`."""
    context = context_of(request)
    context.attempts.count(address_of(request), context.clock())


def address_of(request: Request) -> str:
    """Where a request comes from, as the nearest proxy that is trusted says."""
    return request.client.host if request.client is not None else ""


@contextlib.asynccontextmanager
async def failures_audited(request: Request, way: str) -> AsyncIterator[None]:
    """What is refused within goes to the audit log."""
    try:
        yield
    except Problem as refused:
        context = context_of(request)
        detail = {"why": refused.code, "address": address_of(request)}
        async with context.database.write() as connection:
            await audit.record(connection, "", "sign_in_failed", way, detail, t_ms=context.clock())
        raise
