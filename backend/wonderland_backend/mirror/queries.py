"""A table that is derived from the ledger, read whole for its digest."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import Any

import orjson
from sqlalchemy import Row, String, Text, collate, select
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.tables.base import LedgerRow
from wonderland_backend.db.tables.ledger import DroneRow


@dataclass(frozen=True)
class TableDigest:
    """How many rows a table has, and SHA-256 (hex) over them in the order of their keys."""

    rows: int
    sha256: str


async def table_digest(connection: AsyncConnection, model: type[LedgerRow]) -> TableDigest:
    """Its rows in the order of their keys, which is that of bytes in every database."""
    found = hashlib.sha256()
    rows = 0
    async for row in _rows(connection, model):
        found.update(orjson.dumps(list(row)))
        found.update(b"\n")
        rows += 1
    return TableDigest(rows, found.hexdigest())


async def drone_records(connection: AsyncConnection) -> Sequence[str]:
    """The records of all drones (JSON)."""
    return (await connection.scalars(select(DroneRow.record))).all()


async def differing_rows(
    here: AsyncConnection, there: AsyncConnection, model: type[LedgerRow]
) -> AsyncGenerator[str, None]:
    """Keys of rows that one of two databases lacks, or has otherwise, and which of it."""
    names = [column.name for column in model.__table__.primary_key]
    async with contextlib.aclosing(_rows(here, model)) as left, contextlib.aclosing(_rows(there, model)) as right:
        mine, its = await anext(left, None), await anext(right, None)
        while mine is not None or its is not None:
            my_key, its_key = _key(mine, names), _key(its, names)
            if its is None or (mine is not None and my_key < its_key):
                yield f"{my_key.said}: not on the ledger"
                mine = await anext(left, None)
            elif mine is None or its_key < my_key:
                yield f"{its_key.said}: missing here"
                its = await anext(right, None)
            else:
                if tuple(mine) != tuple(its):
                    columns = [name for name in mine._fields if getattr(mine, name) != getattr(its, name)]
                    yield f"{my_key.said}: another {', '.join(columns)}"
                mine, its = await anext(left, None), await anext(right, None)


class _Key(tuple[bytes | int, ...]):
    """A primary key in the order of its bytes."""

    __slots__ = ()

    @property
    def said(self) -> str:
        return "/".join(each.decode() if isinstance(each, bytes) else str(each) for each in self)


def _key(row: Row[Any] | None, names: Sequence[str]) -> _Key:
    values = () if row is None else tuple(getattr(row, name) for name in names)
    return _Key(each.encode() if isinstance(each, str) else each for each in values)


async def _rows(connection: AsyncConnection, model: type[LedgerRow]) -> AsyncGenerator[Row[Any], None]:
    table = model.__table__
    columns = sorted(table.columns, key=lambda column: column.name)
    order = []
    for column in table.primary_key:
        # By bytes, whatever language the database sorts in.
        by_bytes = connection.dialect.name == "postgresql" and isinstance(column.type, String | Text)
        order.append(collate(column, "C") if by_bytes else column)
    result = await connection.stream(select(*columns).order_by(*order))
    async for partition in result.partitions(1_000):
        for row in partition:
            yield row
