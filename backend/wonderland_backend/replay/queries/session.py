"""All that was known of a session at a moment of the past."""

from __future__ import annotations

from typing import Any, Final

import orjson
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import EvidenceRow, SessionRow, VerdictRow
from wonderland_backend.db.tables.reported import EstimateRow, SessionEndRow
from wonderland_backend.ledger.queries import with_events
from wonderland_backend.person import Scope
from wonderland_backend.replay.queries.moment import moment, sessions_at
from wonderland_backend.responses import record
from wonderland_backend.sessions import queries as sessions
from wonderland_backend.verdicts import queries as verdicts

LATER: Final = ("decided_ms", "ended_ms", "end")
OF_ITS_END: Final = ("ended_by", "note")
BY_PEOPLE: Final = ("precedence", "departure")


async def session_at(database: AsyncSession, session_id: str, t_ms: int, scope: Scope) -> dict[str, Any] | None:
    """A session's SessionDetail as it was at a time (ms since the Unix epoch); None where it was not known yet."""
    when = await moment(database, t_ms)
    found = await sessions_at(database, when, scope, [session_id])
    row = await database.get(SessionRow, session_id)
    if not found or row is None:
        return None
    (view,) = found
    outline = view.outline
    later = (*LATER, *(OF_ITS_END if outline.ended_ms is None else ()))
    past = {
        name: value
        for name, value in orjson.loads(row.record).items()
        if name not in later and not (name in BY_PEOPLE and value["t_ms"] > t_ms)
    }
    past |= {name: value for name in LATER if (value := getattr(outline, name)) is not None}
    transactions = [each for each in await sessions.transactions(database, view) if each.block <= when.block]
    findings = await sessions.findings(database, outline, known_ms=t_ms)
    content: dict[str, Any] = {
        "summary": view.to_json(),
        "session": past | {"state": outline.state},
        "transactions": await with_events(database, transactions),
        "estimates": [orjson.Fragment(text) for text in await _estimates(database, session_id, t_ms)],
        "findings": [orjson.Fragment(finding.body) for finding in findings],
        "reported_ends": [orjson.Fragment(text) for text in await _ends(database, session_id, t_ms)],
    }
    signature = await sessions.signature(database, session_id, outline.pad_id, known_ms=t_ms)
    if signature is not None:
        content["signature"] = signature
    verdict = await database.get(VerdictRow, session_id)
    if verdict is not None and verdict.block <= when.block:
        content["verdict"] = verdicts.verdict_json(verdict)
    evidence = await database.get(EvidenceRow, session_id)
    if evidence is not None and evidence.block <= when.block:
        content["evidence"] = record(evidence.record)
    return content


async def _estimates(database: AsyncSession, session_id: str, t_ms: int) -> list[str]:
    query = (
        select(EstimateRow.body)
        .where(EstimateRow.session_id == session_id, EstimateRow.received_ms <= t_ms)
        .order_by(EstimateRow.received_ms.desc(), EstimateRow.id.desc())
        .limit(sessions.MAX_ESTIMATES)
    )
    return list(reversed((await database.scalars(query)).all()))


async def _ends(database: AsyncSession, session_id: str, t_ms: int) -> list[str]:
    query = select(SessionEndRow.body).where(SessionEndRow.session_id == session_id, SessionEndRow.received_ms <= t_ms)
    return list(await database.scalars(query.order_by(SessionEndRow.agent)))
