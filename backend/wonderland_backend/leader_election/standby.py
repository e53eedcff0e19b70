"""Standing by: everybody is told to ask the leader, until this one is."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Final

import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from wonderland_backend.errors import DatabaseError, Standby, problem_response
from wonderland_backend.leader_election.lock import PROVE_EVERY_S, TRY_EVERY_S, Lock
from wonderland_backend.problem_texts import STANDBY

TRY_AGAIN_LATER: Final = 1013


async def stand_by(lock: Lock, bound: socket.socket, new_server: Callable[[ASGIApp], uvicorn.Server]) -> None:
    """Answer 503 until the lock is ours. Whoever connects while the answering ends waits for the one who follows."""
    server = new_server(_refuse)
    # The server closes what it listens on; the socket itself goes on to the leader.
    serving = asyncio.create_task(server.serve([bound.dup()]), name="standby")
    try:
        await wait_for(lock)
    finally:
        server.should_exit = True
        await serving


async def wait_for(lock: Lock) -> None:
    """Until the lock is ours."""
    while not await _taken(lock):  # noqa: ASYNC110 - it is another process that decides
        await asyncio.sleep(TRY_EVERY_S)


async def stay_leader(lock: Lock) -> None:
    """Returns never. Raises `DatabaseError` as soon as the lock is not ours any more."""
    while True:
        await asyncio.sleep(PROVE_EVERY_S)
        await lock.prove()


async def _taken(lock: Lock) -> bool:
    try:
        return await lock.take_lock()
    except DatabaseError:
        return False  # standing by is waiting, for the database as well


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    """ASGI."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": TRY_AGAIN_LATER, "reason": STANDBY})
    elif scope["type"] == "http":
        headers = {"Retry-After": "2", "Cache-Control": "no-store"}
        await problem_response(scope, Standby(Standby.example, headers=headers))(scope, receive, send)
