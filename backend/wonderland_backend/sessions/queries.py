"""Reading sessions from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import orjson
from sqlalchemy import Select, select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.records.pads import Commissioning, Pad
from wonderland.proofs.records.sessions import Session
from wonderland_backend.db.tables.ledger import EvidenceRow, RecordVersionRow, SessionRow, TransactionRow, VerdictRow
from wonderland_backend.db.tables.reported import EstimateRow, FindingRow, SessionEndRow, StepRow
from wonderland_backend.filters import SessionQuery
from wonderland_backend.mirror.rows import OUTLINE, SessionWrite
from wonderland_backend.narrowing import narrowed
from wonderland_backend.person import ALL, Scope
from wonderland_backend.sessions.state import ReportedStep, SessionView
from wonderland_backend.tracks import queries as tracks

MAX_ESTIMATES = 500
FINDINGS_BEFORE_MS = 60_000
"""A drone's broadcasts are looked at from this long before its request."""
MAX_FINDINGS = 100


async def listing(
    database: AsyncSession, filters: SessionQuery, scope: Scope = ALL, *, before: tuple[int, str] | None = None
) -> list[SessionView]:
    """Sessions, newest first, one more than `filters.limit`; `before` is the last one of the page before.

    Raises `BadRequest` as `narrowed` does.
    """
    newest_first = (SessionRow.requested_ms.desc(), SessionRow.session_id.desc())
    query: Select[Any] = _theirs(scope).order_by(*newest_first).limit(filters.limit + 1)
    query = await narrowed(database, query, filters, scope, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    if filters.state is not None:
        query = query.where(SessionRow.state == filters.state)
    if filters.action is not None:
        query = query.where(SessionRow.action == filters.action)
    if filters.outcome is not None:
        query = query.where(VerdictRow.outcome == filters.outcome)
    if filters.since_ms is not None:
        query = query.where(SessionRow.requested_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(SessionRow.requested_ms <= filters.until_ms)
    if before is not None:
        query = query.where(tuple_(SessionRow.requested_ms, SessionRow.session_id) < before)
    return await views(database, query)


async def views(database: AsyncSession, query: Select[Any]) -> list[SessionView]:
    """The sessions of a `listing`, with the steps that agents reported."""
    found: list[SessionView] = []
    for outline, outcome, permission, rounds, steps in (
        (row[: len(OUTLINE)], *row[len(OUTLINE) :]) for row in await database.execute(query)
    ):
        view = SessionView(SessionWrite(*outline), outcome, permission, rounds)
        view.take_evidence(steps)
        found.append(view)
    reported = await _reported(database, [view.session_id for view in found])
    for view in found:
        view.report(reported.get(view.session_id, ()))
    return found


async def view(database: AsyncSession, session_id: str, scope: Scope = ALL) -> SessionView | None:
    """A session with its verdict and closing; None where there is none, or it is not theirs to see."""
    found = await views(database, _theirs(scope).where(SessionRow.session_id == session_id))
    return found[0] if found else None


async def row(database: AsyncSession, session_id: str) -> SessionRow | None:
    """The session's row, with its record."""
    return await database.get(SessionRow, session_id)


async def evidence(database: AsyncSession, session_id: str) -> EvidenceRow | None:
    """What the pad brought before the contract."""
    return await database.get(EvidenceRow, session_id)


async def commissioning(database: AsyncSession, session: Session) -> Commissioning | None:
    """The survey on which a session was decided, whatever its pad became since."""
    versions = select(RecordVersionRow.record).where(
        RecordVersionRow.kind == "pad", RecordVersionRow.key == session.pad_id
    )
    newest_first = versions.order_by(RecordVersionRow.block.desc(), RecordVersionRow.tx_index.desc())
    for record in await database.scalars(newest_first):
        pad = Pad.decode(record.encode())
        if pad.commissioning_sha256 == session.commissioning_sha256:
            return pad.commissioning
    return None


async def transactions(database: AsyncSession, view: SessionView) -> Sequence[TransactionRow]:
    """The valid transactions that made the session what it is, oldest first."""
    names = [view.session_id, view.outline.verdict_tx, view.outline.complete_tx]
    query = (
        select(TransactionRow)
        .where(TransactionRow.tx_id.in_([name for name in names if name]), TransactionRow.validation_code == 0)
        .order_by(TransactionRow.block, TransactionRow.tx_index)
    )
    return (await database.scalars(query)).all()


async def estimates(database: AsyncSession, session_id: str) -> list[str]:
    """The last running estimates of the pad, oldest first, as JSON texts."""
    query = (
        select(EstimateRow.body)
        .where(EstimateRow.session_id == session_id)
        .order_by(EstimateRow.t_ms.desc(), EstimateRow.id.desc())
        .limit(MAX_ESTIMATES)
    )
    return list(reversed((await database.scalars(query)).all()))


async def findings(database: AsyncSession, outline: SessionWrite, *, known_ms: int | None = None) -> list[FindingRow]:
    """What was odd about the drone's broadcasts around a session, oldest first; as it was at `known_ms`, if given."""
    until_ms = outline.ended_ms or outline.expires_ms
    found = await tracks.findings(
        database,
        uav_id=outline.uav_id,
        since_ms=outline.requested_ms - FINDINGS_BEFORE_MS,
        until_ms=until_ms if known_ms is None else min(known_ms, until_ms),
        limit=MAX_FINDINGS,
    )
    return list(reversed(found))


async def reported_ends(database: AsyncSession, session_id: str) -> Sequence[SessionEndRow]:
    """How agents say that it ended."""
    query = select(SessionEndRow).where(SessionEndRow.session_id == session_id).order_by(SessionEndRow.agent)
    return (await database.scalars(query)).all()


async def signature(
    database: AsyncSession, session_id: str, pad_id: str, *, known_ms: int | None = None
) -> dict[str, Any] | None:
    """Who signed the drone's broadcasts during a session, by its own pad; ``known_ms``: as far as known by then."""
    query = select(SessionEndRow.body).where(
        SessionEndRow.session_id == session_id, SessionEndRow.agent == "pad", SessionEndRow.agent_id == pad_id
    )
    if known_ms is not None:
        query = query.where(SessionEndRow.received_ms <= known_ms)
    body = (await database.scalars(query)).first()
    found: dict[str, Any] | None = orjson.loads(body).get("signature") if body is not None else None
    return found


def _theirs(scope: Scope) -> Any:
    return scope.narrow(_views(), pad=SessionRow.pad_id, drone=SessionRow.uav_id)


def _views() -> Select[Any]:
    return (
        select(
            *(getattr(SessionRow, name) for name in OUTLINE),
            VerdictRow.outcome,
            VerdictRow.permission,
            VerdictRow.rounds,
            EvidenceRow.steps,
        )
        .outerjoin(VerdictRow, VerdictRow.session_id == SessionRow.session_id)
        .outerjoin(EvidenceRow, EvidenceRow.session_id == SessionRow.session_id)
    )


async def _reported(database: AsyncSession, session_ids: list[str]) -> dict[str, list[ReportedStep]]:
    if not session_ids:
        return {}
    found: dict[str, list[ReportedStep]] = {}
    query = select(StepRow).where(StepRow.session_id.in_(session_ids)).order_by(StepRow.received_ms)
    for each in await database.scalars(query):
        step = ReportedStep(each.step, each.t_ms, each.ok, each.agent, each.detail, each.agent_id)
        found.setdefault(each.session_id, []).append(step)
    return found
