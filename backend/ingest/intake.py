"""Making agents' records durable: what waits at a moment, of all agents, is one database transaction."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final

from sqlalchemy import insert
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncConnection

from backend.db.engine import Database
from backend.db.models import (
    Base,
    EstimateRow,
    FindingRow,
    HealthRow,
    IrregularRow,
    LatestTrackRow,
    SessionEndRow,
    SpoolRow,
    StepRow,
    TrackRow,
)
from backend.errors import DatabaseError
from backend.ingest.agents import Agent
from backend.ingest.batch import Batch, Row
from backend.live.board import Board

logger = logging.getLogger(__name__)

MAX_BATCHES: Final = 256
_LATEST: Final = "t_ms"


class Intake:
    """Takes batches, writes them, tells the board, and only then lets them be acknowledged."""

    def __init__(self, database: Database, board: Board, clock: Callable[[], int]) -> None:
        self._database = database
        self._board = board
        self._clock = clock
        self._queue: asyncio.Queue[tuple[Batch, asyncio.Future[None]]] = asyncio.Queue(MAX_BATCHES)
        self.records = 0
        self.rejected = 0

    async def acknowledged(self, agent: Agent) -> int:
        """The highest sequence number that is held durably of this agent's spool."""
        async with self._database.read() as session:
            row = await session.get(SpoolRow, (agent.kind, agent.id, agent.spool))
        return row.acknowledged if row is not None else 0

    async def take(self, batch: Batch) -> None:
        """Returns when the batch is durable. Raises `DatabaseError` when it is not: then it is not acknowledged."""
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        await self._queue.put((batch, done))
        await done

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            waiting = [await self._queue.get()]
            while not self._queue.empty() and len(waiting) < MAX_BATCHES:
                waiting.append(self._queue.get_nowait())
            try:
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
        for name, arguments in batch.tell:
            getattr(self._board, name)(*arguments)

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
            await _upsert(connection, SpoolRow, list(spools.values()), keep=("first_seen_ms",), rising="acknowledged")
            tracks = [row for batch in batches for row in batch.tracks]
            await _insert(connection, TrackRow, tracks)
            await _upsert(connection, LatestTrackRow, _latest(tracks, "uav_id"), rising=_LATEST)
            await _insert(connection, FindingRow, [row for batch in batches for row in batch.findings])
            await _insert(connection, EstimateRow, [row for batch in batches for row in batch.estimates])
            steps = [row for batch in batches for row in batch.steps]
            await _upsert(connection, StepRow, _last(steps, "session_id", "step", "agent", "agent_id"))
            ends = [row for batch in batches for row in batch.ends]
            await _upsert(connection, SessionEndRow, _last(ends, "session_id", "agent", "agent_id"))
            health = [batch.health for batch in batches if batch.health is not None]
            await _upsert(connection, HealthRow, _last(health, "agent", "agent_id"), rising=_LATEST)
            irregular = [row for batch in batches for row in batch.irregular]
            await _upsert(connection, IrregularRow, _last(irregular, "agent", "agent_id", "spool", "seq"))


def _fail(waiting: list[tuple[Batch, asyncio.Future[None]]], error: DatabaseError) -> None:
    for _, done in waiting:
        if not done.done():
            done.set_exception(error)


def _last(rows: list[Row], *keys: str) -> list[Row]:
    """The last row of each key: one statement cannot write a row twice."""
    return list({tuple(row[key] for key in keys): row for row in rows}.values())


def _latest(rows: list[Row], key: str) -> list[Row]:
    return _last(sorted(rows, key=lambda row: int(row[_LATEST])), key)


async def _insert(connection: AsyncConnection, model: type[Base], rows: list[Row]) -> None:
    if rows:
        await connection.execute(insert(model), rows)


async def _upsert(
    connection: AsyncConnection,
    model: type[Base],
    rows: list[Row],
    *,
    keep: tuple[str, ...] = (),
    rising: str | None = None,
) -> None:
    """Insert or replace; `keep` names columns that stay, `rising` one that must not fall for the row to change."""
    if not rows:
        return
    table = model.__table__
    dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
    statement = dialect.insert(table)
    keys = [column.name for column in table.primary_key]
    changed = {
        column.name: statement.excluded[column.name]
        for column in table.columns
        if column.name not in keys and column.name not in keep
    }
    condition = None if rising is None else table.c[rising] <= statement.excluded[rising]
    await connection.execute(statement.on_conflict_do_update(index_elements=keys, set_=changed, where=condition), rows)
