"""The spool's synchronous core: one SQLite connection, used by one thread at a time.

Every number from the last acknowledged on is a stored record or lies in a marker's range. A method has either done
all that it says, durably, or raised and changed nothing.
"""

from __future__ import annotations

import contextlib
import uuid
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

from wonderland import telemetry
from wonderland.proofs import encoding
from wonderland.telemetry import Dropped, SpoolHealth
from wonderland_edge_agent.spool.database import SpoolDatabase
from wonderland_edge_agent.spool.errors import SpoolCorruptError, SpoolError, SpoolFull
from wonderland_edge_agent.spool.schema import EVIDENCE, MARKER, TELEMETRY
from wonderland_edge_agent.spool.state import AgentState

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

ROW_BYTES: Final = 64
"""What a row costs besides its body: numbers, index entry, its share of a page."""
MIN_QUOTA_BYTES: Final = 256 * 1024


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

    def health(self) -> SpoolHealth:
        """The ``spool`` part of a health record."""
        return SpoolHealth(records=self.records, bytes=self.bytes, dropped=self.dropped)


@dataclass(slots=True)
class _Totals:
    """What the tables hold, kept in memory so that no write has to count."""

    spool: str
    last_seq: int
    acknowledged: int
    dropped: int
    records: int
    telemetry_bytes: int
    kept_bytes: int
    """Evidence, and markers with it."""
    lost: int = 0
    """Telemetry given up before it had a number; the next write marks it."""


