"""Noting what only the running server knows: when it came to know a block, and which pads were connected to it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import insert, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.ledger import BlockRow
from wonderland_backend.db.tables.reported import BlockArrivalRow, InstanceRow, PadConnectionRow
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import BlockWrite
from wonderland_backend.mirror.subscriber import Subscriber

CONFIRM_S: Final = 15.0
"""A connection that stands is written down anew this often: so far at most is it believed of a server that died."""
_TOGETHER_S: Final = 0.2


class Arrivals(Subscriber[None]):
    """Notes when blocks became known, within the mirror's own transaction."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock

    async def in_transaction(self, connection: AsyncConnection, changes: Changes) -> None:
        """These became known just now."""
        await _note_blocks(connection, changes.blocks, self._clock())

    def after_commit(self, changes: Changes, found: None) -> None:
        """Has nothing to do after the commit."""


async def _note_blocks(connection: AsyncConnection, blocks: Sequence[BlockWrite], now_ms: int) -> None:
    """Note when these blocks became known.

    A block that is older than this installation was never news here: it is dated by its own time. So is what is
    mirrored anew: what was noted once stays.
    """
    born_ms = (await connection.execute(select(InstanceRow.created_ms))).scalar_one_or_none() or 0
    newest = select(BlockArrivalRow.known_ms).order_by(BlockArrivalRow.number.desc()).limit(1)
    known_ms = (await connection.execute(newest)).scalar_one_or_none() or 0
    latest_ms = now_ms
    dates: list[int] = []
    for block in reversed(blocks):
        # Times of blocks are their clients': one that is ahead of those that follow is wrong.
        latest_ms = min(latest_ms, block.t_ms if block.t_ms < born_ms else now_ms)
        dates.append(latest_ms)
    rows = []
    for block, own_ms in zip(blocks, reversed(dates), strict=True):
        # Never earlier than the block before, whatever the clocks say: what is known stays known.
        known_ms = max(known_ms, own_ms)
        rows.append({"number": block.number, "known_ms": known_ms})
    if rows:
        dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
        await connection.execute(dialect.insert(BlockArrivalRow).on_conflict_do_nothing(), rows)


async def note_unknown(connection: AsyncConnection) -> None:
    """Date blocks that were mirrored while no server ran (`wonderland backend rebuild`) by their own time."""
    missing = select(BlockRow.number, BlockRow.t_ms).where(BlockRow.number.not_in(select(BlockArrivalRow.number)))
    await connection.execute(insert(BlockArrivalRow).from_select(["number", "known_ms"], missing))


@dataclass(frozen=True)
class _Change:
    pad_id: str
    t_ms: int
    connected: bool


class Connections:
    """Writes down from when until when pads' agents are connected to this server."""

    def __init__(self, database: Database, server: str, clock: Callable[[], int]) -> None:
        self._database = database
        self._server = server
        self._clock = clock
        self._standing: dict[str, int] = {}
        self._changes: list[_Change] = []
        self._woken = asyncio.Event()

    def changed(self, pad_id: str, *, connected: bool) -> None:
        """A pad's agent came or went just now; written down soon."""
        self._changes.append(_Change(pad_id, self._clock(), connected))
        self._woken.set()

    async def run(self) -> None:
        """Write until cancelled, and what is left then."""
        try:
            while True:
                try:
                    async with asyncio.timeout(CONFIRM_S):
                        await self._woken.wait()
                    await asyncio.sleep(_TOGETHER_S)
                except TimeoutError:
                    pass
                await self.write()
        finally:
            for pad_id in self._standing:
                self._changes.append(_Change(pad_id, self._clock(), connected=False))
            await self.write()

    async def write(self) -> None:
        """Write down what has changed, and that the other connections stand."""
        self._woken.clear()
        changes, self._changes = self._changes, []
        async with self._database.write() as connection:
            for change in changes:
                await self._write(connection, change)
            await connection.execute(
                update(PadConnectionRow)
                .where(PadConnectionRow.server == self._server, PadConnectionRow.ended.is_(False))
                .values(until_ms=self._clock())
            )

    async def _write(self, connection: AsyncConnection, change: _Change) -> None:
        from_ms = self._standing.pop(change.pad_id, None)
        if from_ms is not None:
            await connection.execute(
                update(PadConnectionRow)
                .where(
                    PadConnectionRow.pad_id == change.pad_id,
                    PadConnectionRow.server == self._server,
                    PadConnectionRow.from_ms == from_ms,
                )
                .values(until_ms=change.t_ms, ended=True)
            )
        if change.connected:
            # Two connections within one millisecond are one.
            dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
            row = {"pad_id": change.pad_id, "server": self._server, "from_ms": change.t_ms}
            row |= {"until_ms": change.t_ms, "ended": False}
            again = dialect.insert(PadConnectionRow).on_conflict_do_update(
                index_elements=["pad_id", "server", "from_ms"], set_={"ended": False}
            )
            await connection.execute(again, [row])
            self._standing[change.pad_id] = change.t_ms
