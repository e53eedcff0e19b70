"""The live WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
import re
from http import HTTPStatus
from typing import Final

from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect, WebSocketState

from wonderland_backend.auth.store.sign_ins import SignInsDep
from wonderland_backend.clients.machines import MachinesDep
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import Problem
from wonderland_backend.live.hub import SIGNED_OUT, Client, HubDep
from wonderland_backend.live.lens import Lens
from wonderland_backend.person import Person

router = APIRouter()
_SINCE: Final = re.compile(r"([0-9a-f]{16}):(\d{1,15})")
_CLOSE_S: Final = 5.0
FORBIDDEN: Final = 4403
MAX_REASON: Final = 120
"""Of a close frame's reason; the protocol has room for 123 bytes."""


@router.websocket("/live")
async def live(
    socket: WebSocket, context: ContextDep, hub: HubDep, sign_ins: SignInsDep, machines: MachinesDep
) -> None:
    """Push what happens to a signed-in browser or a machine; see docs/seams.md, "Backend to browser: live"."""
    refused: tuple[int, str] | None = None
    person: Person | None = None
    if "authorization" in socket.headers:
        try:
            person = await machines.person_of_live(socket)
        except Problem as problem:
            refused = FORBIDDEN if problem.status == HTTPStatus.FORBIDDEN else SIGNED_OUT, str(problem)[:MAX_REASON]
    else:
        person = await sign_ins.person_of_cookie(socket.cookies.get(context.cookie_name))
    await socket.accept()
    if person is None:
        # Closed after accepting: a browser is not told why a handshake was refused.
        await socket.close(*(refused or (SIGNED_OUT, "sign in first")))
        return
    found = _SINCE.fullmatch(socket.query_params.get("since", "")[:64])
    lens = Lens.of(person, pad_owner=hub.pad_owner, drone_owner=hub.drone_owner)
    client = hub.join(
        person.cookie_sha256 or f"{person.person_id}:{'+'.join(person.roles)}:{person.expires_ms}",
        (found[1], int(found[2])) if found else None,
        lens,
        takes_packed=socket.query_params.get("packed") == "zlib",
    )
    sender = asyncio.create_task(_send(socket, client), name="live-sender")
    listener = asyncio.create_task(_listen(socket), name="live-listener")
    closing = asyncio.create_task(client.closing.wait(), name="live-closing")
    tasks = (sender, listener, closing)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.leave(client)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await _close(socket, client)


async def _send(socket: WebSocket, client: Client) -> None:
    """At the client's own pace: each send waits until the socket's buffer has room."""
    while (following := await client.next_frame()) is not None:
        await _send_one(socket, following)


async def _send_one(socket: WebSocket, frame: str | bytes) -> None:
    if isinstance(frame, bytes):
        await socket.send_bytes(frame)
    else:
        await socket.send_text(frame)


async def _listen(socket: WebSocket) -> None:
    """Clients have nothing to say; what they send is ignored, and their going away noticed."""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return


async def _close(socket: WebSocket, client: Client) -> None:
    if socket.client_state is not WebSocketState.CONNECTED or socket.application_state is not WebSocketState.CONNECTED:
        return
    # A client that reads nothing would keep even the close frame waiting.
    with contextlib.suppress(asyncio.TimeoutError, RuntimeError, WebSocketDisconnect, OSError):
        async with asyncio.timeout(_CLOSE_S):
            await socket.close(client.close_code or 1000)
