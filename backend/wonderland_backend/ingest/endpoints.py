"""The agents' WebSocket."""

from __future__ import annotations

from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from wonderland_backend.agents.connected import AgentsDep
from wonderland_backend.agents.errors import IngestError
from wonderland_backend.agents.members import Members, MembersDep, Seen
from wonderland_backend.clients.certificates import EXTENSION, Peer
from wonderland_backend.context import ContextDep
from wonderland_backend.ingest.intake import IntakeDep
from wonderland_backend.ingest.serving import Ingest
from wonderland_backend.settings import Settings

router = APIRouter()


@router.websocket("/ingest")
async def ingest(
    socket: WebSocket, context: ContextDep, members: MembersDep, connected: AgentsDep, intake: IntakeDep
) -> None:
    """Take in what an agent reports."""
    await socket.accept()
    peer: Peer | None = socket.scope.get("extensions", {}).get(EXTENSION)
    coming_in = Ingest(context, members, connected, intake)
    await coming_in.serve(_WebSocket(socket), lambda: _seen(context.settings, members, peer))


def _seen(settings: Settings, members: Members, peer: Peer | None) -> Seen:
    """What the connection itself shows. Raises `IngestError`."""
    if settings.agents.listen is not None and not (peer is not None and peer.for_agents):
        raise IngestError("agents_listener", "agents have an address of their own here: agents.listen in its settings")
    end_points = members.end_points
    if peer is None or not peer.encrypted:
        return Seen(end_points.behind_proxies())
    if peer.for_agents:
        return Seen(frozenset({end_points.agents}), peer.certificate)
    return Seen(frozenset({end_points.everybody}))


class _WebSocket:
    """A WebSocket as a channel."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket

    async def receive(self) -> str | bytes:
        message = await self._socket.receive()
        if message["type"] == "websocket.disconnect":
            raise ConnectionResetError(f"closed with {message.get('code', 1005)}")
        text: str | None = message.get("text")
        return b"" if text is None else text

    async def send(self, text: str) -> None:
        try:
            await self._socket.send_text(text)
        except WebSocketDisconnect as cause:
            raise ConnectionResetError(f"closed with {cause.code}") from cause

    async def close(self, code: int = 1000, reason: str = "") -> None:
        try:
            await self._socket.close(code, reason)
        except WebSocketDisconnect as cause:
            raise ConnectionResetError(f"closed with {cause.code}") from cause
