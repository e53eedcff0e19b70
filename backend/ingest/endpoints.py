"""The agents' WebSocket: challenge, hello, welcome, then records and acknowledgements."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Any, Final

import orjson
from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from backend.context import Context, context_of
from backend.errors import DatabaseError
from backend.ingest import agents
from backend.ingest import batch as batches
from backend.ingest.agents import Agent, DuplicateAgent
from backend.ingest.messages import IngestError, parse_hello, parse_records
from wonderland.proofs import encoding

logger = logging.getLogger(__name__)
router = APIRouter()

SERVER: Final = "wonderland"
NONCE_BYTES: Final = 32
HELLO_S: Final = 10.0
MAX_UNPROVEN: Final = 500
"""Connections that have not said who they are yet; anybody can open one."""
NOT_AUTHENTICATED: Final = 4401
REFUSED: Final = 4403
BAD_FRAME: Final = 4400
REPLACED: Final = 4409
TRY_LATER: Final = 1013


@router.websocket("/ingest")
async def ingest(socket: WebSocket) -> None:
    """Take in what an agent reports; see docs/seams.md, "Agents to backend: ingest"."""
    context = context_of(socket)
    await socket.accept()
    if context.agents.unproven >= MAX_UNPROVEN:
        await socket.close(TRY_LATER, "too many connections that say nothing")
        return
    with contextlib.suppress(WebSocketDisconnect):
        try:
            with context.agents.proving():
                agent = await _admit(socket, context)
        except IngestError as problem:
            logger.warning("an agent was refused: %s: %s", problem.code, problem.message)
            await _send(socket, {"type": "refused", "code": problem.code, "message": problem.message})
            unknown = problem.code in {"not_authenticated", "unknown_organisation", "bad_hello", "no_hello"}
            await socket.close(NOT_AUTHENTICATED if unknown else REFUSED)
            return
        try:
            await _serve(socket, context, agent)
        finally:
            context.agents.leave(agent)


async def _admit(socket: WebSocket, context: Context) -> Agent:
    """Who it is. Raises `IngestError`."""
    nonce = encoding.to_base64url(context.randomness(NONCE_BYTES))
    await _send(socket, {"type": "challenge", "nonce": nonce, "server": SERVER, "t_ms": context.clock()})
    try:
        async with asyncio.timeout(HELLO_S):
            text = await _receive(socket, context)
    except TimeoutError:
        raise IngestError("no_hello", f"no hello within {HELLO_S:g} s") from None
    hello = parse_hello(text)
    identity = context.members.authenticate(hello, nonce=nonce, server=SERVER, now_ms=context.clock())
    if len(context.agents) >= context.settings.ingest_max_agents:
        raise IngestError("too_many_agents", "this server has as many agents as it may; try again later")
    agent = Agent(hello.agent, hello.id, hello.spool, hello.msp_id, identity.creator)
    try:
        context.agents.join(agent)
    except DuplicateAgent:
        raise IngestError(
            "duplicate_agent",
            f"another agent of {hello.agent} {hello.id}, with another spool, is connected; stop one of them",
        ) from None
    return agent


async def _serve(socket: WebSocket, context: Context, agent: Agent) -> None:
    ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def end(why: str) -> None:
        if not ended.done():
            ended.set_result(why)

    agent.end = end
    work = asyncio.create_task(_records(socket, context, agent), name=f"ingest-{agent.id}")
    try:
        waiting: set[asyncio.Future[Any]] = {work, ended}
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            work.result()
        else:
            why = ended.result()
            await socket.close(REPLACED if why == agents.REPLACED else NOT_AUTHENTICATED, why)
    finally:
        ended.cancel()
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)


async def _records(socket: WebSocket, context: Context, agent: Agent) -> None:
    acknowledged = await context.intake.acknowledged(agent)
    await _send(socket, {"type": "welcome", "acknowledged": acknowledged})
    while True:
        try:
            text = await _receive(socket, context)
            records = parse_records(text, context.settings.ingest_max_records)
            batch = batches.read(agent, records, acknowledged=acknowledged, now_ms=context.clock())
        except IngestError as problem:
            await _send(socket, {"type": "refused", "code": problem.code, "message": problem.message})
            await socket.close(BAD_FRAME, problem.code)
            return
        if batch.last_seq > acknowledged:
            try:
                await context.intake.take(batch)
            except DatabaseError:
                await socket.close(TRY_LATER, "not durable just now")
                return
            acknowledged = batch.last_seq
        for seq, code, message in batch.rejected:
            await _send(socket, {"type": "rejected", "seq": seq, "code": code, "message": message})
        await _send(socket, {"type": "ack", "seq": acknowledged})


async def _receive(socket: WebSocket, context: Context) -> str:
    """The next text frame. Raises `IngestError` for a binary or too long one, `WebSocketDisconnect` at the end."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    text = message.get("text")
    if text is None:
        raise IngestError("bad_frame", "a binary frame; send JSON text")
    if len(text) > context.settings.ingest_max_bytes:
        raise IngestError("bad_frame", f"{len(text)} characters; at most {context.settings.ingest_max_bytes} bytes")
    assert isinstance(text, str)
    return text


async def _send(socket: WebSocket, message: dict[str, Any]) -> None:
    await socket.send_text(orjson.dumps(message).decode())
