"""Making agents' records durable: what waits at a moment, of all agents, is one database transaction."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import Annotated, Final, TypeVar

from sqlalchemy.exc import SQLAlchemyError

from wonderland_backend.agents.connected import PAD, Agent
from wonderland_backend.context import part
from wonderland_backend.db import bulk
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.reported import (
    BroadcastOperatorRow,
    EstimateRow,
    FindingRow,
    HealthRow,
    IrregularRow,
    LatestTrackRow,
    PadHealthRow,
    SessionEndRow,
    SpoolRow,
    StepRow,
    TrackMinuteRow,
    TrackRow,
)
from wonderland_backend.errors import DatabaseError
from wonderland_backend.flights.store import FlightLog
from wonderland_backend.ingest.batch import Batch
from wonderland_backend.ingest.rows import HealthValues, OperatorValues, TrackValues
from wonderland_backend.live.board import Board
from wonderland_backend.live.telling import tell_board

R = TypeVar("R", bound=bulk.Row)
OfDrone = TypeVar("OfDrone", TrackValues, OperatorValues)

logger = logging.getLogger(__name__)

MAX_BATCHES: Final = 256
FEW: Final = 4
FEW_APART_S: Final = 0.04
MANY_APART_S: Final = 0.12
"""Writes begin at least so far apart, after one of a few batches and after one of more.

