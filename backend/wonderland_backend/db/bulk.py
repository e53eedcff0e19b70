"""Writing many rows at once: COPY on PostgreSQL, which takes a fraction of INSERT's time; INSERT on SQLite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from sqlalchemy import MetaData, Table, func, insert
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.tables.base import Base

MANY_ROWS: Final = 100
"""From so many rows on a detour by COPY pays for an upsert."""

Row = Mapping[str, object]


async def append(connection: AsyncConnection, model: type[Base], rows: Sequence[Row]) -> None:
    """Insert these rows; all have the same columns."""
    if not rows:
        return
    table = table_of(model)
    if connection.dialect.name == "postgresql":
        await _copy(connection, table.name, rows)
    else:
        await connection.execute(insert(table), rows)


async def upsert(
    connection: AsyncConnection,
    model: type[Base],
    rows: Sequence[Row],
    *,
    keep: tuple[str, ...] = (),
    fill: tuple[str, ...] = (),
    rising: str | None = None,
    adding: tuple[str, ...] = (),
) -> None:
    """Insert or replace; no key may be there twice.

    `keep` names columns that stay as they are, `fill` those that stay where the new row has no value, `rising` one
    that must not fall for the row to change, `adding` those whose new value is added to the old.
    """
    if not rows:
        return
    table = table_of(model)
    on_postgresql = connection.dialect.name == "postgresql"

    def or_update(statement: Any) -> Any:
        new = statement.excluded
        changed: dict[str, Any] = {}
        for name in rows[0]:
            column = table.c[name]
            if column.primary_key or name in keep:
                continue
            changed[name] = new[name]
            if name in fill:
                changed[name] = func.coalesce(new[name], column)
            elif name in adding:
                changed[name] = column + new[name]
        return statement.on_conflict_do_update(
            index_elements=[column.name for column in table.primary_key],
            set_=changed,
            where=None if rising is None else table.c[rising] <= new[rising],
        )

    if on_postgresql and len(rows) >= MANY_ROWS:
        await connection.execute(or_update(await _from_aside(connection, table, rows)))
    else:
        dialect: Any = postgresql if on_postgresql else sqlite
        await connection.execute(or_update(dialect.insert(table)), rows)


def table_of(model: type[Base]) -> Table:
    """The table of a model."""
    table = model.__table__
    assert isinstance(table, Table)
    return table


async def _copy(connection: AsyncConnection, into: str, rows: Sequence[Row]) -> None:
    names = list(rows[0])
    raw = await connection.get_raw_connection()
    driver = raw.driver_connection
    assert driver is not None
    columns = ", ".join(f'"{name}"' for name in names)
    async with driver.cursor() as cursor, cursor.copy(f'COPY "{into}" ({columns}) FROM STDIN') as copy:
        for row in rows:
            await copy.write_row([row[name] for name in names])


async def _from_aside(connection: AsyncConnection, table: Table, rows: Sequence[Row]) -> Any:
    """COPY into a table aside; the INSERT from there."""
    aside = table.to_metadata(MetaData(), name=f"new_{table.name}")
    await connection.exec_driver_sql(
        f'CREATE TEMPORARY TABLE IF NOT EXISTS "{aside.name}" (LIKE "{table.name}") ON COMMIT DELETE ROWS'
    )
    await _copy(connection, aside.name, rows)
    names = list(rows[0])
    return postgresql.insert(table).from_select(names, aside.select().with_only_columns(*(aside.c[n] for n in names)))
