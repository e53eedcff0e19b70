"""Reading pads from the database."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import orjson
from sqlalchemy import and_, or_, select
from sqlalchemy.ext.asyncio import AsyncSession
from sqlalchemy.orm import aliased

from wonderland.proofs.errors import ProofError
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.queue import ENTER, HOUR_MS
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.reservations import Reservations
from wonderland.proofs.records.sessions import Session
from wonderland_backend.db.tables.ledger import PadRow, ReservationsRow, SessionRow, TransactionRow, VerdictRow
from wonderland_backend.db.tables.reported import HealthRow, StepRow
from wonderland_backend.narrowing import field
from wonderland_backend.person import Scope
from wonderland_backend.responses import record

MAX_QUEUEING: Final = 20_000
"""Sessions of the last hour, the newest; a pad serves some hundred."""


def pad_json(pad_record: str, health_body: str | None, *, connected: bool, queue: dict[str, Any] | None = None) -> Any:
    """The Pad of the interfaces: record, anchors on the globe, its health by its own word; in live frames its queue."""
    health = None
    if health_body is not None:
        health = record(health_body, connected=connected)
    return record(pad_record, anchors=orjson.Fragment(anchors(pad_record)), health=health, queue=queue)


@lru_cache(maxsize=4096)
def anchors(pad_record: str) -> str:
    """Where a pad's anchors stand, as JSON; empty without a commissioning that can be read."""
    found: list[dict[str, Any]] = []
    try:
        commissioning = Pad.decode(pad_record).commissioning
        for each in commissioning.anchors if commissioning is not None else ():
            assert commissioning is not None
            lat_e7, lon_e7, _ = to_wgs84(commissioning.frame, each.east_mm, each.north_mm, each.up_mm)
            found.append(
                {
                    "anchor_id": each.anchor_id,
                    "lat_e7": lat_e7,
                    "lon_e7": lon_e7,
                    "east_mm": each.east_mm,
                    "north_mm": each.north_mm,
                    "up_mm": each.up_mm,
                }
            )
    except ProofError:
        # A record of a later contract, or a frame that reaches nowhere: the pad is shown without anchors.
        return "[]"
    return orjson.dumps(found).decode()


async def listing(
    database: AsyncSession,
    scope: Scope,
    *,
    after: str | None = None,
    limit: int,
    operator: str | None = None,
    within: Sequence[str] | None = None,
) -> Sequence[PadRow]:
    """Pads by identifier; of an operator, and among those that are named, where they are."""
    query = scope.narrow(select(PadRow).order_by(PadRow.pad_id).limit(limit), pad=PadRow.pad_id)
    if after is not None:
        query = query.where(PadRow.pad_id > after)
    if operator is not None:
        query = query.where(PadRow.record.contains(field("operator_id", operator), autoescape=True))
    if within is not None:
        query = query.where(PadRow.pad_id.in_(within))
    return (await database.scalars(query)).all()


async def find_pad(database: AsyncSession, scope: Scope, pad_id: str) -> PadRow | None:
    """The pad's row; None for one that the ledger does not know, or that is not theirs to see."""
    query = scope.narrow(select(PadRow).where(PadRow.pad_id == pad_id), pad=PadRow.pad_id)
    return (await database.scalars(query)).first()


async def health_of(database: AsyncSession, pad_ids: Sequence[str]) -> dict[str, str]:
    """The last health reports of these pads, as JSON texts."""
    query = select(HealthRow).where(HealthRow.agent == "pad", HealthRow.agent_id.in_(pad_ids))
    return {row.agent_id: row.body for row in await database.scalars(query)}


async def reservations(database: AsyncSession, pad_id: str | None = None) -> dict[str, Reservations]:
    """For whom a pad (or each pad) is kept, by pad."""
    query = select(ReservationsRow.pad_id, ReservationsRow.record)
    if pad_id is not None:
        query = query.where(ReservationsRow.pad_id == pad_id)
    found: dict[str, Reservations] = {}
    for its_pad, text in await database.execute(query):
        with contextlib.suppress(ProofError):  # of a later contract
            found[its_pad] = Reservations.decode(text)
    return found


async def queueing(
    database: AsyncSession, now_ms: int, pad_id: str | None = None
) -> tuple[list[Session], frozenset[str]]:
    """What a pad’s queue (or all pads’) depends on: sessions in the order of their requests, ids of the permitted."""
    ended = aliased(SessionRow)
    landed = and_(ended.state == "completed", ended.end == "done", ended.action.in_(sorted(ENTER)))
    last_landing = (
        select(ended.session_id)
        .where(ended.pad_id == SessionRow.pad_id, landed)
        .order_by(ended.ended_ms.desc())
        .limit(1)
        .correlate(SessionRow)
        .scalar_subquery()
    )
    query = (
        select(SessionRow.record, SessionRow.session_id, VerdictRow.permission)
        .join(TransactionRow, TransactionRow.tx_id == SessionRow.session_id)
        .outerjoin(VerdictRow, VerdictRow.session_id == SessionRow.session_id)
        .where(TransactionRow.validation_code == 0)
        .where(or_(SessionRow.requested_ms > now_ms - HOUR_MS, SessionRow.session_id == last_landing))
        .order_by(TransactionRow.block.desc(), TransactionRow.tx_index.desc())
        .limit(MAX_QUEUEING)
    )
    if pad_id is not None:
        query = query.where(SessionRow.pad_id == pad_id)
    sessions: list[Session] = []
    permitted: set[str] = set()
    for text, session_id, permission in reversed((await database.execute(query)).all()):
        try:
            sessions.append(Session.decode(text))
        except ProofError:
            continue  # of a later contract
        if permission == "granted":
            permitted.add(session_id)
    return sessions, frozenset(permitted)


async def being_measured(database: AsyncSession, session_ids: Sequence[str]) -> set[str]:
    """Whose turn it is already, as the pad's agent says."""
    query = select(StepRow.session_id).where(
        StepRow.session_id.in_(session_ids), StepRow.agent == "pad", StepRow.step != "request"
    )
    return set((await database.scalars(query)).all())
