"""An agent's connection, whatever it runs over: challenge, hello, welcome, then records and acknowledgements."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from wonderland import telemetry
from wonderland.proofs import encoding
from wonderland.telemetry import (
    NONCE_BYTES,
    SERVER,
    Ack,
    Answer,
    Challenge,
    Channel,
    Records,
    Refused,
    Rejected,
    TelemetryError,
    Welcome,
)
from wonderland.telemetry.frames import FromServer
from wonderland_backend.agents import connected as agents
from wonderland_backend.agents.connected import Agent, Agents, DuplicateAgent
from wonderland_backend.agents.errors import IngestError
from wonderland_backend.agents.members import Members, Seen
from wonderland_backend.context import Context
from wonderland_backend.errors import DatabaseError
from wonderland_backend.ingest import batch as batches
from wonderland_backend.ingest import queries
from wonderland_backend.ingest.intake import Intake
from wonderland_backend.proof_requests import route

logger = logging.getLogger(__name__)

HELLO_S: Final = 10.0
MAX_UNPROVEN: Final = 500
"""Connections that have not said who they are yet; anybody can open one."""
NOT_AUTHENTICATED: Final = 4401
REFUSED: Final = 4403
BAD_FRAME: Final = 4400
MAX_OUTBOX: Final = 64
MAX_UNDER_WAY: Final = 32
"""Batches of one agent that wait to be durable; then it is read no further."""
REPLACED: Final = 4409
TRY_LATER: Final = 1013

RECORD_BYTES: Final = 512
"""A frame of fewer, longer records counts as so many of these."""

UnderWay = asyncio.Queue[tuple[batches.Batch, asyncio.Future[None] | None] | TelemetryError]
"""Batches in their order, each with when it is durable (None: it was already); or why the connection ends."""


@dataclass(frozen=True)
class Ingest:
    """Where agents come in."""

    context: Context
    members: Members
    connected: Agents
    intake: Intake

    async def serve(self, channel: Channel, see: Callable[[], Seen]) -> None:
        """Take in what an agent reports; see docs/seams.md, "Agents to backend: ingest".

        `see`: what the connection itself shows; it may raise `IngestError`.
        """
        with contextlib.suppress(ConnectionError):
            try:
                agent = await self._admit(channel, see())
            except TelemetryError as problem:
                logger.warning("an agent was refused: %s: %s", problem.code, problem.message)
                await _send(channel, Refused(code=problem.code, message=problem.message))
                unknown = problem.code in {"not_authenticated", "unknown_organisation", "bad_hello", "no_hello"}
                await channel.close(NOT_AUTHENTICATED if unknown else REFUSED)
                return
            try:
                await _Serving(channel, self.context, self.connected, self.intake, agent).run()
            finally:
                self.connected.leave(agent)

    async def _admit(self, channel: Channel, seen: Seen) -> Agent:
        """Who it is. Raises `TelemetryError`."""
        context, connected = self.context, self.connected
        nonce = encoding.to_base64url(context.randomness(NONCE_BYTES))
        await _send(channel, Challenge(nonce=nonce, server=SERVER, t_ms=context.clock()))
        try:
            async with asyncio.timeout(HELLO_S) as patience:
                with connected.proving(patience, MAX_UNPROVEN):
                    text = await _receive(channel, context)
        except TimeoutError:
            raise IngestError("no_hello", "no hello in time, or too many others are silent") from None
        hello = telemetry.decode_hello(text)
        identity = self.members.authenticate(hello, nonce=nonce, seen=seen, now_ms=context.clock())
        owner = await _owner(context, hello.agent, hello.id)
        if owner not in {None, hello.msp_id}:
            # Two organisations may each issue a certificate for pad-1; which of them has it, the ledger says.
            raise IngestError(
                "wrong_organisation", f"on the ledger {hello.id} belongs to {owner}, not to {hello.msp_id}"
            )
        if len(connected) >= context.settings.ingest_max_agents:
            raise IngestError("too_many_agents", "this server has as many agents as it may; try again later")
        agent = Agent(hello.agent, hello.id, hello.spool, hello.msp_id, identity.creator)
        if hello.agent == agents.UAV and hello.takes:
            agent.outbox = asyncio.Queue(MAX_OUTBOX)
        try:
            connected.join(agent)
        except DuplicateAgent:
            raise IngestError(
                "duplicate_agent",
                f"another agent of {hello.agent} {hello.id}, with another spool, is connected; stop one of them",
            ) from None
        return agent


async def _owner(context: Context, kind: str, agent_id: str) -> str | None:
    """The organisation of a pad or drone; None of one that the ledger does not have (yet)."""
    async with context.database.read() as session:
        return await (queries.owner_of_pad if kind == agents.PAD else queries.owner_of_drone)(session, agent_id)


class Pace:
    """So many a second, and a second's worth at once; who sends more is read later, and loses nothing."""

    def __init__(self, per_s: int) -> None:
        self._each_s = 1 / per_s
        self._due_s = 0.0

    async def spend(self, count: int) -> None:
        """Wait until there is room for what has come before."""
        now_s = asyncio.get_running_loop().time()
        self._due_s = max(self._due_s, now_s - 1.0) + count * self._each_s
        await asyncio.sleep(max(0.0, self._due_s - now_s))


