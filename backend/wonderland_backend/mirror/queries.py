"""A table that is derived from the ledger, read whole for its digest."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import orjson
from sqlalchemy import String, Text, collate, select
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.tables.base import LedgerRow


@dataclass(frozen=True)
class TableDigest:
    """How many rows a table has, and SHA-256 (hex) over them in the order of their keys."""

    rows: int
    sha256: str


async def table_digest(connection: AsyncConnection, model: type[LedgerRow]) -> TableDigest:
    """Its rows in the order of their keys, which is that of bytes in every database."""
    table = model.__table__
    columns = sorted(table.columns, key=lambda column: column.name)
    order = []
    for column in table.primary_key:
        # By bytes, whatever language the database sorts in.
        by_bytes = connection.dialect.name == "postgresql" and isinstance(column.type, String | Text)
        order.append(collate(column, "C") if by_bytes else column)
    found = hashlib.sha256()
    rows = 0
    result = await connection.stream(select(*columns).order_by(*order))
    async for partition in result.partitions(1_000):
        for row in partition:
            found.update(orjson.dumps(list(row)))
            found.update(b"\n")
            rows += 1
    return TableDigest(rows, found.hexdigest())
