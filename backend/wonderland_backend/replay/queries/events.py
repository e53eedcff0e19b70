"""What came to be known within a span of time, in order: each as a call to a live board."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import orjson
from sqlalchemy import and_, case, or_, select
from sqlalchemy.ext.asyncio import AsyncSession
from sqlalchemy.sql.functions import func

from wonderland.proofs.records import keys
from wonderland_backend.db.tables.alerts import AlertActRow, AlertRow
from wonderland_backend.db.tables.ledger import (
    EventRow,
    EvidenceRow,
    RecordVersionRow,
    SessionRow,
    VerdictRow,
)
from wonderland_backend.db.tables.reported import (
    BlockArrivalRow,
    EstimateRow,
    PadConnectionRow,
    PadHealthRow,
    StepRow,
    TrackRow,
)
from wonderland_backend.live.board import Board
from wonderland_backend.live.telling import HeardTrack, PadHealthTold, RunningEstimate, StepTaken, Telling, tell_board
from wonderland_backend.masking import shown_alert
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import RECORDS, EvidenceWrite, VerdictWrite, outline_of
from wonderland_backend.person import Person, Scope
from wonderland_backend.replay.queries.moment import alert_at, outline_at
from wonderland_backend.replay.store import CONFIRM_S
from wonderland_backend.sessions.state import ReportedStep

SESSION_EVENTS: Final = {
    "ProofRequested": (False, False),
    "ProofDecided": (True, False),
    "InteractionCompleted": (True, True),
    "ProofCancelled": (True, True),
}
"""Events that change a session: (whether it may be decided by then, whether it has ended)."""


class Stage(Protocol):
    """What events act on: a board, and what a board looks at."""

    board: Board

    def reach_block(self, number: int) -> None:
        """The ledger is known as far as this block."""

    def connect(self, pad_id: str, server: str, *, connected: bool) -> None:
        """A pad's agent came to a server, or went."""


@dataclass(frozen=True)
class ReplayEvent:
    """Something that became known."""

    t_ms: int
    apply: Callable[[Stage], None]


@dataclass(frozen=True)
class Span:
    """After `after_ms`, until `until_ms`; what comes often is wanted once in each step, counted from `after_ms` on."""

    after_ms: int
    until_ms: int
    step_ms: int

    def holds(self, column: Any) -> Any:
        """Whether a time is within it."""
        return and_(column > self.after_ms, column <= self.until_ms)

    def step_of(self, column: Any) -> Any:
        """In which step a time is."""
        return (column - (self.after_ms + 1)) // self.step_ms


async def events(database: AsyncSession, span: Span, person: Person) -> list[ReplayEvent]:
    """All that became known within a span, as this person would have seen it, in order."""
    scope = person.scope
    found = [
        *await _blocks(database, span, scope),
        *await _connections(database, span, scope),
        *await _health(database, span, scope),
        *await _steps(database, span, scope),
        *await _estimates(database, span, scope),
        *await _tracks(database, span, scope),
        *await _alerts(database, span, person),
    ]
    return sorted(found, key=lambda each: each.t_ms)


