"""A moment of the past, and what the live map showed at it.

What was known then counts, not what has become known since: the ledger as far as its blocks had been mirrored, what
agents' reports had been received, and what had been done about alerts. So nothing is read here without its time of
arrival: `block` for what the ledger says, `received_ms` for what agents said.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import orjson
from sqlalchemy import Select, and_, case, func, or_, select
from sqlalchemy.ext.asyncio import AsyncSession
from sqlalchemy.orm import aliased

from wonderland.proofs.records import keys
from wonderland_backend.alerts import store as alerts
from wonderland_backend.db.tables.alerts import AlertActRow, AlertRow
from wonderland_backend.db.tables.ledger import (
    EvidenceRow,
    PadRow,
    RecordVersionRow,
    SessionRow,
    TransactionRow,
    VerdictRow,
)
from wonderland_backend.db.tables.reported import (
    BlockArrivalRow,
    EstimateRow,
    LatestTrackRow,
    PadConnectionRow,
    PadHealthRow,
    StepRow,
    TrackRow,
)
from wonderland_backend.live.board import TRACK_AGE_MS
from wonderland_backend.live.queries import LAST_VERDICTS, MAX_TRACKS, RECENT_SESSIONS, Contents
from wonderland_backend.masking import shown_alert
from wonderland_backend.mirror.rows import OUTLINE, SessionWrite
from wonderland_backend.person import Person, Scope
from wonderland_backend.replay.store import CONFIRM_S
from wonderland_backend.sessions.state import ReportedStep, SessionView
from wonderland_backend.tracks.queries import MAX_AHEAD_MS
from wonderland_backend.verdicts import queries as verdicts

CLOCKS_MS: Final = 10 * 60_000
"""Sessions are dated by their drone's clock: those of this much later may have been known, too."""
MAX_ALERTS: Final = 4 * alerts.MAX_OPEN


@dataclass(frozen=True)
class Moment:
    """A time, and the last block that was known then (−1: none)."""

    t_ms: int
    block: int


async def moment(database: AsyncSession, t_ms: int) -> Moment:
    """The moment of this time (ms since the Unix epoch)."""
    query = select(BlockArrivalRow.number).where(BlockArrivalRow.known_ms <= t_ms)
    newest = query.order_by(BlockArrivalRow.known_ms.desc(), BlockArrivalRow.number.desc()).limit(1)
    block = await database.scalar(newest)
    return Moment(t_ms, -1 if block is None else block)


async def contents_at(database: AsyncSession, when: Moment, person: Person) -> Contents:
    """What a live board would have shown this person then."""
    found = Contents()
    scope = person.scope
    found.pads = await _pads(database, when, scope)
    found.drones = await _drones(database, when, scope)
    found.tracks = await _tracks(database, when, scope)
    found.sessions = await sessions_at(database, when, scope)
    found.estimates = await _estimates(database, when, found.sessions)
    found.verdicts = [verdicts.verdict_json(row) for row in reversed(await _verdicts(database, when, scope))]
    found.alerts = [shown_alert(each, person) for each in await open_alerts(database, when, scope)]
    found.counts = await _counts(database, when, scope)
    return found


async def connected_at(database: AsyncSession, t_ms: int) -> set[str]:
    """Pads whose agents were connected."""
    confirmed = PadConnectionRow.until_ms + int(2 * CONFIRM_S * 1000)
    until = case((PadConnectionRow.ended, PadConnectionRow.until_ms), else_=confirmed)
    # The plain comparison is for the index; the other one for connections that nobody ended.
    query = select(PadConnectionRow.pad_id).where(
        PadConnectionRow.until_ms > t_ms - int(2 * CONFIRM_S * 1000), PadConnectionRow.from_ms <= t_ms, until > t_ms
    )
    return set(await database.scalars(query))


