"""Tables with many rows, on PostgreSQL: one partition for each day (UTC) of `received_ms`.

A day's rows go all at once, by dropping their partition, when its youngest row is old enough. Rows for which there is
no partition, because a clock jumped, stand in the default partition until there is one: none is ever refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from sqlalchemy import delete, func, select, text
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.bulk import table_of
from wonderland_backend.db.tables.reported import EstimateRow, PadHealthRow, TrackRow

DAY_MS: Final = 86_400_000
AHEAD_DAYS: Final = 3
PARTITIONED: Final[tuple[type[TrackRow | EstimateRow | PadHealthRow], ...]] = (TrackRow, EstimateRow, PadHealthRow)
_LOCK: Final = 0x504F4D
_PARTITIONS: Final = text(
    "SELECT c.relname FROM pg_inherits i JOIN pg_class c ON c.oid = i.inhrelid WHERE i.inhparent = to_regclass(:table)"
)


def partition_of(table: str, day: int) -> str:
    """The name of a day's partition; days are counted from the Unix epoch."""
    return f"{table}_{datetime.fromtimestamp(day * DAY_MS / 1000, UTC):%Y%m%d}"


async def make_ahead(connection: AsyncConnection, now_ms: int) -> None:
    """Make the partitions of today and of the days to come. Does nothing on SQLite."""
    if connection.dialect.name != "postgresql":
        return
    # Two servers that do it at once do it one after the other.
    await connection.execute(select(func.pg_advisory_xact_lock(_LOCK)))
    for model in PARTITIONED:
        table = model.__tablename__
        known = await partitions(connection, table)
        for day in range(now_ms // DAY_MS, now_ms // DAY_MS + AHEAD_DAYS + 1):
            if partition_of(table, day) not in known:
                await _make(connection, table, day)


async def forget(
    connection: AsyncConnection, model: type[TrackRow | EstimateRow | PadHealthRow], before_ms: int
) -> None:
    """Delete what was received earlier: on PostgreSQL whole days, and what stands in the default partition."""
    table = table_of(model)
    if connection.dialect.name != "postgresql":
        await connection.execute(delete(table).where(table.c.received_ms < before_ms))
        return
    await connection.exec_driver_sql("SET LOCAL lock_timeout = '5s'")
    last = partition_of(table.name, before_ms // DAY_MS)
    for name in await partitions(connection, table.name):
        # Names of one length sort as their days do.
        if name != f"{table.name}_default" and name < last:
            await connection.exec_driver_sql(f'DROP TABLE "{name}"')
    leftover = text(f'DELETE FROM "{table.name}_default" WHERE received_ms < :before')  # noqa: S608 - our own table
    await connection.execute(leftover, {"before": before_ms})


async def partitions(connection: AsyncConnection, table: str) -> Sequence[str]:
    """The names of a table's partitions."""
    return (await connection.execute(_PARTITIONS, {"table": table})).scalars().all()


async def _make(connection: AsyncConnection, table: str, day: int) -> None:
    name = partition_of(table, day)
    begin, end = day * DAY_MS, (day + 1) * DAY_MS
    # Whoever inserts must not choose the default partition just before its limits change: PostgreSQL would refuse it.
    await connection.exec_driver_sql(f'LOCK TABLE "{table}" IN SHARE MODE')
    await connection.exec_driver_sql(f'CREATE TABLE "{name}" (LIKE "{table}" INCLUDING ALL)')
    await connection.exec_driver_sql(
        f'WITH moved AS (DELETE FROM "{table}_default" '  # noqa: S608 - names of our own tables
        f"WHERE received_ms >= {begin} AND received_ms < {end} RETURNING *) "
        f'INSERT INTO "{name}" SELECT * FROM moved'
    )
    await connection.exec_driver_sql(
        f'ALTER TABLE "{table}" ATTACH PARTITION "{name}" FOR VALUES FROM ({begin}) TO ({end})'
    )


def is_partition(name: str) -> bool:
    """Whether a table of this name is a partition: migrations and models do not know them by name."""
    return any(
        (name.startswith(f"{model.__tablename__}_") and name.removeprefix(f"{model.__tablename__}_").isdecimal())
        or name == f"{model.__tablename__}_default"
        for model in PARTITIONED
    )