@dataclass
class _Serving:
    """One agent's connection, once it is known whose it is."""

    channel: Channel
    context: Context
    connected: Agents
    intake: Intake
    agent: Agent

    async def run(self) -> None:
        """Until the agent goes, is replaced, or sends what is no frame."""
        channel, agent = self.channel, self.agent
        ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def end(why: str) -> None:
            # What it sent and is not being written yet comes again from whoever replaces it, or not at all.
            agent.broken = True
            if not ended.done():
                ended.set_result(why)

        agent.end = end
        acknowledged = await self.intake.acknowledged(agent)
        await _send(channel, Welcome(acknowledged=acknowledged))
        under_way: UnderWay = asyncio.Queue(MAX_UNDER_WAY)
        reading = asyncio.create_task(self._read(acknowledged, under_way), name=f"ingest-{agent.id}")
        answering = asyncio.create_task(_answer(channel, acknowledged, under_way), name=f"acknowledge-{agent.id}")
        telling = asyncio.create_task(self._outbox(), name=f"outbox-{agent.id}")
        try:
            waiting: set[asyncio.Future[Any]] = {answering, ended}
            await asyncio.wait({reading, *waiting}, return_when=asyncio.FIRST_COMPLETED)
            if reading.done():
                reading.result()  # raises where the agent has gone
                # A frame that is none: `_answer` says so once everything before it is acknowledged, and closes.
                await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            if answering.done():
                answering.result()
            elif ended.done():
                why = ended.result()
                await channel.close(REPLACED if why == agents.REPLACED else NOT_AUTHENTICATED, why)
        finally:
            ended.cancel()
            for task in (reading, answering, telling):
                task.cancel()
            await asyncio.gather(reading, answering, telling, return_exceptions=True)

    async def _read(self, acknowledged: int, under_way: UnderWay) -> None:
        """Takes in what comes while what came before is still being written; returns at a frame that is none."""
        taken = acknowledged
        pace = Pace(self.context.settings.agents.records_per_s)
        while True:
            try:
                text = await _receive(self.channel, self.context)
                message = _parsed(self.agent, text, self.context.settings.ingest_max_records)
                if isinstance(message, Answer):
                    await route.answered(self.context, self.agent, message)
                    continue
                await pace.spend(max(len(message.records), len(text) // RECORD_BYTES))
                batch = batches.read(self.agent, message.records, acknowledged=taken, now_ms=self.context.clock())
            except TelemetryError as problem:
                await under_way.put(problem)
                return
            durable = None
            if batch.last_seq > taken:
                durable = await self.intake.take_batch(batch)
                taken = batch.last_seq
            await under_way.put((batch, durable))

    async def _outbox(self) -> None:
        """What others have for the agent, one after the other."""
        if self.agent.outbox is None:
            return
        await route.tell_agent(self.context, self.connected, self.agent.id, again=True)
        while True:
            await _send(self.channel, await self.agent.outbox.get())


async def _answer(channel: Channel, acknowledged: int, under_way: UnderWay) -> None:
    """Acknowledges in the order in which batches came, each when it is durable; returns when it closed the channel."""
    while True:
        item = await under_way.get()
        if isinstance(item, TelemetryError):
            await _send(channel, Refused(code=item.code, message=item.message))
            await channel.close(BAD_FRAME, item.code)
            return
        batch, durable = item
        if durable is not None:
            try:
                await durable
            except DatabaseError:
                await channel.close(TRY_LATER, "not durable just now")
                return
            acknowledged = batch.last_seq
        for seq, code, message in batch.rejected:
            await _send(channel, Rejected(seq=seq, code=code, message=message))
        await _send(channel, Ack(seq=acknowledged))


def _parsed(agent: Agent, text: str, limit: int) -> Answer | Records:
    """A frame of at most `limit` records, not looked at yet, or a drone's answer. Raises `TelemetryError`."""
    message = telemetry.decode_agent(text)
    if isinstance(message, Answer) and agent.kind == agents.UAV:
        return message
    if not isinstance(message, Records):
        raise IngestError("bad_frame", "type: expected `records`")
    if len(message.records) > limit:
        raise IngestError("bad_frame", f"{len(message.records)} records; at most {limit}")
    return message


async def _receive(channel: Channel, context: Context) -> str:
    """The next text frame. Raises `IngestError` for a binary or too long one, `ConnectionError` at the end."""
    text = await channel.receive()
    if not isinstance(text, str):
        raise IngestError("bad_frame", "a binary frame; send JSON text")
    if len(text) > context.settings.ingest_max_bytes:
        raise IngestError("bad_frame", f"{len(text)} characters; at most {context.settings.ingest_max_bytes} bytes")
    return text


async def _send(channel: Channel, message: FromServer) -> None:
    await channel.send(telemetry.encode(message))