class SpoolStore:
    """Records by number, and the agent's own state in `state`. Raises `SpoolError` only."""

    def __init__(self, path: Path, *, owner: str, quota_bytes: int, reserve_bytes: int) -> None:
        if quota_bytes < MIN_QUOTA_BYTES:
            raise SpoolError(f"a quota of {quota_bytes} bytes is too small; give at least {MIN_QUOTA_BYTES}")
        self._quota = quota_bytes
        self._headroom = max(quota_bytes // 16, 64 * 1024)
        # Pages fill only in part: the file may take twice what is counted before SQLite stops it.
        max_bytes = 2 * quota_bytes + (1 << 20)
        self._database = SpoolDatabase(path, owner=owner, max_bytes=max_bytes, reserve_bytes=reserve_bytes)
        self._db = self._database.connection
        self.state = AgentState(self._database)
        """Secrets, sessions in progress and notes of the agent."""
        try:
            self._totals = self._count()
        except SpoolError:
            self._database.close()
            raise

    def _count(self) -> _Totals:
        with self._database.reading():
            meta = dict(self._db.execute("SELECT name, value FROM meta").fetchall())
            sizes = {
                int(number): (int(rows), int(size) + int(rows) * ROW_BYTES)
                for number, rows, size in self._db.execute(
                    "SELECT class, count(*), coalesce(sum(length(body)), 0) FROM records GROUP BY class"
                )
            }
        try:
            return _Totals(
                spool=str(meta["spool"]),
                last_seq=int(meta["last_seq"]),
                acknowledged=int(meta["acknowledged"]),
                dropped=int(meta["dropped"]),
                records=sum(rows for rows, _ in sizes.values()),
                telemetry_bytes=sizes.get(TELEMETRY, (0, 0))[1],
                kept_bytes=sizes.get(EVIDENCE, (0, 0))[1] + sizes.get(MARKER, (0, 0))[1],
            )
        except (KeyError, ValueError, TypeError) as cause:
            raise SpoolCorruptError(
                f"{self._database.what}: its numbers cannot be read; move the directory aside"
            ) from cause

    def close(self) -> None:
        """Give the file back; everything stored stays."""
        self._database.close()

    @property
    def degraded(self) -> bool:
        """Whether the disk was full, and `maintain` has not found yet that it no longer is."""
        return self._database.degraded

    def maintain(self) -> None:
        """Look whether a full disk has room again."""
        self._database.maintain()

    @property
    def status(self) -> SpoolStatus:
        """Where the spool stands."""
        totals = self._totals
        reason = ""
        if self.degraded:
            reason = "the disk is full: free space on it"
        elif totals.kept_bytes + self._headroom > self._quota:
            reason = "unsent evidence fills the spool: restore the connection to the server, or raise the quota"
        return SpoolStatus(
            spool=totals.spool,
            records=totals.records,
            bytes=totals.telemetry_bytes + totals.kept_bytes,
            evidence_bytes=totals.kept_bytes,
            dropped=totals.dropped + totals.lost,
            last_seq=totals.last_seq,
            acknowledged=totals.acknowledged,
            reason=reason,
        )

    def write(self, entries: Sequence[Entry], lost: int = 0) -> list[int | SpoolFull]:
        """Store entries in one durable transaction; their numbers, or why one of them found no room.

        ``lost`` telemetry records were given up before they came here: a marker says so. When the disk is full,
        telemetry is given up, too; for evidence the reserve is released. Raises `SpoolFull` when even that did not
        help, or there was no evidence; then nothing of the batch is stored.
        """
        self._totals.lost += lost
        evidence = [entry for entry in entries if entry.evidence]
        try:
            return self._write(entries)
        except SpoolFull:
            self._database.note_full()
            self._totals.lost += len(entries) - len(evidence)
            if not evidence or not self._database.use_reserve():
                raise
        except SpoolError:
            self._totals.lost += len(entries) - len(evidence)
            raise
        with contextlib.suppress(SpoolError):
            self._drop_all_telemetry()
        numbers = iter(self._write(evidence))
        full = SpoolFull(f"{self._database.what}: the disk is full; this telemetry was dropped")
        return [next(numbers) if entry.evidence else full for entry in entries]

    def _write(self, entries: Sequence[Entry]) -> list[int | SpoolFull]:
        results: list[int | SpoolFull] = []
        with self._transaction():
            seq = self._totals.last_seq
            if self._totals.lost:
                self._mark(seq + 1, seq + self._totals.lost)
                seq += self._totals.lost
                self._totals.dropped += self._totals.lost
                self._totals.lost = 0
                self._save("dropped", self._totals.dropped)
            rows: list[tuple[int, int, str, int, bytes]] = []
            kept, telemetry = self._totals.kept_bytes, self._totals.telemetry_bytes
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
            self._totals.records += len(rows)
            self._totals.kept_bytes, self._totals.telemetry_bytes, self._totals.last_seq = kept, telemetry, seq
            if telemetry and kept + telemetry > self._quota:
                # A little more than needed, so that not every write drops.
                self._drop_telemetry(kept + telemetry - self._quota + self._quota // 8)
            self._save("last_seq", self._totals.last_seq)
        return results

    def pending(self, after_seq: int, max_records: int, max_bytes: int) -> list[StoredRecord]:
        """What follows a number, in order; at least one record if there is any, else within both limits."""
        found: list[StoredRecord] = []
        size = 0
        with (
            self._database.reading(),
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
        if seq > self._totals.last_seq:
            raise SpoolError(
                f"{self._database.what}: {seq} was acknowledged, but the last record is {self._totals.last_seq}"
            )
        if seq > self._totals.acknowledged:
            self._database.with_reserve(partial(self._acknowledge, seq))

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
            self._totals.acknowledged = seq
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
            self._totals = replace(self._count(), lost=self._totals.lost)

    # Inside

    def _drop_all_telemetry(self) -> None:
        with self._transaction():
            self._drop_telemetry(self._totals.telemetry_bytes)

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
        self._totals.telemetry_bytes -= freed
        self._totals.records -= rows
        self._totals.dropped += rows
        self._save("dropped", self._totals.dropped)
        self._mark_gaps(last)

    def _mark_gaps(self, last: int) -> None:
        """One marker for each gap between the evidence up to ``last``, in place of those that were there."""
        for seq, body in self._db.execute(
            "SELECT seq, body FROM records WHERE class = ? AND seq <= ?", (MARKER, last)
        ).fetchall():
            self._unmark(seq, body)
        before = self._totals.acknowledged
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
        body = telemetry.canonical(Dropped(from_seq=from_seq, to_seq=to_seq))
        self._db.execute("INSERT INTO records VALUES (?, ?, ?, ?, ?)", (to_seq, MARKER, Dropped.KIND, t_ms, body))
        self._totals.records += 1
        self._totals.kept_bytes += ROW_BYTES + len(body)

    def _unmark(self, seq: int, body: bytes) -> None:
        self._db.execute("DELETE FROM records WHERE seq = ?", (seq,))
        self._forget(MARKER, 1, len(body))

    def _forget(self, number: int, rows: int, size: int) -> None:
        self._totals.records -= rows
        if number == TELEMETRY:
            self._totals.telemetry_bytes -= size + rows * ROW_BYTES
        else:
            self._totals.kept_bytes -= size + rows * ROW_BYTES

    def _save(self, name: str, value: int | str) -> None:
        self._db.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))

    def _quota_full(self) -> SpoolFull:
        return SpoolFull(
            f"{self._database.what}: {self._totals.kept_bytes} bytes of unsent evidence fill the quota of "
            f"{self._quota}; restore the connection to the server, or raise the quota"
        )

    @contextlib.contextmanager
    def _transaction(self, *, durable: bool = True) -> Iterator[None]:
        """All or nothing, in the file as in the totals."""
        before = replace(self._totals)
        try:
            with self._database.transaction(durable=durable):
                yield
        except BaseException:
            self._totals = before
            raise


def _range(body: bytes) -> tuple[int, int]:
    """(from, to) of a marker."""
    value = encoding.decode(body)
    return value["from_seq"], value["to_seq"]
