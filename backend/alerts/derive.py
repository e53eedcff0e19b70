"""Alerts that follow from the ledger alone: made in the mirror's own database transaction, so that none is lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import orjson

from backend.alerts.kinds import Alert


def _refutation(record: dict[str, Any]) -> tuple[str, int | None]:
    """By what a verdict refuted: (kind of alert, how far off the claim is)."""
    for kind, name in (("refuted", "signed"), ("broadcast_contradicts", "broadcast")):
        judgement = record.get(name)
        if judgement is not None and judgement.get("outcome") == "refuted":
            return kind, judgement.get("error_mm")
    # The two-way ranges agree with the claim, and what needs no word of the drone's clock does not: it bent its own.
    differences = record.get("time_differences") or record.get("witness") or {}
    return "stamps_contradict", differences.get("error_mm")


def alerts_of(verdicts: Iterable[dict[str, Any]]) -> Iterator[Alert]:
    """The alerts of verdict rows (of `backend.mirror.derive`), in their order."""
    for row in verdicts:
        record = orjson.loads(row["record"])
        place = {
            "pad_id": row["pad_id"],
            "uav_id": row["uav_id"],
            "session_id": row["session_id"],
            "tx_id": row["tx_id"],
        }
        facts: dict[str, Any] = {"action": row["action"]}
        if row["outcome"] == "refuted":
            kind, error_mm = _refutation(record)
            if error_mm is not None:
                facts["error_mm"] = error_mm
            yield Alert(kind, row["session_id"], row["decided_ms"], **place, facts=facts)
        if record.get("authorised") is False:
            yield Alert("unauthorised", row["session_id"], row["decided_ms"], **place, facts={"action": row["action"]})