async def _blocks(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    query = select(BlockArrivalRow.number, BlockArrivalRow.known_ms).where(span.holds(BlockArrivalRow.known_ms))
    arrivals = {number: known_ms for number, known_ms in await database.execute(query)}  # noqa: C416 - rows are no pairs
    if not arrivals:
        return []
    first, last = min(arrivals), max(arrivals)
    changes = {number: Changes() for number in sorted(arrivals)}
    await _add_sessions(database, changes, (first, last), scope)
    await _add_verdicts(database, changes, (first, last), scope)
    await _add_records(database, changes, (first, last), scope)
    return [ReplayEvent(arrivals[number], _commit(number, each)) for number, each in changes.items()]


def _commit(number: int, changes: Changes) -> Callable[[Stage], None]:
    def apply(stage: Stage) -> None:
        stage.reach_block(number)
        stage.board.commit(changes)

    return apply


async def _add_sessions(
    database: AsyncSession, changes: dict[int, Changes], blocks: tuple[int, int], scope: Scope
) -> None:
    query = select(EventRow).where(EventRow.block.between(*blocks), EventRow.name.in_(SESSION_EVENTS))
    events = (await database.scalars(query.order_by(EventRow.block, EventRow.tx_index))).all()
    ids = {event: orjson.loads(event.payload)["record"]["session_id"] for event in events}
    rows = select(SessionRow).where(SessionRow.session_id.in_(set(ids.values())))
    rows = scope.narrow(rows, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    sessions = {row.session_id: row for row in await database.scalars(rows)}
    for event in events:
        row = sessions.get(ids[event])
        if row is None or event.block not in changes:
            continue
        may_be_decided, ended = SESSION_EVENTS[event.name]
        decided = may_be_decided and row.verdict_tx is not None
        changes[event.block].session_writes.append(outline_at(outline_of(row), decided=decided, ended=ended))


async def _add_verdicts(
    database: AsyncSession, changes: dict[int, Changes], blocks: tuple[int, int], scope: Scope
) -> None:
    query = (
        select(VerdictRow, EvidenceRow.steps)
        .outerjoin(EvidenceRow, EvidenceRow.session_id == VerdictRow.session_id)
        .where(VerdictRow.block.between(*blocks))
        .order_by(VerdictRow.block, VerdictRow.tx_index)
    )
    query = scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    for verdict, steps in await database.execute(query):
        if verdict.block in changes:
            row = VerdictWrite(**{name: getattr(verdict, name) for name in VerdictWrite.__struct_fields__})
            changes[verdict.block].verdict_writes.append(row)
            if steps is not None:
                changes[verdict.block].put((verdict.session_id,), EvidenceWrite(verdict.session_id, steps))


async def _add_records(
    database: AsyncSession, changes: dict[int, Changes], blocks: tuple[int, int], scope: Scope
) -> None:
    query = select(RecordVersionRow).where(
        RecordVersionRow.kind.in_((keys.PAD, keys.UAV)), RecordVersionRow.block.between(*blocks)
    )
    query = scope.narrow(query, pad=RecordVersionRow.key, drone=RecordVersionRow.key)
    for version in await database.scalars(query.order_by(RecordVersionRow.block, RecordVersionRow.tx_index)):
        if version.block not in changes:
            continue
        row = RECORDS[version.kind].read(orjson.loads(version.record), (version.key,))
        row.record = version.record
        changes[version.block].put((version.key,), row)


async def _connections(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    believed = PadConnectionRow.until_ms + int(2 * CONFIRM_S * 1000)
    end = case((PadConnectionRow.ended, PadConnectionRow.until_ms), else_=believed)
    query = select(
        PadConnectionRow.pad_id, PadConnectionRow.server, PadConnectionRow.from_ms, end.label("end_ms")
    ).where(
        or_(
            span.holds(PadConnectionRow.from_ms),
            and_(PadConnectionRow.until_ms > span.after_ms - int(2 * CONFIRM_S * 1000), span.holds(end)),
        )
    )
    found: list[ReplayEvent] = []
    for pad_id, server, from_ms, end_ms in await database.execute(scope.narrow(query, pad=PadConnectionRow.pad_id)):
        for t_ms, connected in ((from_ms, True), (end_ms, False)):
            if span.after_ms < t_ms <= span.until_ms:
                found.append(ReplayEvent(t_ms, _connect(pad_id, server, connected=connected)))
    return found


def _connect(pad_id: str, server: str, *, connected: bool) -> Callable[[Stage], None]:
    return lambda stage: stage.connect(pad_id, server, connected=connected)


async def _health(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    query = select(PadHealthRow).where(span.holds(PadHealthRow.received_ms)).order_by(PadHealthRow.id)
    return [
        ReplayEvent(row.received_ms, _told(PadHealthTold(row.pad_id, row.body)))
        for row in await database.scalars(scope.narrow(query, pad=PadHealthRow.pad_id))
    ]


async def _steps(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    query = select(StepRow).where(span.holds(StepRow.received_ms))
    if not scope.everything:
        theirs = scope.narrow(select(SessionRow.session_id), pad=SessionRow.pad_id, drone=SessionRow.uav_id)
        query = query.where(StepRow.session_id.in_(theirs))
    found: list[ReplayEvent] = []
    for row in await database.scalars(query.order_by(StepRow.received_ms, StepRow.t_ms)):
        step = ReportedStep(row.step, row.t_ms, row.ok, row.agent, row.detail, row.agent_id)
        found.append(ReplayEvent(row.received_ms, _told(StepTaken(row.session_id, step))))
    return found


async def _estimates(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    names = ("received_ms", "uav_id", "session_id", "pad_id", "body")
    query = _once_a_step(EstimateRow, EstimateRow.session_id, span, EstimateRow.received_ms, scope, names)
    return [
        ReplayEvent(received_ms, _told(RunningEstimate(uav_id, session_id, pad_id, body)))
        for received_ms, uav_id, session_id, pad_id, body in await database.execute(query)
    ]


async def _tracks(database: AsyncSession, span: Span, scope: Scope) -> list[ReplayEvent]:
    names = ("received_ms", "uav_id", "t_ms", "body")
    query = _once_a_step(TrackRow, TrackRow.uav_id, span, TrackRow.t_ms, scope, names)
    return [
        ReplayEvent(received_ms, _told(HeardTrack(uav_id, t_ms, body)))
        for received_ms, uav_id, t_ms, body in await database.execute(query)
    ]


def _once_a_step(
    model: type[TrackRow | EstimateRow], of: Any, span: Span, newest_by: Any, scope: Scope, names: tuple[str, ...]
) -> Any:
    """These columns of the newest row of each drone or session in each step: more would never be shown.

    Columns, not objects, and read once: there are thousands in a few seconds of a busy day.
    """
    place = func.row_number().over(
        partition_by=(of, span.step_of(model.received_ms)),
        order_by=(newest_by.desc(), model.received_ms.desc(), model.id.desc()),
    )
    ranked = select(*model.__table__.columns, place.label("place")).where(span.holds(model.received_ms)).subquery()
    newest = select(*(ranked.c[name] for name in names)).where(ranked.c.place == 1)
    newest = scope.narrow(newest, pad=ranked.c.pad_id, drone=ranked.c.uav_id)
    return newest.order_by(ranked.c.received_ms, ranked.c.id)


async def _alerts(database: AsyncSession, span: Span, person: Person) -> list[ReplayEvent]:
    query = select(AlertRow).where(AlertRow.raised_ms <= span.until_ms, AlertRow.changed_ms > span.after_ms)
    query = person.scope.narrow(query, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    rows = (await database.scalars(query)).all()
    acts: dict[str, list[AlertActRow]] = {}
    done = select(AlertActRow).where(AlertActRow.alert_id.in_([row.alert_id for row in rows]))
    for act in await database.scalars(done.order_by(AlertActRow.revision)):
        acts.setdefault(act.alert_id, []).append(act)
    found: list[ReplayEvent] = []
    for row in rows:
        own = acts.get(row.alert_id, [])
        for t_ms in _changes_of(row, own, span):
            shown = alert_at(row, [act for act in own if act.t_ms <= t_ms], t_ms)
            found.append(ReplayEvent(t_ms, _alert(shown_alert(shown, person))))
    return found


def _changes_of(row: AlertRow, acts: Iterable[AlertActRow], span: Span) -> list[int]:
    times = {row.raised_ms, *(act.t_ms for act in acts)}
    if row.over_ms is not None:
        times.add(row.over_ms)
    return sorted(t_ms for t_ms in times if span.after_ms < t_ms <= span.until_ms)


def _told(what: Telling) -> Callable[[Stage], None]:
    return lambda stage: tell_board(stage.board, what)


def _alert(shown: dict[str, Any]) -> Callable[[Stage], None]:
    return lambda stage: stage.board.alert(shown)
