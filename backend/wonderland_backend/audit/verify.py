"""Checking the log: each row against its hash and the row before, and every head on the ledger against the rows.

The ledger comes first: its heads say which rows there were, and until when. A log that is whole by itself but lacks
one of them, has rows that are dated later than the head above them, or has rows that no head ever covered, is not what
it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from wonderland.proofs.records.audit import AuditHead
from wonderland_backend.audit import queries
from wonderland_backend.audit.anchors import ANCHORED, Anchors
from wonderland_backend.audit.store import START, hash_of
from wonderland_backend.db.engine import Database
from wonderland_fabric_gateway.errors import LedgerError

CHUNK: Final = 1_000
SKEW_MS: Final = 60_000
"""How far the database's clock may be ahead of the ledger's."""
LATE_MS: Final = 3_600_000
"""A row that is older than this and stands above the last head should be on the ledger: it is anchored in minutes."""

_TEXTS: Final = {
    "broken_seq": "Row {} is missing, or is not what it was.",
    "misdated_seq": "Row {} is dated before the row above it, or after the head on the ledger that covers it.",
    "contradicted_tx": "The log does not have the head that transaction {} wrote to the ledger.",
    "lost_tx": "The log says that transaction {} anchored it; the ledger has no such head.",
    "late_seq": "Row {} is older than an hour and no head on the ledger covers it: is the log anchored at all?",
}


@dataclass
class Result:
    """What a check has found."""

    rows: int = 0
    broken_seq: int | None = None
    """The first row that is not what it was, or is missing."""
    misdated_seq: int | None = None
    """The first row that is dated before the one above it, or after the head that covers it."""
    ledger: Literal["checked", "off", "away"] = "off"
    anchors: int = 0
    anchored_seq: int | None = None
    anchored_ms: int | None = None
    contradicted_tx: str | None = None
    """The transaction whose head the log does not have."""
    lost_tx: str | None = None
    """A transaction that the log names as its anchor, and the ledger does not."""
    late_seq: int | None = None
    """The first row that no head covers, though it is old enough."""

    @property
    def ok(self) -> bool:
        """Whether nothing speaks against the log."""
        return self.rows > 0 and all(getattr(self, name) is None for name in _TEXTS)

    def to_json(self) -> dict[str, Any]:
        """As REST shows it."""
        content = {"ok": self.ok, **vars(self)}
        return {name: value for name, value in content.items() if value is not None}

    def to_text(self) -> str:
        """What was found, in a few sentences for the terminal."""
        against = [text.format(getattr(self, name)) for name, text in _TEXTS.items() if getattr(self, name) is not None]
        if against:
            return " ".join(against)
        if not self.rows:
            return "The log has no rows; that of a server that somebody has set up has. Is this its database?"
        chain = f"{self.rows} rows, each as it was written."
        if self.ledger == "away":
            return f"{chain} The ledger could not be asked for its heads."
        if self.ledger == "off":
            return (
                f"{chain} Not compared with the ledger: give --connection. Without heads on the ledger (audit_identity "
                "of the server), whoever holds the database can cut the log unseen."
            )
        if self.anchored_seq is None:
            return f"{chain} The ledger has no head of this log yet."
        return f"{chain} The ledger vouches for them up to row {self.anchored_seq} ({self.anchors} heads compared)."


async def verify(database: Database, anchors: Anchors | None, now_ms: int) -> Result:
    """Check everything, in one snapshot of the log. A ledger that is away leaves its part unchecked, and says so."""
    result = Result()
    heads: list[AuditHead] = []
    if anchors is not None:
        try:
            heads = await anchors.all()
        except LedgerError:
            result.ledger = "away"
        else:
            result.ledger = "checked"
    comparison = _Comparison(result, heads, now_ms)
    previous, previous_ms = START, 0
    async with database.read() as session:
        while True:
            chunk = await queries.rows_after(session, result.rows, CHUNK)
            for row in chunk:
                fits = row["seq"] == result.rows + 1 and row["previous_sha256"] == previous
                if not fits or hash_of(row) != row["sha256"]:
                    result.broken_seq = result.rows + 1
                    return result
                if row["t_ms"] < previous_ms and result.misdated_seq is None:
                    result.misdated_seq = row["seq"]
                if result.ledger == "checked":
                    comparison.add(row)
                previous, previous_ms = row["sha256"], row["t_ms"]
                result.rows += 1
            if len(chunk) < CHUNK:
                break
    comparison.end()
    return result


class _Comparison:
    """Rows, as they come in their order, against the heads, of which the oldest is the first."""

    def __init__(self, result: Result, heads: Sequence[AuditHead], now_ms: int) -> None:
        self._result = result
        self._now_ms = now_ms
        self._known = {head.tx_id for head in heads}
        self._heads = iter(heads)
        self._next = next(self._heads, None)

    def add(self, row: Mapping[str, Any]) -> None:
        """The next row."""
        result, head = self._result, self._next
        latest_ms = SKEW_MS + (self._now_ms if head is None else head.anchored_ms)
        if row["t_ms"] > latest_ms and result.misdated_seq is None:
            result.misdated_seq = row["seq"]
        anchored = row["act"] == ANCHORED
        if anchored and row["tx_id"] not in self._known and result.lost_tx is None:
            result.lost_tx = row["tx_id"]
        if head is None:
            late = row["t_ms"] < self._now_ms - LATE_MS and not anchored
            if late and result.late_seq is None:
                result.late_seq = row["seq"]
        elif row["seq"] == head.seq:
            self._take(head, fits=row["sha256"] == head.sha256)

    def end(self) -> None:
        """There are no more rows."""
        if self._next is not None and self._result.contradicted_tx is None:
            self._result.contradicted_tx = self._next.tx_id

    def _take(self, head: AuditHead, *, fits: bool) -> None:
        result = self._result
        if not fits and result.contradicted_tx is None:
            result.contradicted_tx = head.tx_id
        if result.contradicted_tx is None:
            result.anchors += 1
            result.anchored_seq, result.anchored_ms = head.seq, head.anchored_ms
        self._next = next(self._heads, None)
