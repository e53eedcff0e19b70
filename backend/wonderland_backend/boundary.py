"""What holds for every request before any endpoint sees it: host, origin, size, headers of the answer.

Plain ASGI, so that nothing is buffered.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from urllib.parse import SplitResult, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from wonderland.problems import SaidError, said
from wonderland_backend.clients.certificates import EXTENSION, Peer
from wonderland_backend.errors import ForeignOrigin, Problem, TooLarge, UnknownHost, problem_response

POLICY: Final = (
    "default-src 'none'; script-src 'self'; object-src 'none'; "
    # MapLibre positions its markers and popups by style attributes.
    "style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; worker-src 'self' blob:; child-src blob:; "
    "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final[Mapping[str, str]] = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "X-Frame-Options": "DENY",
}
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})


class Boundary:
    """Refuses foreign hosts (DNS rebinding), foreign origins (cross-site requests) and bodies that are too large."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        allowed_hosts: frozenset[str],
        max_body_bytes: int,
        https: bool,
        larger: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """`larger`: beginnings of paths that take larger bodies, and how large."""
        self._app = app
        self._hosts = allowed_hosts
        self._max_body_bytes = max_body_bytes
        self._larger = larger
        self._https = https
        self._headers = dict(HEADERS)
        if https:
            self._headers["Strict-Transport-Security"] = "max-age=31536000; includeSubDomains"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        if scope.get("method") == "HEAD":
            # The server sends no body for it, whatever an endpoint gives.
            scope.setdefault("state", {})["is_head"] = True
            scope = {**scope, "method": "GET"}
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers)
        if scope["type"] == "websocket":
            if refusal is not None:
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": refusal.code})
                return
            await self._app(scope, receive, send)
            return
        sending = self._with_headers(send, scope["path"])
        limit = self._limit(scope["path"])
        if refusal is None and _declared(headers) > limit:
            refusal = TooLarge(said("body_too_large", limit=limit))
        if refusal is not None:
            await problem_response(scope, refusal)(scope, receive, sending)
            return
        await self._limited(scope, receive, sending, limit)

    async def _limited(self, scope: Scope, receive: Receive, send: Send, limit: int) -> None:
        received = 0

        async def counting() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                # The framework passes this kind on, whoever it was that read the body.
                raise HTTPException(413) from SaidError(said("body_too_large", limit=limit))
            return message

        await self._app(scope, counting, send)

    def _refusal(self, scope: Scope, headers: Headers) -> Problem | None:
        host = headers.get("host", "")
        peer: Peer | None = scope.get("extensions", {}).get(EXTENSION)
        # Agents' own listener may have a name of its own; no browser has a certificate for it.
        for_agents = peer is not None and peer.for_agents
        # Of two, whoever stands in front may have looked at the other one (RFC 9112, 3.2).
        is_one = len(headers.getlist("host")) == 1
        if self._hosts and not for_agents and not (is_one and _name(host) in self._hosts):
            return UnknownHost(UnknownHost.example)
        origin = headers.get("origin")
        guarded = scope["type"] == "websocket" or scope["method"] not in SAFE
        if origin is not None and guarded and not self._is_own(urlsplit(origin), host):
            return ForeignOrigin(ForeignOrigin.example)
        return None

    def _is_own(self, origin: SplitResult, host: str) -> bool:
        # A page that came without encryption may be somebody else's, whatever name it bears.
        return origin.netloc.lower() == host.lower() and (origin.scheme == "https" or not self._https)

    def _limit(self, path: str) -> int:
        return next((limit for start, limit in self._larger.items() if path.startswith(start)), self._max_body_bytes)

    def _with_headers(self, send: Send, path: str) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers.setdefault(name, value)
                if path.startswith("/api/"):
                    # What an endpoint does not allow to be kept, problems above all, is not.
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        return sending


def _declared(headers: Headers) -> int:
    value = headers.get("content-length", "0")
    return int(value) if value.isdecimal() and len(value) < 20 else 0


def _name(host: str) -> str:
    """A Host header without its port, in lower case."""
    if host.startswith("["):
        return host[: host.find("]") + 1].lower()
    return host.partition(":")[0].lower()
