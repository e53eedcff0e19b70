"""Headers that dependencies want on the answer, whatever it becomes: an endpoint's, or a problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

STATE: Final = "answer_headers"


def add_headers(scope: Scope, headers: Mapping[str, str]) -> None:
    """Have the answer to this request carry these."""
    scope.setdefault("state", {}).setdefault(STATE, {}).update(headers)


class AnswerHeaders:
    """ASGI: writes them. A header that the answer has already, such as a Link, stays beside it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        wanted = scope.setdefault("state", {}).setdefault(STATE, {})

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in wanted.items():
                    headers.append(name, value)
            await send(message)

        await self._app(scope, receive, sending)
