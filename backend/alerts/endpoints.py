"""Alerts by REST."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response
from sqlalchemy import select

from backend.alerts import store
from backend.alerts.schemas import Act, Alert, AlertDetail, AlertFilters, AlertPage
from backend.auth.endpoints import SIGNED_IN, SignedInPerson
from backend.context import context_of
from backend.db.models import AlertDeliveryRow, AlertRow
from backend.errors import BadRequest, Conflict, NotFound, documented
from backend.pagination import decode_cursor
from backend.responses import Json, page, resource

router = APIRouter(tags=["alerts"], dependencies=SIGNED_IN)
AlertId = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]


@router.get("/alerts", response_model=AlertPage, responses=documented(BadRequest))
async def list_alerts(request: Request, filters: AlertFilters) -> Response:
    """Alerts, newest first."""
    context = context_of(request)
    place = decode_cursor(filters.cursor, int, str) if filters.cursor is not None else None
    async with context.database.read() as database:
        position = (place[0], place[1]) if place else None
        rows = await store.listing(database, filters, position=position, now_ms=context.clock())
    return page(
        ((row, store.shown(row)) for row in rows), filters.limit, cursor_of=lambda row: (row.t_ms, row.alert_id)
    )


@router.get("/alerts/{alert_id}", response_model=AlertDetail, responses=documented(NotFound))
async def read_alert(request: Request, alert_id: AlertId) -> Response:
    """One alert, with what was done about it and who was told."""
    async with context_of(request).database.read() as database:
        row = await database.get(AlertRow, alert_id)
        if row is None:
            raise NotFound("There is no such alert.")
        acts = await store.acts_of(database, alert_id)
        query = select(AlertDeliveryRow).where(AlertDeliveryRow.alert_id == alert_id).order_by(AlertDeliveryRow.target)
        deliveries = [_delivery(each) for each in await database.scalars(query)]
    return resource(request, {"alert": store.shown(row), "acts": acts, "deliveries": deliveries})


@router.post("/alerts/{alert_id}/acts", response_model=Alert, responses=documented(NotFound, Conflict))
async def act_on_alert(request: Request, alert_id: AlertId, body: Act, person: SignedInPerson) -> Response:
    """Acknowledge, assign, snooze, reopen, or leave a note. Refused when somebody else has acted meanwhile."""
    context = context_of(request)
    row = await store.act(context.database, alert_id, person.name, body, context.clock())
    content = store.shown(row)
    context.board.alert(content)
    return Json(content, headers={"Cache-Control": "private, no-store"})


def _delivery(row: AlertDeliveryRow) -> dict[str, Any]:
    content: dict[str, Any] = {"target": row.target, "attempts": row.attempts}
    for name in ("delivered_ms", "next_ms", "problem"):
        value = getattr(row, name)
        if value is not None:
            content[name] = value
    return content
