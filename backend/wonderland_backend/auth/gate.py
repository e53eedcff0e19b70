"""Until the first administrator has set the server up, nothing is to be had from it but that."""

from __future__ import annotations

from typing import Final

from starlette.routing import Match
from starlette.types import ASGIApp, Receive, Scope, Send

from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.errors import SetUpRequired, problem_response

DESCRIPTIONS: Final = ("/api/v1/openapi.json", "/api/v1/asyncapi.json", "/api/v1/problems")
OPEN: Final = ("/api/v1/health", "/api/v1/sign-in", *DESCRIPTIONS)
"""What is answered all the same: by itself, and what is below it."""
CONSOLE: Final = frozenset({"/", "/{path:path}"})
"""Its routes: a page and its files, the same for everybody."""
TRY_LATER: Final = 1013


class SetUpGate:
    """ASGI: refuses with 403 (a WebSocket: 1013) while nobody can sign in."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in {"http", "websocket"} or _is_open(scope):
            await self._app(scope, receive, send)
            return
        parts = getattr(scope["app"].state, "parts", None)
        if parts is None:  # routes alone: there is nothing behind them that could be told
            await self._app(scope, receive, send)
            return
        sign_ins: SignIns = parts[SignIns]  # a backend without them opens nothing
        if await sign_ins.is_set_up():
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            scope.setdefault("state", {})["audited"] = True  # there is nobody yet who could read of it
            answer = problem_response(scope, SetUpRequired(SetUpRequired.example))
            await answer(scope, receive, send)
        else:
            await receive()
            await send({"type": "websocket.accept"})
            await send({"type": "websocket.close", "code": TRY_LATER, "reason": str(SetUpRequired.example)})


def _is_open(scope: Scope) -> bool:
    if any(scope["path"] == place or scope["path"].startswith(f"{place}/") for place in OPEN):
        return True
    matching = (route for route in scope["app"].router.routes if route.matches(scope)[0] is not Match.NONE)
    return getattr(next(matching, None), "path", "") in CONSOLE
