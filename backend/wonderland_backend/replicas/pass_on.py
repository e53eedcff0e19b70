"""Between a follower's boundary and its endpoints: what changes something is passed on to the backend on duty.

What only reads is answered here, unless an endpoint names a part that only the one on duty has (`Elsewhere`).
"""

from __future__ import annotations

from typing import Final, Protocol

from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from wonderland.problems import SaidError, said
from wonderland_backend.access import person_of
from wonderland_backend.errors import Elsewhere, OutcomeUnknown, Problem, Standby, TooLarge, problem_response
from wonderland_backend.problem_texts import STANDBY
from wonderland_backend.replicas.asgi import request_of
from wonderland_backend.replicas.messages import Answer, Request, UnansweredError

SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
STRANGERS_BYTES: Final = 64 * 1024
HERE: Final = "/api/v1/live"
"""The WebSocket that every backend serves."""
NOT_HERE: Final = {"Retry-After": "2", "Cache-Control": "no-store"}
_TRY_LATER: Final = 1013


class PassesOn(Protocol):
    """A follower."""

    async def pass_on(self, request: Request) -> Answer:
        """Raises `UnansweredError`."""


class PassOn:
    """ASGI. Of a backend on duty it does nothing."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        follower: PassesOn | None = getattr(scope["app"].state, "follower", None) if "app" in scope else None
        if follower is None or scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            if scope["path"] == HERE:
                await self._app(scope, receive, send)
            else:
                await _refuse_socket(scope, receive, send)
        elif scope["method"] in SAFE:
            await self._read(follower, scope, receive, send)
        else:
            await _passed_on(follower, scope, receive, send)

    async def _read(self, follower: PassesOn, scope: Scope, receive: Receive, send: Send) -> None:
        begun = False

        async def sending(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self._app(scope, receive, sending)
        except Elsewhere:
            if begun:
                raise
            await _passed_on(follower, scope, receive, send)


async def _passed_on(follower: PassesOn, scope: Scope, receive: Receive, send: Send) -> None:
    try:
        body = await _body(scope, receive)
    except HTTPException as refused:  # the boundary's: too large
        detail = refused.__cause__.said if isinstance(refused.__cause__, SaidError) else TooLarge.example
        await problem_response(scope, TooLarge(detail))(scope, receive, send)
        return
    except ConnectionAbortedError:
        return
    except Problem as refused:
        await problem_response(scope, refused)(scope, receive, send)
        return
    try:
        answer = await follower.pass_on(request_of(scope, body))
    except (UnansweredError, ValueError) as cause:
        not_done = isinstance(cause, UnansweredError) and not cause.asked
        if not_done or scope["method"] in SAFE:
            unanswered: Problem = Standby(said("nobody_on_duty"), headers=NOT_HERE)
        else:
            unanswered = OutcomeUnknown(OutcomeUnknown.example)
        await problem_response(scope, unanswered)(scope, receive, send)
        return
    scope.setdefault("state", {})["audited"] = True  # where it was refused, it is written down there
    await send({"type": "http.response.start", "status": answer.status, "headers": answer.headers})
    await send({"type": "http.response.body", "body": answer.body})


async def _body(scope: Scope, receive: Receive) -> bytes:
    """All of it, since the bus carries it whole; what is long only of somebody who is known."""
    body = bytearray()
    is_known = False
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ConnectionAbortedError
        body.extend(message.get("body", b""))
        if len(body) > STRANGERS_BYTES and not is_known:
            await person_of(HTTPConnection(scope))
            is_known = True
        if not message.get("more_body", False):
            return bytes(body)


async def _refuse_socket(scope: Scope, receive: Receive, send: Send) -> None:
    """Agents go on to the one on duty: a server in front tries the next, where it is told so by an answer to HTTP."""
    await receive()
    if "websocket.http.response" in scope.get("extensions", {}):
        headers = [(name.lower().encode(), value.encode()) for name, value in NOT_HERE.items()]
        await send({"type": "websocket.http.response.start", "status": 503, "headers": headers})
        await send({"type": "websocket.http.response.body", "body": STANDBY.encode()})
    else:
        await send({"type": "websocket.close", "code": _TRY_LATER, "reason": STANDBY})
