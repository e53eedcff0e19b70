"""What a time scrubber shows: how much there is when, and where it is worth looking."""

from __future__ import annotations

from typing import Any, Final, Literal

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.db.tables.ledger import SessionRow, VerdictRow
from wonderland_backend.db.tables.reported import BlockArrivalRow, TrackMinuteRow
from wonderland_backend.person import Scope

MAX_MARKS: Final = 1_000
REFUSED: Final = "refused"
MINUTE_MS: Final = 60_000


async def stored(database: AsyncSession) -> tuple[int, int] | None:
    """From when until when there is anything (ms); None when there is nothing."""
    known: list[int] = []
    for first, last in (
        (TrackMinuteRow.minute_ms, TrackMinuteRow.minute_ms),
        (BlockArrivalRow.known_ms, BlockArrivalRow.known_ms),
        (AlertRow.raised_ms, AlertRow.changed_ms),
    ):
        for bound in (func.min(first), func.max(last)):
            found = await database.scalar(select(bound))
            known += [] if found is None else [found]
    return (min(known), max(known)) if known else None


async def density(
    database: AsyncSession, scope: Scope, *, from_ms: int, until_ms: int, buckets: int
) -> dict[str, list[int]]:
    """How many positions, sessions, refusals and alerts fell into each of so many equal parts of a span.

    Positions are counted by the minute, and only for those who see everything.
    """
    width = max(1, -(-(until_ms - from_ms) // buckets))

    async def counted(time: Any, query: Any) -> list[int]:
        bucket = ((time - from_ms) // width).label("bucket")
        found = [0] * buckets
        within = query.add_columns(bucket).where(time >= from_ms, time < until_ms).group_by(bucket)
        for count, index in await database.execute(within):
            found[int(index)] = int(count)
        return found

    number = func.count()
    theirs = {"pad": VerdictRow.pad_id, "drone": VerdictRow.uav_id}
    refusals = scope.narrow(select(number).where(VerdictRow.permission == REFUSED), **theirs)
    sessions = scope.narrow(select(number), pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    alerts = scope.narrow(select(number), pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    positions = [0] * buckets
    if scope.everything:
        positions = await counted(TrackMinuteRow.minute_ms, select(func.sum(TrackMinuteRow.positions)))
    return {
        "positions": positions,
        "sessions": await counted(SessionRow.requested_ms, sessions),
        "refusals": await counted(VerdictRow.decided_ms, refusals),
        "alerts": await counted(AlertRow.raised_ms, alerts),
    }


async def marks(database: AsyncSession, scope: Scope, *, from_ms: int, until_ms: int) -> list[dict[str, Any]]:
    """Verdicts and alerts of a span by when they became known, oldest first; of more than `MAX_MARKS` the newest."""
    verdicts = _verdicts(scope).where(BlockArrivalRow.known_ms.between(from_ms, until_ms))
    verdicts = verdicts.order_by(BlockArrivalRow.known_ms.desc()).limit(MAX_MARKS)
    found = [_verdict_mark(row) for row in await database.execute(verdicts)]
    alerts = select(AlertRow).where(AlertRow.raised_ms.between(from_ms, until_ms))
    alerts = scope.narrow(alerts, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    for alert in await database.scalars(alerts.order_by(AlertRow.raised_ms.desc()).limit(MAX_MARKS)):
        mark = {"kind": "alert", "t_ms": alert.raised_ms, "alert_id": alert.alert_id, "alert": alert.kind}
        mark |= {"severity": alert.severity, "pad_id": alert.pad_id, "uav_id": alert.uav_id}
        mark["session_id"] = alert.session_id
        found.append({name: value for name, value in mark.items() if value is not None})
    found.sort(key=lambda each: each["t_ms"])
    return found[-MAX_MARKS:]


async def refusal_beside(
    database: AsyncSession, scope: Scope, t_ms: int, direction: Literal["next", "previous"]
) -> dict[str, Any] | None:
    """The first refusal that became known after a time, or the last one before it."""
    query = _verdicts(scope).where(VerdictRow.permission == REFUSED)
    known = BlockArrivalRow.known_ms
    if direction == "next":
        query = query.where(known > t_ms).order_by(known, VerdictRow.block, VerdictRow.tx_index)
    else:
        query = query.where(known < t_ms).order_by(known.desc(), VerdictRow.block.desc(), VerdictRow.tx_index.desc())
    row = (await database.execute(query.limit(1))).first()
    return _verdict_mark(row) if row is not None else None


def _verdicts(scope: Scope) -> Any:
    query = select(VerdictRow, BlockArrivalRow.known_ms).join(
        BlockArrivalRow, BlockArrivalRow.number == VerdictRow.block
    )
    return scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)


def _verdict_mark(row: Any) -> dict[str, Any]:
    verdict, known_ms = row
    return {
        "kind": "refusal" if verdict.permission == REFUSED else "verdict",
        "t_ms": known_ms,
        "session_id": verdict.session_id,
        "outcome": verdict.outcome,
        "permission": verdict.permission,
        "pad_id": verdict.pad_id,
        "uav_id": verdict.uav_id,
    }
