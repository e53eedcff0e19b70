"""The agent's own state beside its records: private keys that are taken once, sessions in progress, notes."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from wonderland_edge_agent.spool.errors import SpoolError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wonderland_edge_agent.spool.database import SpoolDatabase


class AgentState:
    """Each method has done all that it says, durably, or raised `SpoolError` and changed nothing."""

    def __init__(self, database: SpoolDatabase) -> None:
        self._database = database
        self._db = database.connection

    def put_secrets(self, secrets: Mapping[str, bytes]) -> None:
        """Store secrets under new names. Raises `SpoolError` for a name that exists."""
        with self._database.transaction():
            for name, value in secrets.items():
                if self._db.execute("SELECT 1 FROM secrets WHERE name = ?", (name,)).fetchone():
                    raise SpoolError(f"{self._database.what}: a secret {name!r} exists already")
                self._db.execute("INSERT INTO secrets VALUES (?, ?)", (name, value))

    def take_secret(self, name: str) -> bytes | None:
        """A secret, which is durably gone from here with that; None when there is none (any more)."""
        secret = self._database.with_reserve(partial(self._take_secret, name))
        if secret is not None:
            # The log still holds the page with the secret: put the overwritten one in its place, and cut the log.
            self._database.checkpoint()
        return secret

    def _take_secret(self, name: str) -> bytes | None:
        with self._database.transaction():
            row = self._db.execute("SELECT value FROM secrets WHERE name = ?", (name,)).fetchone()
            if row is None:
                return None
            self._db.execute("DELETE FROM secrets WHERE name = ?", (name,))
        return bytes(row[0])

    def secret_names(self) -> list[str]:
        """Names of the secrets that are there."""
        with self._database.reading():
            return [name for (name,) in self._db.execute("SELECT name FROM secrets ORDER BY name")]

    def put_session(self, session_id: str, state: bytes) -> None:
        """Store or replace the state of a session in progress."""
        self._execute("INSERT OR REPLACE INTO sessions VALUES (?, ?)", session_id, state)

    def remove_session(self, session_id: str) -> None:
        """Forget a session that has ended."""
        self._execute("DELETE FROM sessions WHERE session_id = ?", session_id)

    def sessions(self) -> dict[str, bytes]:
        """Sessions in progress: after a start, those that a crash or power cut interrupted."""
        with self._database.reading():
            return dict(self._db.execute("SELECT session_id, state FROM sessions ORDER BY session_id").fetchall())

    def put_note(self, name: str, value: bytes) -> None:
        """Store or replace a small value of the agent's own, for example where it stands in the event stream."""
        self._execute("INSERT OR REPLACE INTO notes VALUES (?, ?)", name, value)

    def note(self, name: str) -> bytes | None:
        """A value of the agent's own; None when it was never put."""
        with self._database.reading():
            row = self._db.execute("SELECT value FROM notes WHERE name = ?", (name,)).fetchone()
        return None if row is None else bytes(row[0])

    def _execute(self, statement: str, *values: str | bytes) -> None:
        def work() -> None:
            with self._database.transaction():
                self._db.execute(statement, values)

        self._database.with_reserve(work)
