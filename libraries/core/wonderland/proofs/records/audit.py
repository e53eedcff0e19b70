"""Heads of audit logs: whoever can rewrite a database cannot rewrite these."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.records.fields import Name, Sha256Hex, TimeMs
from wonderland.proofs.records.schema import Integer, Record, Text

MAX_HEADS = 500
"""In one answer: about 150 kB."""
LogId = Annotated[str, Text(64, r"[A-Za-z0-9_-]+", "Installation whose log it is", min_length=1)]
RowNumber = Annotated[int, Integer(1, 2**53 - 1, "Number of the log's last row")]
HeadNumber = Annotated[int, Integer(1, 2**53 - 1, "Counts the heads of one log, without a gap")]


@dataclass(frozen=True, kw_only=True, slots=True)
class AnchorAuditLog(Record):
    """Writes down where a log stands. One certificate's common name has one log, which nobody else can touch."""

    log: LogId
    seq: RowNumber
    sha256: Sha256Hex


@dataclass(frozen=True, kw_only=True, slots=True)
class AuditHead(Record):
    """The last row of an audit log at a time."""

    anchored_by: Name
    log: LogId
    number: HeadNumber
    seq: RowNumber
    sha256: Sha256Hex
    anchored_ms: TimeMs
    tx_id: Sha256Hex


@dataclass(frozen=True, kw_only=True, slots=True)
class AuditHeadsOf(Record):
    """Asks for the heads of somebody's log after a number, oldest first."""

    anchored_by: Name
    after: Annotated[int, Integer(0, 2**53 - 1)] = 0
    limit: Annotated[int, Integer(1, MAX_HEADS)] = MAX_HEADS
