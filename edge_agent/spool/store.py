"""The spool's synchronous core: one SQLite connection, used by one thread at a time.

Every number from the last acknowledged on is a stored record or lies in a marker's range. A method has either done
all that it says, durably, or raised and changed nothing.
"""

from __future__ import annotations

import contextlib
import sqlite3
import uuid
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar

from edge_agent.spool.errors import SpoolCorruptError, SpoolError, SpoolFull
from edge_agent.spool.reserve import DiskReserve
from edge_agent.spool.schema import EVIDENCE, MARKER, TELEMETRY, open_database, translated
from wonderland.proofs import encoding

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

ROW_BYTES: Final = 64
"""What a row costs besides its body: numbers, index entry, its share of a page."""
MIN_QUOTA_BYTES: Final = 256 * 1024
DROPPED: Final = "dropped"

_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Entry:
    """A record to be stored; ``body`` is canonical JSON. ``ends_session`` is removed in the same transaction."""

    kind: str
    t_ms: int
    body: bytes
    evidence: bool
    ends_session: str | None = None

    @property
    def bytes(self) -> int:
        """What it counts against the quota."""
        return ROW_BYTES + len(self.body)


@dataclass(frozen=True, slots=True)
class StoredRecord:
    """A record that the server has not acknowledged; ``body`` is canonical JSON."""

    seq: int
    kind: str
    t_ms: int
    body: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoolStatus:
    """Where a spool stands. ``reason`` says why no new session can be accepted; "" while it can."""

    spool: str
    records: int
    bytes: int
    evidence_bytes: int
    dropped: int
    last_seq: int
    acknowledged: int
    reason: str = ""

    def health(self) -> dict[str, int]:
        """The ``spool`` part of a health record."""
        return {"records": self.records, "bytes": self.bytes, "dropped": self.dropped}