With many pads, what each of them sends is not a transaction of its own: rows that share pages of the database are
written together. After a pause what comes is written at once.
"""
MINUTE_MS: Final = 60_000
_LATEST: Final = "t_ms"


class Intake:
    """Takes batches, writes them, tells the board, and only then lets them be acknowledged."""

    def __init__(self, database: Database, board: Board, clock: Callable[[], int]) -> None:
        self._database = database
        self._board = board
        self._clock = clock
        self._queue: asyncio.Queue[tuple[Batch, asyncio.Future[None]]] = asyncio.Queue(MAX_BATCHES)
        self.listeners: list[Callable[[Batch], None]] = []
        """Called with each batch once it is durable."""
        self._newest: asyncio.Future[None] | None = None
        self._flights = FlightLog()
        self.records = 0
        self.rejected = 0

    async def acknowledged(self, agent: Agent) -> int:
        """The highest sequence number that is held durably of this agent's spool; what waits now is written first."""
        if self._newest is not None and not self._newest.done():
            await asyncio.wait([self._newest])
        async with self._database.read() as session:
            row = await session.get(SpoolRow, (agent.kind, agent.id, agent.spool))
        return row.acknowledged if row is not None else 0

    async def take_batch(self, batch: Batch) -> asyncio.Future[None]:
        """Queues the batch. Its future is done when the batch is durable, and raises `DatabaseError` when it is not.

        Once one of a connection is not, none after it is: an agent's records are durable without a gap.
        """
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        done.add_done_callback(_seen)
        await self._queue.put((batch, done))
        self._newest = done
        return done

    async def run(self) -> None:
        """Write what was queued, many batches in one database transaction, until cancelled."""
        loop = asyncio.get_running_loop()
        due = 0.0
        while True:
            waiting = [await self._queue.get()]
            try:
                await asyncio.sleep(max(0.0, due - loop.time()))
                while not self._queue.empty() and len(waiting) < MAX_BATCHES:
                    waiting.append(self._queue.get_nowait())
                due = loop.time() + (FEW_APART_S if len(waiting) <= FEW else MANY_APART_S)
                late = [each for each in waiting if each[0].agent.broken]
                _fail(late, DatabaseError("records before these were not kept"))
                waiting = [each for each in waiting if not each[0].agent.broken]
                if waiting:
                    await self._write([batch for batch, _ in waiting])
            except asyncio.CancelledError:
                _fail(waiting, DatabaseError("the server stops; try again later"))
                raise
            except Exception as cause:
                expected = isinstance(cause, SQLAlchemyError | OSError)
                problem = getattr(cause, "orig", None) or cause
                logger.error("agents' records could not be written: %s", problem, exc_info=not expected)  # noqa: TRY400 - a full disk needs no stack trace
                _fail(waiting, DatabaseError("the database does not take records just now; try again"))
                continue
            for batch, done in waiting:
                self._tell(batch)
                if not done.done():
                    done.set_result(None)

    def _tell(self, batch: Batch) -> None:
        self.records += len(batch.tell)
        self.rejected += len(batch.rejected)
        for what in batch.tell:
            tell_board(self._board, what)
        for listener in self.listeners:
            listener(batch)

    async def _write(self, batches: list[Batch]) -> None:
        now = self._clock()
        async with self._database.write() as connection:
            spools = {
                (batch.agent.kind, batch.agent.id, batch.agent.spool): {
                    "agent": batch.agent.kind,
                    "agent_id": batch.agent.id,
                    "spool": batch.agent.spool,
                    "acknowledged": batch.last_seq,
                    "first_seen_ms": now,
                    "last_seen_ms": now,
                }
                for batch in batches
            }
            await bulk.upsert(
                connection, SpoolRow, list(spools.values()), keep=("first_seen_ms",), rising="acknowledged"
            )
            tracks = [row for batch in batches for row in batch.tracks]
            await bulk.append(connection, TrackRow, _dated(tracks, now))
            await bulk.upsert(connection, LatestTrackRow, _latest(tracks), rising=_LATEST)
            heard = (each for batch in batches for each in batch.heard)
            positions = ((body.uav_id, (t_ms, body.lat_e7, body.lon_e7)) for t_ms, body in heard)
            await self._flights.take_positions(connection, positions, now)
            operators = [row for batch in batches for row in batch.operators]
            await bulk.upsert(connection, BroadcastOperatorRow, _latest(operators), rising=_LATEST)
            if tracks:
                minute = {"minute_ms": now - now % MINUTE_MS, "positions": len(tracks)}
                await bulk.upsert(connection, TrackMinuteRow, [minute], adding=("positions",))
            await bulk.append(connection, FindingRow, [row for batch in batches for row in batch.findings])
            estimates = _dated((row for batch in batches for row in batch.estimates), now)
            await bulk.append(connection, EstimateRow, estimates)
            steps = _dated((row for batch in batches for row in batch.steps), now)
            await bulk.upsert(connection, StepRow, _last(steps, "session_id", "step", "agent", "agent_id"))
            ends = _dated((row for batch in batches for row in batch.ends), now)
            await bulk.upsert(connection, SessionEndRow, _last(ends, "session_id", "agent", "agent_id"))
            health = [batch.health for batch in batches if batch.health is not None]
            await bulk.append(
                connection, PadHealthRow, _dated((_of_pad(each) for each in health if each["agent"] == PAD), now)
            )
            await bulk.upsert(connection, HealthRow, _last(health, "agent", "agent_id"), rising=_LATEST)
            irregular = [row for batch in batches for row in batch.irregular]
            await bulk.upsert(connection, IrregularRow, _last(irregular, "agent", "agent_id", "spool", "seq"))


IntakeDep = Annotated[Intake, part(Intake)]


def _dated(rows: Iterable[bulk.Row], now_ms: int) -> list[bulk.Row]:
    """Rows with the time at which this server took them in."""
    return [{**row, "received_ms": now_ms} for row in rows]


def _of_pad(health: HealthValues) -> bulk.Row:
    return {"pad_id": health["agent_id"], "t_ms": health["t_ms"], "body": health["body"]}


def _seen(done: asyncio.Future[None]) -> None:
    """An agent that has gone does not ask what became of its records."""
    if not done.cancelled():
        done.exception()


def _fail(waiting: list[tuple[Batch, asyncio.Future[None]]], error: DatabaseError) -> None:
    for batch, done in waiting:
        batch.agent.broken = True
        if not done.done():
            done.set_exception(error)


def _last(rows: Iterable[R], *keys: str) -> list[R]:
    """The last row of each key: one statement cannot write a row twice."""
    return list({tuple(row[key] for key in keys): row for row in rows}.values())


def _latest(rows: list[OfDrone]) -> list[OfDrone]:
    """The newest row of each drone."""
    return _last(sorted(rows, key=lambda row: row["t_ms"]), "uav_id")
