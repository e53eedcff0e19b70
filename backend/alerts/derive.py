"""Alerts that follow from the ledger alone: made in the mirror's own database transaction, so that none is lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import orjson

from backend.alerts.kinds import Alert


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
        signed, broadcast = record.get("signed"), record.get("broadcast")
        facts: dict[str, Any] = {"action": row["action"]}
        if row["outcome"] == "refuted":
            lied = signed is not None and signed.get("outcome") == "refuted"
            judged = signed if lied else broadcast
            if judged is not None:
                facts["error_mm"] = judged.get("error_mm")
            kind = "refuted" if lied or broadcast is None else "broadcast_contradicts"
            yield Alert(kind, row["session_id"], row["decided_ms"], **place, facts=facts)
        if record.get("authorised") is False:
            yield Alert("unauthorised", row["session_id"], row["decided_ms"], **place, facts={"action": row["action"]})