class SpoolStore:
    """Records by number, secrets, sessions in progress and notes of the agent. Raises `SpoolError` only."""

    def __init__(self, path: Path, *, owner: str, quota_bytes: int, reserve_bytes: int) -> None:
        if quota_bytes < MIN_QUOTA_BYTES:
            raise SpoolError(f"a quota of {quota_bytes} bytes is too small; give at least {MIN_QUOTA_BYTES}")
        self._what = f"spool {path}"
        self._quota = quota_bytes
        self._headroom = max(quota_bytes // 16, 64 * 1024)
        self._reserve = DiskReserve(path.with_suffix(".reserve"), reserve_bytes)
        self._disk_full = False
        self._lost = 0
        # Pages fill only in part: the file may take twice what is counted before SQLite stops it.
        max_bytes = 2 * quota_bytes + (1 << 20)
        try:
            self._db = open_database(path, owner=owner, max_bytes=max_bytes)
        except SpoolFull:
            # Even to read takes a little space; the agent must be able to start and end what was interrupted.
            if not self._reserve.release():
                raise
            self._disk_full = True
            self._db = open_database(path, owner=owner, max_bytes=max_bytes)
        self._reserve.restore()
        try:
            self._load()
        except sqlite3.Error as cause:
            self._db.close()
            raise translated(cause, self._what) from cause
        except (KeyError, ValueError, TypeError) as cause:
            self._db.close()
            raise SpoolCorruptError(f"{self._what}: its numbers cannot be read; move the directory aside") from cause

    def _load(self) -> None:
        meta = dict(self._db.execute("SELECT name, value FROM meta").fetchall())
        self._spool = str(meta["spool"])
        self._last_seq = int(meta["last_seq"])
        self._acknowledged = int(meta["acknowledged"])
        self._dropped = int(meta["dropped"])
        totals = {
            int(number): (int(rows), int(size) + int(rows) * ROW_BYTES)
            for number, rows, size in self._db.execute(
                "SELECT class, count(*), coalesce(sum(length(body)), 0) FROM records GROUP BY class"
            )
        }
        self._records = sum(rows for rows, _ in totals.values())
        self._telemetry_bytes = totals.get(TELEMETRY, (0, 0))[1]
        self._kept_bytes = totals.get(EVIDENCE, (0, 0))[1] + totals.get(MARKER, (0, 0))[1]

    def close(self) -> None:
        """Give the file back; everything stored stays."""
        with contextlib.suppress(sqlite3.Error):
            self._db.close()

    @property
    def degraded(self) -> bool:
        """Whether the disk was full, and `maintain` has not found yet that it no longer is."""
        return self._disk_full or not self._reserve.held

    @property
    def status(self) -> SpoolStatus:
        """Where the spool stands."""
        reason = ""
        if self.degraded:
            reason = "the disk is full: free space on it"
        elif self._kept_bytes + self._headroom > self._quota:
            reason = "unsent evidence fills the spool: restore the connection to the server, or raise the quota"
        return SpoolStatus(
            spool=self._spool,
            records=self._records,
            bytes=self._telemetry_bytes + self._kept_bytes,
            evidence_bytes=self._kept_bytes,
            dropped=self._dropped + self._lost,
            last_seq=self._last_seq,
            acknowledged=self._acknowledged,
            reason=reason,
        )

    # Records

    def write(self, entries: Sequence[Entry], lost: int = 0) -> list[int | SpoolFull]:
        """Store entries in one durable transaction; their numbers, or why one of them found no room.

        ``lost`` telemetry records were given up before they came here: a marker says so. When the disk is full,
        telemetry is given up, too; for evidence the reserve is released. Raises `SpoolFull` when even that did not
        help, or there was no evidence; then nothing of the batch is stored.
        """
        self._lost += lost
        evidence = [entry for entry in entries if entry.evidence]
        try:
            return self._write(entries)
        except SpoolFull:
            self._disk_full = True
            self._lost += len(entries) - len(evidence)
            if not evidence or not self._reserve.release():
                raise
        except SpoolError:
            self._lost += len(entries) - len(evidence)
            raise
        with contextlib.suppress(SpoolError):
            self._drop_all_telemetry()
        numbers = iter(self._write(evidence))
        full = SpoolFull(f"{self._what}: the disk is full; this telemetry was dropped")
        return [next(numbers) if entry.evidence else full for entry in entries]

    def _write(self, entries: Sequence[Entry]) -> list[int | SpoolFull]:
        results: list[int | SpoolFull] = []
        with self._transaction():
            seq = self._last_seq
            if self._lost:
                self._mark(seq + 1, seq + self._lost)
                seq += self._lost
                self._dropped += self._lost
                self._lost = 0
                self._save("dropped", self._dropped)
            rows: list[tuple[int, int, str, int, bytes]] = []
            kept, telemetry = self._kept_bytes, self._telemetry_bytes
            for entry in entries:
                size = entry.bytes
                if entry.evidence:
                    if kept + size > self._quota:
                        results.append(self._quota_full())
                        continue
                    kept += size
                else:
                    telemetry += size
                seq += 1
                results.append(seq)
                rows.append((seq, EVIDENCE if entry.evidence else TELEMETRY, entry.kind, entry.t_ms, entry.body))
                if entry.ends_session is not None:
                    self._db.execute("DELETE FROM sessions WHERE session_id = ?", (entry.ends_session,))
            self._db.executemany("INSERT INTO records VALUES (?, ?, ?, ?, ?)", rows)
            self._records += len(rows)
            self._kept_bytes, self._telemetry_bytes, self._last_seq = kept, telemetry, seq
            if telemetry and kept + telemetry > self._quota:
                # A little more than needed, so that not every write drops.
                self._drop_telemetry(kept + telemetry - self._quota + self._quota // 8)
            self._save("last_seq", self._last_seq)
        return results

    def pending(self, after_seq: int, max_records: int, max_bytes: int) -> list[StoredRecord]:
        """What follows a number, in order; at least one record if there is any, else within both limits."""
        found: list[StoredRecord] = []
        size = 0
        with (
            self._reading(),
            contextlib.closing(
                self._db.execute(
                    "SELECT seq, kind, t_ms, body FROM records WHERE seq > ? ORDER BY seq LIMIT ?",
                    (after_seq, max_records),
                )
            ) as rows,
        ):
            for seq, kind, t_ms, body in rows:
                size += ROW_BYTES + len(body)
                if found and size > max_bytes:
                    break
                found.append(StoredRecord(seq, kind, t_ms, body))
        return found

    def acknowledge(self, seq: int) -> None:
        """Forget everything up to a number that the server holds durably. Raises `SpoolError` for one never given.

        Needs no disk flush: a forgotten acknowledgement only has the server say it again.
        """
        if seq > self._last_seq:
            raise SpoolError(f"{self._what}: {seq} was acknowledged, but the last record is {self._last_seq}")
        if seq > self._acknowledged:
            self._with_reserve(partial(self._acknowledge, seq))

    def _acknowledge(self, seq: int) -> None:
        with self._transaction(durable=False):
            for number, rows, size in self._db.execute(
                "SELECT class, count(*), sum(length(body)) FROM records WHERE seq <= ? GROUP BY class", (seq,)
            ).fetchall():
                self._forget(number, rows, size)
            self._db.execute("DELETE FROM records WHERE seq <= ?", (seq,))
            marker = self._db.execute(
                "SELECT seq, body FROM records WHERE seq > ? AND class = ? ORDER BY seq LIMIT 1", (seq, MARKER)
            ).fetchone()
            if marker is not None and _range(marker[1])[0] <= seq:
                self._unmark(marker[0], marker[1])
                self._mark(seq + 1, marker[0])
            self._acknowledged = seq
            self._save("acknowledged", seq)

    def renew(self) -> None:
        """Begin a new spool with what is pending, numbered from 1: for a server that knows more than this file does.

        That happens when the file was restored from a copy; under the old name the server would take new records for
        ones it has.
        """
        with self._transaction():
            rows = self._db.execute(
                "SELECT class, kind, t_ms, body FROM records WHERE class <> ? ORDER BY seq", (MARKER,)
            ).fetchall()
            self._db.execute("DELETE FROM records")
            self._db.executemany(
                "INSERT INTO records VALUES (?, ?, ?, ?, ?)", [(seq, *row) for seq, row in enumerate(rows, 1)]
            )
            for name, value in (("spool", uuid.uuid4().hex), ("last_seq", len(rows)), ("acknowledged", 0)):
                self._save(name, value)
            self._load()

    def maintain(self) -> None:
        """Try to leave the emergency: move the log into the file, take the reserve again, write something."""
        if not self.degraded:
            return
        with contextlib.suppress(sqlite3.Error):
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        if not self._reserve.restore():
            return
        with contextlib.suppress(SpoolError), self._transaction():
            self._save("dropped", self._dropped)
            self._disk_full = False

    # Secrets, sessions and notes

    def put_secrets(self, secrets: Mapping[str, bytes]) -> None:
        """Store secrets under new names. Raises `SpoolError` for a name that exists."""
        with self._transaction():
            for name, value in secrets.items():
                if self._db.execute("SELECT 1 FROM secrets WHERE name = ?", (name,)).fetchone():
                    raise SpoolError(f"{self._what}: a secret {name!r} exists already")
                self._db.execute("INSERT INTO secrets VALUES (?, ?)", (name, value))

    def take_secret(self, name: str) -> bytes | None:
        """A secret, which is durably gone from here with that; None when there is none (any more)."""
        secret = self._with_reserve(partial(self._take_secret, name))
        if secret is not None:
            # The log still holds the page with the secret: put the overwritten one in its place, and cut the log.
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        return secret

    def _take_secret(self, name: str) -> bytes | None:
        with self._transaction():
            row = self._db.execute("SELECT value FROM secrets WHERE name = ?", (name,)).fetchone()
            if row is None:
                return None
            self._db.execute("DELETE FROM secrets WHERE name = ?", (name,))
        return bytes(row[0])

    def secret_names(self) -> list[str]:
        """Names of the secrets that are there."""
        with self._reading():
            return [name for (name,) in self._db.execute("SELECT name FROM secrets ORDER BY name")]

    def put_session(self, session_id: str, state: bytes) -> None:
        """Store or replace the state of a session in progress."""
        self._execute("INSERT OR REPLACE INTO sessions VALUES (?, ?)", session_id, state)

    def remove_session(self, session_id: str) -> None:
        """Forget a session that has ended."""
        self._execute("DELETE FROM sessions WHERE session_id = ?", session_id)

    def sessions(self) -> dict[str, bytes]:
        """Sessions in progress: after a start, those that a crash or power cut interrupted."""
        with self._reading():
            return dict(self._db.execute("SELECT session_id, state FROM sessions ORDER BY session_id").fetchall())

    def put_note(self, name: str, value: bytes) -> None:
        """Store or replace a small value of the agent's own, for example where it stands in the event stream."""
        self._execute("INSERT OR REPLACE INTO notes VALUES (?, ?)", name, value)

    def note(self, name: str) -> bytes | None:
        """A value of the agent's own; None when it was never put."""
        with self._reading():
            row = self._db.execute("SELECT value FROM notes WHERE name = ?", (name,)).fetchone()
        return None if row is None else bytes(row[0])

    # Inside

    def _execute(self, statement: str, *values: str | bytes) -> None:
        def work() -> None:
            with self._transaction():
                self._db.execute(statement, values)

        self._with_reserve(work)

    def _with_reserve(self, work: Callable[[], _Result]) -> _Result:
        """Do what a running session needs, in the reserve's space when there is no other."""
        try:
            return work()
        except SpoolFull:
            self._disk_full = True
            if not self._reserve.release():
                raise
        return work()

    def _drop_all_telemetry(self) -> None:
        with self._transaction():
            self._drop_telemetry(self._telemetry_bytes)

    def _drop_telemetry(self, needed_bytes: int) -> None:
        """Delete the oldest telemetry until that much is free, and say so in markers."""
        last = freed = rows = 0
        for seq, size in self._db.execute(
            "SELECT seq, length(body) FROM records WHERE class = ? ORDER BY seq", (TELEMETRY,)
        ):
            last, freed, rows = seq, freed + size + ROW_BYTES, rows + 1
            if freed >= needed_bytes:
                break
        if not rows:
            return
        self._db.execute("DELETE FROM records WHERE class = ? AND seq <= ?", (TELEMETRY, last))
        self._telemetry_bytes -= freed
        self._records -= rows
        self._dropped += rows
        self._save("dropped", self._dropped)
        self._mark_gaps(last)

    def _mark_gaps(self, last: int) -> None:
        """One marker for each gap between the evidence up to ``last``, in place of those that were there."""
        for seq, body in self._db.execute(
            "SELECT seq, body FROM records WHERE class = ? AND seq <= ?", (MARKER, last)
        ).fetchall():
            self._unmark(seq, body)
        before = self._acknowledged
        for (seq,) in self._db.execute(
            "SELECT seq FROM records WHERE class = ? AND seq <= ? ORDER BY seq", (EVIDENCE, last)
        ).fetchall():
            if seq > before + 1:
                self._mark(before + 1, seq - 1)
            before = seq
        if before >= last:
            return
        following = self._db.execute(
            "SELECT seq, body FROM records WHERE class = ? AND seq > ? ORDER BY seq LIMIT 1", (MARKER, last)
        ).fetchone()
        if following is not None and _range(following[1])[0] == last + 1:
            self._unmark(following[0], following[1])
            last = following[0]
        self._mark(before + 1, last)

    def _mark(self, from_seq: int, to_seq: int) -> None:
        row = self._db.execute("SELECT t_ms FROM records ORDER BY seq DESC LIMIT 1").fetchone()
        t_ms = 0 if row is None else row[0]
        body = encoding.encode({"from_seq": from_seq, "to_seq": to_seq})
        self._db.execute("INSERT INTO records VALUES (?, ?, ?, ?, ?)", (to_seq, MARKER, DROPPED, t_ms, body))
        self._records += 1
        self._kept_bytes += ROW_BYTES + len(body)

    def _unmark(self, seq: int, body: bytes) -> None:
        self._db.execute("DELETE FROM records WHERE seq = ?", (seq,))
        self._forget(MARKER, 1, len(body))

    def _forget(self, number: int, rows: int, size: int) -> None:
        self._records -= rows
        if number == TELEMETRY:
            self._telemetry_bytes -= size + rows * ROW_BYTES
        else:
            self._kept_bytes -= size + rows * ROW_BYTES

    def _save(self, name: str, value: int | str) -> None:
        self._db.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))

    def _quota_full(self) -> SpoolFull:
        return SpoolFull(
            f"{self._what}: {self._kept_bytes} bytes of unsent evidence fill the quota of {self._quota}; "
            "restore the connection to the server, or raise the quota"
        )

    @contextlib.contextmanager
    def _transaction(self, *, durable: bool = True) -> Iterator[None]:
        """All or nothing, in the file as in the totals kept in memory."""
        totals = (
            self._last_seq, self._acknowledged, self._dropped, self._lost, self._records, self._telemetry_bytes,
            self._kept_bytes, self._spool,
        )  # fmt: skip
        try:
            if not durable:
                self._db.execute("PRAGMA synchronous = NORMAL")
            try:
                self._db.execute("BEGIN IMMEDIATE")
                yield
                self._db.execute("COMMIT")
            finally:
                if self._db.in_transaction:
                    with contextlib.suppress(sqlite3.Error):
                        self._db.execute("ROLLBACK")
                if not durable:
                    self._db.execute("PRAGMA synchronous = FULL")
        except BaseException as error:
            (
                self._last_seq, self._acknowledged, self._dropped, self._lost, self._records, self._telemetry_bytes,
                self._kept_bytes, self._spool,
            ) = totals  # fmt: skip
            if isinstance(error, sqlite3.Error):
                raise translated(error, self._what) from error
            raise

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as cause:
            raise translated(cause, self._what) from cause


def _range(body: bytes) -> tuple[int, int]:
    """(from, to) of a marker."""
    value = encoding.decode(body)
    return value["from_seq"], value["to_seq"]
