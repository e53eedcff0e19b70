"""A temporary store for what a chain amounts to, and how another one differs from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.embedded.seal import SEAL
from wonderland_fabric_gateway.embedded.state import SCHEMA, StateWriter

if TYPE_CHECKING:
    from pathlib import Path

_COLUMNS: Final = {
    "block": (("number",), ("header_hash",)),
    "tx": (("tx_id",), ("block", "position", "code")),
    "state": (("namespace", "key"), ("value", "block", "position", "policy")),
    "history": (("namespace", "key", "block", "position"), ("tx_id", "timestamp_ms", "value")),
    "meta": (("name",), ("value",)),
}
"""What the blocks determine: each table's primary key, and its other columns."""


class Recomputed(StateWriter):
    """A store of its own that vanishes with it, for what the blocks of another one amount to; blocks are kept empty."""

    def __init__(self) -> None:
        super().__init__(None)
        self._db.executescript(SCHEMA)

    def first_difference(self, path: Path) -> tuple[str, str, str] | None:
        """Table, key and what is wrong, of the first row of the store `path` that is not as here; None: all are."""
        self._db.execute("ATTACH DATABASE ? AS stored", (str(path),))
        for table, (keys, others) in _COLUMNS.items():
            columns = ", ".join((*keys, *others))
            where = f"WHERE name != '{SEAL}'" if table == "meta" else ""
            here, there = (f"SELECT {columns} FROM {each}.{table} {where}" for each in ("main", "stored"))  # noqa: S608
            wrong = self._db.execute(f"{there} EXCEPT {here} LIMIT 1").fetchone()
            lost = self._db.execute(f"{here} EXCEPT {there} LIMIT 1").fetchone()
            if wrong is None and lost is None:
                continue
            key = (wrong or lost)[: len(keys)]
            same = " AND ".join(f"{each}=?" for each in keys)
            known = self._db.execute(f"SELECT {columns} FROM main.{table} WHERE {same}", key).fetchone()  # noqa: S608
            name = ", ".join(f"{column} {_shown(value)}" for column, value in zip(keys, key, strict=True))
            if wrong is None:
                return table, name, "the row is missing, and follows from the chain"
            if known is None:
                return table, name, "the row is there, and does not follow from the chain"
            changed = [column for column, *two in zip((*keys, *others), wrong, known, strict=True) if two[0] != two[1]]
            return table, name, f"{', '.join(changed)}: not what follows from the chain"
        return None


def _shown(value: str | bytes | int) -> str:
    return value.decode(errors="backslashreplace") if isinstance(value, bytes) else str(value)
