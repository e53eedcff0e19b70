"""Exports by REST."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response, StreamingResponse

from wonderland.problems import said
from wonderland_backend.access import SIGNED_IN, SignedInPerson, require
from wonderland_backend.clients import idempotency
from wonderland_backend.clients.machines import METHOD, MachinesDep
from wonderland_backend.context import ContextDep
from wonderland_backend.db.tables.exports import ExportRow
from wonderland_backend.errors import (
    BINARY,
    BadRequest,
    Conflict,
    Forbidden,
    NotFound,
    SwitchedOff,
    TooManyRequests,
    Unprocessable,
    documented,
)
from wonderland_backend.exports import service
from wonderland_backend.exports.schemas import Export, ExportQuery
from wonderland_backend.mirror.status import MirrorStatusDep
from wonderland_backend.responses import Json

router = APIRouter(prefix="/exports", tags=["exports"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_export"))
ExportId = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
_TOO_MUCH: Final = BadRequest(
    said("export_too_large", expected=4200000, most=1000000),
    ("body.until_ms", said("export_too_large_field")),
)
_SWITCHED_OFF: Final = SwitchedOff(said("export_off", format="mfjson"))
NO_STORE = {"Cache-Control": "private, no-store"}


@router.post(
    "",
    status_code=201,
    response_model=Export,
    responses=documented(_TOO_MUCH, Forbidden, _SWITCHED_OFF, idempotency.BUSY, Unprocessable, TooManyRequests),
    openapi_extra={"parameters": [idempotency.PARAMETER]},
)
async def prepare_export(
    request: Request, context: ContextDep, machines: MachinesDep, query: ExportQuery, person: SignedInPerson
) -> Response:
    """Ask for a window of the past as files; it is audited. Its file is then fetched once, within the hour.

    People need a role beyond that of a viewer; machines get in each file what their own role shows them.
    """
    if person.method == METHOD:
        caller, quota = f"export/{person.person_id}", context.settings.client_exports_per_min
        machines.limits.admit(request.scope, caller, quota)
    else:
        require(person, "admin", "inspector", "pad_operator", "fleet_operator")

    async def write() -> Response:
        row = await service.prepare(context, person, query)
        shown = _shown(row)
        return Json(shown, 201, NO_STORE | {"Location": f"/api/v1/exports/{shown['export_id']}"})

    return await idempotency.once(request, person, write)


@router.get("/{export_id}", response_model=Export, responses=documented(_NOT_FOUND))
async def read_export(context: ContextDep, export_id: ExportId, person: SignedInPerson) -> Response:
    """How far one's own export has come."""
    return Json(_shown(await service.find_export(context, person, export_id)), headers=NO_STORE)


@router.get(
    "/{export_id}/file",
    response_class=StreamingResponse,
    responses=documented(_NOT_FOUND, _SWITCHED_OFF, Conflict(said("export_fetched")), TooManyRequests)
    | {200: {"content": {"application/zip": {"schema": BINARY}}}},
)
async def fetch_export(
    context: ContextDep, mirror: MirrorStatusDep, export_id: ExportId, person: SignedInPerson
) -> Response:
    """The archive (application/zip), once: the data's files and `manifest.json` with their SHA-256."""
    row = await service.find_export(context, person, export_id)
    query = await service.begin(context, row)
    begin = datetime.fromtimestamp(query.from_ms / 1000, UTC)
    headers = {"Content-Disposition": f'attachment; filename="wonderland-{begin:%Y%m%dT%H%M%SZ}-{query.format}.zip"'}
    content = service.stream(context, mirror, person, row, query)
    return StreamingResponse(content, media_type="application/zip", headers=NO_STORE | headers)


def _shown(row: ExportRow) -> dict[str, Any]:
    shown = {
        "export_id": row.export_id,
        "created_ms": row.created_ms,
        "expires_ms": row.created_ms + service.KEPT_MS,
        "expected": row.expected,
        "state": row.state,
        "rows": row.rows,
        "bytes": row.bytes,
    }
    return shown if row.sha256 is None else shown | {"sha256": row.sha256}
