"""What was refused to whom, in the audit log: with limits, so that nobody fills it by asking."""

from __future__ import annotations

import logging
from typing import Final

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from wonderland_backend.audit.store import record
from wonderland_backend.context import Context, part_of
from wonderland_backend.person import Person

logger = logging.getLogger(__name__)

HOUR_MS: Final = 3_600_000
MINUTE_MS: Final = 60_000
EACH_HOUR: Final = 60
"""Rows of one person, machine or address in an hour."""
STRANGERS_HOUR: Final = 3_000
"""Rows of all addresses in an hour: many of them hide no refusal of somebody who is signed in."""
_STATUSES: Final = frozenset({401, 403, 429})
_INPUT: Final = frozenset({413, 422})
"""What somebody sent: counted apart, so that a form filled in wrongly hides no refusal."""
_QUESTION: Final = ("GET", "/api/v1/session")
"""Every page asks whether somebody is signed in; no is an answer."""


class Quota:
    """Rows that may be written: one a minute for the same, so many an hour for each and for all."""

    def __init__(self) -> None:
        self._began_ms = 0
        self._counts: dict[str, int] = {}
        self._strangers = 0
        self._last_ms: dict[tuple[str, str], int] = {}
        self._left_out = 0

    def take(self, who: str, subject: str, now_ms: int, *, known: bool) -> int | None:
        """How many were left out since the last row; None where this one is left out, too.

        `known`: `who` is a person or a machine, not an address.
        """
        if not 0 <= now_ms - self._began_ms < HOUR_MS:
            self._began_ms, self._counts, self._last_ms, self._strangers = now_ms, {}, {}, 0
        count = self._counts.get(who, 0)
        again = now_ms - self._last_ms.get((who, subject), -MINUTE_MS) < MINUTE_MS
        if again or count >= EACH_HOUR or (not known and self._strangers >= STRANGERS_HOUR):
            self._left_out += 1
            return None
        self._strangers += not known
        self._counts[who] = count + 1
        self._last_ms[who, subject] = now_ms
        left_out, self._left_out = self._left_out, 0
        return left_out


class RefusalLog:
    """ASGI: writes down such answers before they are given, and WebSockets that were not let in."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._quota = Quota()
        self._input = Quota()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in {"http", "websocket"} or (scope.get("method"), scope["path"]) == _QUESTION:
            await self._app(scope, receive, send)
            return
        accepted = False

        async def watch(message: Message) -> None:
            nonlocal accepted
            kind = message["type"]
            accepted = accepted or kind == "websocket.accept"
            if kind.endswith("http.response.start") and message["status"] in _STATUSES | _INPUT:
                await self._write(HTTPConnection(scope), message["status"])
            elif kind == "websocket.close" and not accepted:
                await self._write(HTTPConnection(scope), 403)
            await send(message)

        await self._app(scope, receive, watch)

    async def _write(self, connection: HTTPConnection, status: int) -> None:
        context = part_of(connection, Context)
        if context is None or getattr(connection.state, "audited", False):
            return
        person: Person | None = getattr(connection.state, "person", None)
        address = connection.client.host if connection.client is not None else ""
        subject = f"{connection.scope.get('method', 'WebSocket')}{connection.scope['path']}"
        now_ms = context.clock()
        who = person.person_id if person else address
        quota = self._input if status in _INPUT else self._quota
        left_out = quota.take(who, subject, now_ms, known=person is not None)
        if left_out is None:
            return
        detail = {"status": status, "address": address} | ({"left_out": left_out} if left_out else {})
        try:
            async with context.database.write() as database:
                await record(database, person or "", "refused", subject, detail, t_ms=now_ms)
        except Exception:
            logger.exception("a refusal could not be written to the audit log")
