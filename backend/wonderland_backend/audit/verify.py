"""Checking the log: each row against its hash and the row before, and the chain against the heads on the ledger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from wonderland_backend.audit import queries
from wonderland_backend.audit.anchors import Anchors
from wonderland_backend.audit.store import START, hash_of
from wonderland_backend.db.engine import Database
from wonderland_fabric_gateway.errors import LedgerError

CHUNK: Final = 1_000


@dataclass
class Result:
    """What a check has found."""

    rows: int = 0
    broken_seq: int | None = None
    """The first row that is not what it was, or is missing."""
    ledger: Literal["checked", "off", "away"] = "off"
    anchors: int = 0
    anchored_seq: int | None = None
    anchored_ms: int | None = None
    contradicted_tx: str | None = None
    """The transaction whose head the log does not have."""

    @property
    def ok(self) -> bool:
        """Whether nothing speaks against the log."""
        return self.broken_seq is None and self.contradicted_tx is None

    def to_json(self) -> dict[str, Any]:
        """As REST shows it."""
        content = {"ok": self.ok, **vars(self)}
        return {name: value for name, value in content.items() if value is not None}

    def to_text(self) -> str:
        """For people."""
        if self.broken_seq is not None:
            return f"Row {self.broken_seq} is missing, or is not what it was."
        if self.contradicted_tx is not None:
            return f"The log does not have the head that transaction {self.contradicted_tx} wrote to the ledger."
        chain = f"{self.rows} rows, each as it was written."
        if self.ledger == "away":
            return f"{chain} The ledger could not be asked for its heads."
        if self.ledger == "off":
            return f"{chain} Not compared with the ledger: give --connection."
        if self.anchored_seq is None:
            return f"{chain} The ledger has no head of this log yet."
        return f"{chain} The ledger vouches for them up to row {self.anchored_seq} ({self.anchors} heads compared)."


async def verify(database: Database, anchors: Anchors | None, now_ms: int) -> Result:
    """Check everything, in one snapshot of the log. A ledger that is away leaves its part unchecked, and says so."""
    result = Result()
    hashes, first_ms = await _walk(database, result)
    if anchors is None:
        return result
    try:
        found = await anchors.all(first_ms, now_ms)
    except LedgerError:
        result.ledger = "away"
        return result
    result.ledger = "checked"
    for anchor in found:
        result.anchors += 1
        if not 0 < anchor.seq <= len(hashes) or hashes[anchor.seq - 1] != anchor.sha256:
            result.contradicted_tx = anchor.tx_id
            break
        result.anchored_seq, result.anchored_ms = anchor.seq, anchor.t_ms
    return result


async def _walk(database: Database, result: Result) -> tuple[list[str], int]:
    """The rows' hashes in order, as far as they hold, and the time of the first."""
    hashes: list[str] = []
    first_ms: int | None = None
    previous = START
    async with database.read() as session:
        while True:
            chunk = await queries.rows_after(session, len(hashes), CHUNK)
            for content in chunk:
                first_ms = content["t_ms"] if first_ms is None else first_ms
                fits = content["seq"] == len(hashes) + 1 and content["previous_sha256"] == previous
                if not fits or hash_of(content) != content["sha256"]:
                    result.broken_seq = len(hashes) + 1
                    result.rows = len(hashes)
                    return hashes, first_ms or 0
                previous = content["sha256"]
                hashes.append(previous)
            if len(chunk) < CHUNK:
                break
    result.rows = len(hashes)
    return hashes, first_ms or 0
