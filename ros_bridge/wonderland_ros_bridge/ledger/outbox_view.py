"""A look into an outbox while its bridge runs: nothing is written, and nothing is locked."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any, Self
from urllib.parse import quote

from wonderland_ros_bridge.errors import SpoolError

MAX_REJECTED = 1_000


class OutboxView:
    """Raises SpoolError for a file that is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.exists():
            raise SpoolError(f"spool {path}: there is none yet; the bridge makes it when it starts")
        self._connection = sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True, timeout=5)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def summary(self) -> dict[str, Any]:
        """How much waits, by topic, and how many batches were refused."""
        topics = self._query(
            "SELECT t.topic, t.received, (SELECT COUNT(*) FROM messages m WHERE m.topic = t.topic) FROM topics t"
        )
        place = self._query("SELECT value FROM meta WHERE name = 'next_block'")
        return {
            "waiting": sum(waiting for *_, waiting in topics),
            "rejected": self._query("SELECT COUNT(*) FROM rejected")[0][0],
            "next_block": place[0][0] if place else None,
            "topics": [{"topic": name, "received": received, "waiting": waiting} for name, received, waiting in topics],
        }

    def rejected(self) -> list[dict[str, Any]]:
        """What was refused, oldest first, with the messages themselves in ``value``."""
        names = ("id", "topic", "asset_id", "t_ms", "code", "reason", "value")
        rows = self._query(
            "SELECT id, topic, asset_id, t_ms, code, reason, value FROM rejected ORDER BY id LIMIT ?", MAX_REJECTED
        )
        return [dict(zip(names, row, strict=True)) for row in rows]

    def _query(self, statement: str, *values: Any) -> list[Any]:
        try:
            return self._connection.execute(statement, values).fetchall()
        except sqlite3.Error as cause:
            raise SpoolError(f"spool {self._path}: {cause}") from cause
