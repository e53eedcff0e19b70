"""A request that another backend was asked, done by this one's application: in its process, without a socket."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Final

from starlette.types import ASGIApp, Message, Scope

from wonderland_backend.clients.certificates import EXTENSION, Peer
from wonderland_backend.replicas.messages import Answer, Request

logger = logging.getLogger(__name__)

LONGEST_S: Final = 30.0
MAX_ANSWER_BYTES: Final = 32 << 20


class TooLongError(Exception):
    """The answer is longer than the bus carries."""


def request_of(scope: Scope, body: bytes) -> Request:
    """What is asked here, to be asked elsewhere."""
    peer: Peer | None = scope.get("extensions", {}).get(EXTENSION)
    return Request(
        method=scope["method"],
        path=scope["path"],
        raw_path=scope.get("raw_path") or scope["path"].encode(),
        query=scope["query_string"],
        headers=list(scope["headers"]),
        body=body,
        scheme=scope.get("scheme", "http"),
        server=scope.get("server"),
        client=scope.get("client"),
        peer_address="" if peer is None else peer.address,
        peer_certificate=None if peer is None else peer.certificate,
        peer_encrypted=peer is not None and peer.encrypted,
    )


def _scope_of(request: Request) -> dict[str, Any]:
    peer = Peer(request.peer_address, request.peer_certificate, encrypted=request.peer_encrypted)
    return {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "1.1",
        "method": request.method,
        "scheme": request.scheme,
        "path": request.path,
        "raw_path": request.raw_path,
        "root_path": "",
        "query_string": request.query,
        "headers": request.headers,
        "client": request.client,
        "server": request.server,
        "state": {},
        "extensions": {EXTENSION: peer},
    }


async def done_by(app: ASGIApp, request: Request) -> Answer:
    """The application's answer. Raises `TimeoutError`, `TooLongError`."""
    status = 0
    headers: list[tuple[bytes, bytes]] = []
    body = bytearray()
    asked = False

    async def receive() -> Message:
        nonlocal asked
        if not asked:
            asked = True
            return {"type": "http.request", "body": request.body, "more_body": False}
        await asyncio.Event().wait()  # whoever asked is still there
        raise AssertionError

    async def send(message: Message) -> None:
        nonlocal status, headers
        if message["type"] == "http.response.start":
            status, headers = message["status"], list(message.get("headers", ()))
        elif message["type"] == "http.response.body":
            body.extend(message.get("body", b""))
            if len(body) > MAX_ANSWER_BYTES:
                raise TooLongError

    try:
        async with asyncio.timeout(LONGEST_S):
            await app(_scope_of(request), receive, send)
    except (TimeoutError, TooLongError):
        raise
    except Exception:
        if not status:
            raise
        logger.exception("%s %s failed", request.method, request.path)  # the answer says 500
    return Answer(status, headers, bytes(body))