async def sessions_at(
    database: AsyncSession, when: Moment, scope: Scope, session_ids: Sequence[str] | None = None
) -> list[SessionView]:
    """The recent sessions as they stood, oldest first; or these, where they are named."""
    query = _sessions(when).order_by(SessionRow.requested_ms.desc(), SessionRow.session_id.desc())
    query = scope.narrow(query, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    if session_ids is None:
        query = query.where(SessionRow.requested_ms <= when.t_ms + CLOCKS_MS).limit(RECENT_SESSIONS + 1)
    else:
        query = query.where(SessionRow.session_id.in_(session_ids))
    views: list[SessionView] = []
    for outline, decided, ended, outcome, permission, rounds, steps in (
        (row[: len(OUTLINE)], *row[len(OUTLINE) :]) for row in await database.execute(query)
    ):
        shown = outline_at(SessionWrite(*outline), decided=bool(decided), ended=bool(ended))
        view = SessionView(shown)
        if decided:
            view.outcome, view.permission, view.rounds = outcome, permission, rounds
        if decided or ended:
            view.take_evidence(steps)
        views.append(view)
    reported = await _reported(database, when, [view.session_id for view in views])
    for view in views:
        view.report(reported.get(view.session_id, ()))
    return list(reversed(views))


def outline_at(outline: SessionWrite, *, decided: bool, ended: bool) -> SessionWrite:
    """A session's outline before it was ended, or decided; it is changed."""
    if not ended:
        outline.state = "decided" if decided else "requested"
        outline.ended_ms = outline.end = outline.complete_tx = None
    if not decided:
        outline.decided_ms = outline.verdict_tx = None
    return outline


async def open_alerts(database: AsyncSession, when: Moment, scope: Scope) -> list[dict[str, Any]]:
    """The newest of the alerts that were open, oldest first."""
    query = (
        select(AlertRow)
        .where(AlertRow.raised_ms <= when.t_ms)
        .where(or_(AlertRow.state.in_(alerts.WAITING), AlertRow.changed_ms > when.t_ms))
        .order_by(AlertRow.t_ms.desc())
        .limit(MAX_ALERTS)
    )
    query = scope.narrow(query, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    rows = (await database.scalars(query)).all()
    shown = await alerts_at(database, rows, when.t_ms)
    opened = [each for each in shown if each["state"] in alerts.WAITING]
    return list(reversed(opened[: alerts.MAX_OPEN]))


async def alerts_at(database: AsyncSession, rows: Sequence[AlertRow], t_ms: int) -> list[dict[str, Any]]:
    """These alerts as they stood."""
    query = select(AlertActRow).where(
        AlertActRow.alert_id.in_([row.alert_id for row in rows]), AlertActRow.t_ms <= t_ms
    )
    acts: dict[str, list[AlertActRow]] = {}
    for act in await database.scalars(query.order_by(AlertActRow.revision)):
        acts.setdefault(act.alert_id, []).append(act)
    return [alert_at(row, acts.get(row.alert_id, ()), t_ms) for row in rows]


def alert_at(row: AlertRow, acts: Iterable[AlertActRow], t_ms: int) -> dict[str, Any]:
    """An alert as it stood: its row, and what had been done about it by then, in order."""
    now: dict[str, Any] = {"state": alerts.OPEN, "revision": 0, "changed_ms": row.raised_ms}
    now |= {"acknowledged_by": None, "assigned_to": None, "snoozed_until_ms": None, "over_ms": None}
    for act in acts:
        now |= {"revision": act.revision, "changed_ms": act.t_ms}
        match act.act:
            case "acknowledge":
                now |= {"state": alerts.ACKNOWLEDGED, "acknowledged_by": act.person, "snoozed_until_ms": None}
            case "reopen":
                now |= {"state": alerts.OPEN, "acknowledged_by": None, "snoozed_until_ms": None}
            case "assign":
                now["assigned_to"] = act.detail
            case "snooze":
                now["snoozed_until_ms"] = int(act.detail or 0)
    if row.over_ms is not None and row.over_ms <= t_ms:
        if row.changed_ms <= t_ms:
            now["revision"] = row.revision
        elif now["changed_ms"] < row.over_ms:
            now["revision"] += 1
        # What is over now without an acknowledgement never had to wait for one.
        waits = now["acknowledged_by"] is None and (row.state != alerts.OVER or row.acknowledged_by is not None)
        state = alerts.RETURNED if waits and row.severity != "notice" else alerts.OVER
        now |= {"state": state, "over_ms": row.over_ms, "changed_ms": max(now["changed_ms"], row.over_ms)}
    past = {column.name: getattr(row, column.name) for column in AlertRow.__table__.columns}
    return alerts.alert_json(AlertRow(**(past | now)))


async def _pads(database: AsyncSession, when: Moment, scope: Scope) -> list[tuple[str, str, str, str | None]]:
    place = func.row_number().over(
        partition_by=RecordVersionRow.key, order_by=(RecordVersionRow.block.desc(), RecordVersionRow.tx_index.desc())
    )
    versions = (
        select(RecordVersionRow.key, RecordVersionRow.record, place.label("place"))
        .where(RecordVersionRow.kind == keys.PAD, RecordVersionRow.block <= when.block)
        .subquery()
    )
    health = (
        select(PadHealthRow.body)
        .where(PadHealthRow.pad_id == PadRow.pad_id, PadHealthRow.received_ms <= when.t_ms)
        .order_by(PadHealthRow.received_ms.desc(), PadHealthRow.id.desc())
        .limit(1)
        .correlate(PadRow)
        .scalar_subquery()
    )
    query = (
        select(PadRow.pad_id, PadRow.msp_id, versions.c.record, health)
        .join(versions, and_(versions.c.key == PadRow.pad_id, versions.c.place == 1))
        .order_by(PadRow.pad_id)
    )
    query = scope.narrow(query, pad=PadRow.pad_id)
    return [(row[0], row[1], row[2], row[3]) for row in await database.execute(query)]


async def _drones(database: AsyncSession, when: Moment, scope: Scope) -> set[str]:
    query = select(RecordVersionRow.key).where(RecordVersionRow.kind == keys.UAV, RecordVersionRow.block <= when.block)
    return set(await database.scalars(scope.narrow(query, drone=RecordVersionRow.key).distinct()))


async def _tracks(database: AsyncSession, when: Moment, scope: Scope) -> list[tuple[str, int, str]]:
    """The last position of each drone: one look into an index for each drone that has been heard since."""
    oldest = when.t_ms - TRACK_AGE_MS
    newest = select(TrackRow.body).where(
        TrackRow.uav_id == LatestTrackRow.uav_id,
        TrackRow.t_ms.between(oldest, when.t_ms + MAX_AHEAD_MS),
        TrackRow.received_ms.between(oldest - MAX_AHEAD_MS, when.t_ms),
    )
    newest = (
        scope.narrow(newest, pad=TrackRow.pad_id, drone=TrackRow.uav_id)
        .order_by(TrackRow.t_ms.desc(), TrackRow.received_ms.desc(), TrackRow.id.desc())
        .limit(1)
        .correlate(LatestTrackRow)
        .scalar_subquery()
    )
    query = select(LatestTrackRow.uav_id, newest).where(LatestTrackRow.t_ms >= oldest).limit(MAX_TRACKS)
    found = [(row[0], int(orjson.loads(row[1])["t_ms"]), row[1]) for row in await database.execute(query) if row[1]]
    return sorted(found, key=lambda each: each[1])


def _sessions(when: Moment) -> Select[Any]:
    """Outlines with whether they were decided and ended, the verdict's columns, the steps of the evidence."""
    asked, ended = aliased(TransactionRow), aliased(TransactionRow)
    return (
        select(
            *(getattr(SessionRow, name) for name in OUTLINE),
            VerdictRow.session_id.is_not(None),
            ended.tx_id.is_not(None),
            VerdictRow.outcome,
            VerdictRow.permission,
            VerdictRow.rounds,
            EvidenceRow.steps,
        )
        .join(asked, _valid(asked, SessionRow.session_id, when))
        .outerjoin(ended, _valid(ended, SessionRow.complete_tx, when))
        .outerjoin(VerdictRow, and_(VerdictRow.session_id == SessionRow.session_id, VerdictRow.block <= when.block))
        .outerjoin(EvidenceRow, and_(EvidenceRow.session_id == SessionRow.session_id, EvidenceRow.block <= when.block))
    )


def _valid(transaction: Any, tx_id: Any, when: Moment) -> Any:
    return and_(transaction.tx_id == tx_id, transaction.validation_code == 0, transaction.block <= when.block)


async def _reported(database: AsyncSession, when: Moment, session_ids: list[str]) -> dict[str, list[ReportedStep]]:
    query = select(StepRow).where(StepRow.session_id.in_(session_ids), StepRow.received_ms <= when.t_ms)
    found: dict[str, list[ReportedStep]] = {}
    for each in await database.scalars(query.order_by(StepRow.received_ms)):
        step = ReportedStep(each.step, each.t_ms, each.ok, each.agent, each.detail, each.agent_id)
        found.setdefault(each.session_id, []).append(step)
    return found


async def _estimates(
    database: AsyncSession, when: Moment, sessions: Iterable[SessionView]
) -> list[tuple[str, str, str]]:
    """The last estimate of each drone that was being ranged."""
    under_way = {view.session_id: view for view in sessions if view.outline.state == "requested"}
    place = func.row_number().over(
        partition_by=EstimateRow.session_id, order_by=(EstimateRow.received_ms.desc(), EstimateRow.id.desc())
    )
    ranked = (
        select(EstimateRow.session_id, EstimateRow.uav_id, EstimateRow.pad_id, EstimateRow.body, place.label("place"))
        .where(EstimateRow.session_id.in_(list(under_way)), EstimateRow.received_ms <= when.t_ms)
        .subquery()
    )
    rows = await database.execute(select(ranked).where(ranked.c.place == 1))
    return [
        (row.uav_id, row.session_id, row.body) for row in rows if under_way[row.session_id].outline.pad_id == row.pad_id
    ]


async def _verdicts(database: AsyncSession, when: Moment, scope: Scope) -> Sequence[VerdictRow]:
    query = select(VerdictRow).where(VerdictRow.block <= when.block)
    query = query.order_by(VerdictRow.block.desc(), VerdictRow.tx_index.desc()).limit(LAST_VERDICTS)
    return (await database.scalars(scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id))).all()


async def _counts(database: AsyncSession, when: Moment, scope: Scope) -> dict[str, int]:
    outcomes = select(VerdictRow.outcome, func.count()).where(VerdictRow.block <= when.block)
    outcomes = scope.narrow(outcomes.group_by(VerdictRow.outcome), pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    counts = {outcome: int(count) for outcome, count in await database.execute(outcomes)}
    asked = (
        select(func.count()).select_from(SessionRow).join(TransactionRow, TransactionRow.tx_id == SessionRow.session_id)
    )
    asked = asked.where(TransactionRow.validation_code == 0, TransactionRow.block <= when.block)
    asked = scope.narrow(asked, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    return counts | {"sessions": (await database.execute(asked)).scalar_one()}
