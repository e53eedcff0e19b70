"""The audit log by REST: to read and to check, never to change; and showing what is masked, which it records."""

from __future__ import annotations

from typing import Any, Final

import orjson
from fastapi import APIRouter, Request
from fastapi.responses import Response
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import said
from wonderland.proofs.records.uavs import without_secret
from wonderland_backend import audit
from wonderland_backend.access import Administrator, Officer
from wonderland_backend.audit import queries
from wonderland_backend.audit.anchors import AnchorsDep
from wonderland_backend.audit.schemas import AuditCheck, AuditFilters, AuditPage, Unmask, Unmasked
from wonderland_backend.audit.verify import verify
from wonderland_backend.context import ContextDep
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.drones import queries as drones
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, NotFound, documented
from wonderland_backend.numbers import store as numbers
from wonderland_backend.responses import Json, page

router = APIRouter(tags=["audit"])
_NOT_FOUND: Final = NotFound(said("no_such_number"))
_ALTERED: Final = Conflict(said("number_altered"))
SHOW_MS: Final = 60_000


@router.get("/audit", response_model=AuditPage, responses=documented(BadRequest, Forbidden, etag=True))
async def list_audit(request: Request, context: ContextDep, _: Administrator, filters: AuditFilters) -> Response:
    """What was done and read, newest first."""
    before = filters.after_key(int)
    async with context.database.read() as database:
        rows = await queries.listing(database, filters, before=before)
    return page(request, ((row, _shown(row)) for row in rows), filters.limit, cursor_of=lambda row: (row.seq,))


@router.get("/audit/verify", response_model=AuditCheck, responses=documented(Forbidden))
async def verify_audit(context: ContextDep, who: Administrator, anchors: AnchorsDep) -> Response:
    """Check each row against its hash and the row before, and the chain against the heads on the ledger."""
    found = await verify(context.database, anchors, context.clock())
    async with context.database.write() as connection:
        detail = {"ok": found.ok, "rows": found.rows, "anchors": found.anchors}
        await audit.record(connection, who, "audit_verified", "audit", detail, t_ms=context.clock())
    return Json(found.to_json(), headers={"Cache-Control": "no-store"})


@router.post("/unmask", response_model=Unmasked, responses=documented(Forbidden, _NOT_FOUND, _ALTERED))
async def unmask(context: ContextDep, who: Officer, body: Unmask) -> Response:
    """Show a number that is masked everywhere else. Recorded with the reason before it is shown."""
    async with context.database.write() as connection:
        value = await _number(connection, body)
        detail = {"field": body.field, "reason": body.reason.strip()}
        await audit.record(connection, who, "unmask", f"drone/{body.uav_id}", detail, t_ms=context.clock())
    return Json(Unmasked(value=value, show_ms=SHOW_MS).model_dump(), headers={"Cache-Control": "no-store"})


async def _number(connection: AsyncConnection, body: Unmask) -> str:
    """The number that is asked for. Raises `NotFound`; `Conflict` for one that is not what was registered."""
    if body.field == "registration":
        found = await numbers.number_of(connection, body.uav_id)
        if found is not None and found.state == "altered":
            raise Conflict(said("number_altered"))
        if found is not None and found.state == "elsewhere":
            raise NotFound(said("number_elsewhere", msp_id=found.msp_id))
        value = "" if found is None else found.value
    else:
        value = await drones.operator_of(connection, body.uav_id, body.field) or ""
        if body.field == "broadcast_operator_id":
            value = without_secret(value)
    if not value:
        raise NotFound(said("no_such_number"))
    return value


def _shown(row: AuditRow) -> dict[str, Any]:
    content = {
        "seq": row.seq,
        "t_ms": row.t_ms,
        "person_id": row.person_id or None,
        "person": row.person,
        "act": row.act,
        "subject": row.subject,
        "detail": orjson.Fragment(row.detail),
        "tx_id": row.tx_id,
        "sha256": row.sha256,
    }
    return {name: value for name, value in content.items() if value is not None}
