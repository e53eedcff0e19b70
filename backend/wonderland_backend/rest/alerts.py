"""Alerts by REST."""

from __future__ import annotations

from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.messages import Language
from wonderland.problems import said
from wonderland_backend.access import SIGNED_IN, SignedInPerson, require
from wonderland_backend.alerts import store
from wonderland_backend.alerts.kinds import plain_text
from wonderland_backend.alerts.schemas import Act, Alert, AlertCount, AlertDetail, AlertFilters, AlertPage
from wonderland_backend.context import ContextDep
from wonderland_backend.db.tables.alerts import AlertDeliveryRow, AlertRow
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, NotFound, documented
from wonderland_backend.languages import HEADER, language_of
from wonderland_backend.live.board import BoardDep
from wonderland_backend.masking import shown_act, shown_alert
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.person import AUTHORITY, Person
from wonderland_backend.responses import Json, page, resource

router = APIRouter(tags=["alerts"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_alert"))
_LANGUAGE: Final = {"parameters": [HEADER]}
AlertId = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]


@router.get(
    "/alerts",
    response_model=AlertPage,
    responses=documented(BadRequest, OPERATORS_MASKED, etag=True),
    openapi_extra=_LANGUAGE,
)
async def list_alerts(request: Request, context: ContextDep, person: SignedInPerson, filters: AlertFilters) -> Response:
    """Alerts, newest first."""
    language = language_of(request)
    place = filters.after_place(int, str)
    async with context.database.read() as database:
        position = (place[0], place[1]) if place else None
        rows = await store.listing(database, filters, person.scope, position=position, now_ms=context.clock())
    return page(
        request,
        ((row, _shown(row, person, language)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.t_ms, row.alert_id),
    )


@router.get("/alerts/count", response_model=AlertCount, responses=documented())
async def count_alerts(context: ContextDep, person: SignedInPerson) -> Response:
    """How many wait in the inbox; the live interface holds the newest 500."""
    async with context.database.read() as database:
        size = await store.inbox_size(database, person.scope, context.clock())
    return Json({"inbox": size}, headers={"Cache-Control": "private, no-store"})


@router.get(
    "/alerts/{alert_id}",
    response_model=AlertDetail,
    responses=documented(_NOT_FOUND, etag=True),
    openapi_extra=_LANGUAGE,
)
async def read_alert(request: Request, context: ContextDep, person: SignedInPerson, alert_id: AlertId) -> Response:
    """One alert, with what was done about it and who was told."""
    async with context.database.read() as database:
        row = await store.find_alert(database, person.scope, alert_id)
        acts = await store.acts_of(database, alert_id)
        deliveries = [_delivery(each) for each in await store.deliveries_of(database, alert_id)]
    content: dict[str, Any] = {
        "alert": _shown(row, person, language_of(request)),
        "acts": [shown_act(each, person) for each in acts],
        "deliveries": deliveries if person.has(*AUTHORITY) else [],
    }
    return resource(request, content)


@router.post(
    "/alerts/{alert_id}/acts",
    response_model=Alert,
    responses=documented(Forbidden, _NOT_FOUND, Conflict),
    openapi_extra=_LANGUAGE,
)
async def act_on_alert(
    request: Request, context: ContextDep, board: BoardDep, alert_id: AlertId, body: Act, person: SignedInPerson
) -> Response:
    """Acknowledge, assign, snooze, reopen, or leave a note. Refused when somebody else has acted meanwhile."""
    require(person, "admin", "inspector", "pad_operator", "fleet_operator")
    async with context.database.read() as database:
        await store.find_alert(database, person.scope, alert_id)
    row = await store.act(context.database, alert_id, person, body, context.clock())
    board.alert(store.alert_json(row))
    return Json(_shown(row, person, language_of(request)), headers={"Cache-Control": "private, no-store"})


def _shown(row: AlertRow, person: Person, language: Language) -> dict[str, Any]:
    text = plain_text(row.kind, row.pad_id, row.uav_id, orjson.loads(row.facts), language)
    return shown_alert(store.alert_json(row), person) | {"text": text}


def _delivery(row: AlertDeliveryRow) -> dict[str, Any]:
    content: dict[str, Any] = {"target": row.target, "attempts": row.attempts}
    for name in ("delivered_ms", "next_ms", "problem"):
        value = getattr(row, name)
        if value is not None:
            content[name] = value
    return content
