"""What the database knows about a drone's newest broadcast and proof."""

from __future__ import annotations

from typing import Any, Final

import orjson
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.conformance.rules import Broadcast, Measured
from wonderland_backend.db.tables.ledger import EvidenceRow, VerdictRow
from wonderland_backend.db.tables.reported import LatestTrackRow

LOOK_BACK: Final = 10
"""Among so many of the newest verdicts the newest one that settled something is looked for."""


async def heard(database: AsyncSession, uav_id: str) -> Broadcast | None:
    """The last broadcast position that any pad heard."""
    row = await database.get(LatestTrackRow, uav_id)
    if row is None:
        return None
    body = orjson.loads(row.body)
    t_ms = body.get("claim_t_ms", row.t_ms)
    return Broadcast(body["lat_e7"], body["lon_e7"], t_ms, body.get("accuracy_mm", 0))


async def newest(database: AsyncSession, uav_id: str) -> tuple[VerdictRow, VerdictRow] | None:
    """The verdict to judge by (the newest that settled something, else the newest), and the newest."""
    query = (
        select(VerdictRow)
        .where(VerdictRow.uav_id == uav_id)
        .order_by(VerdictRow.block.desc(), VerdictRow.tx_index.desc())
        .limit(LOOK_BACK)
    )
    rows = (await database.scalars(query)).all()
    if not rows:
        return None
    return next((row for row in rows if row.outcome != "inconclusive"), rows[0]), rows[0]


async def measured(database: AsyncSession, row: VerdictRow) -> Measured:
    """What a verdict says, at the moment of its estimate; in verdicts of former contracts at the last round."""
    record = orjson.loads(row.record)
    estimate, covariance = record.get("estimate"), record.get("covariance", {})
    evidence = await database.get(EvidenceRow, row.session_id)
    times = orjson.loads(evidence.record).get("ranges", {}).get("t_ms", []) if evidence is not None else []
    return Measured(
        t_ms=record.get("estimate_ms") or (times[-1] if times else row.decided_ms),
        outcome=row.outcome,
        assurance=record["assurance"],
        broadcast_outcome=record.get("broadcast", {}).get("outcome"),
        place=(estimate["lat_e7"], estimate["lon_e7"]) if estimate and covariance and _is_sound(record) else None,
        **covariance,
    )


def _is_sound(record: dict[str, Any]) -> bool:
    """Whether the measured place can be built on: not where time stamps contradict the ranges that it comes from."""
    timed = (record.get(name) for name in ("time_differences", "witness"))
    return all(each["agrees"] and each["finding"] in {"inside", "vague"} for each in timed if each is not None)
