"""The interface of InterUSS by which geo-awareness is tested (`geo-awareness`); only under `--test-harness`.

What a test brings becomes a data set like any other: it is read, checked and asked about by the same code.
"""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import Annotated, Any, Final, TypeVar

from fastapi import APIRouter, Body, Depends, Path
from fastapi.responses import Response
from pydantic import BaseModel
from uas_standards.interuss.automated_testing.geo_awareness.v1.constants import Scope

from wonderland.problems import said
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import BadRequest, NotFound, Problem, documented
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.responses import Json
from wonderland_backend.tokens import ScopeMissing, TokenRefused
from wonderland_backend.uspace.access import system_with
from wonderland_backend.uspace.dss.models import UUID4, parse
from wonderland_backend.uspace.endpoints.remote_id import NO_STORE, StandardRoute
from wonderland_backend.uspace.geo_awareness import CheckRequest, SourceRequest, answer
from wonderland_backend.uspace.service import USpaceDep
from wonderland_backend.zones import importing, queries, store

logger = logging.getLogger(__name__)

PATHS: Final = ("/geo-awareness/{path:path}",)
"""Where nothing else may answer, open or not."""
FORMATS: Final = frozenset({"ED-269", "ED-318"})
WHO: Final = "InterUSS test"
_TEST: Final = [Depends(system_with(Scope.Test.value))]
SourceId = Annotated[str, Path(pattern=UUID4)]
Model = TypeVar("Model", bound=BaseModel)

router = APIRouter(
    prefix="/geo-awareness",
    tags=["test harness"],
    route_class=StandardRoute,
    dependencies=_TEST,
    responses=documented(TokenRefused, ScopeMissing),
)


@router.get("/status")
async def get_geo_awareness_status() -> Response:
    """Whether tests may begin."""
    return Json({"status": "Ready"}, headers=NO_STORE)


@router.put("/geozone_sources/{geozone_source_id}")
async def put_geozone_source(
    context: ContextDep, uspace: USpaceDep, geozone_source_id: SourceId, body: Annotated[dict[str, Any], Body()]
) -> Response:
    """Fetch a file of zones and have it hold; what becomes of it is in the answer."""
    wanted = _parsed(SourceRequest, body).https_source
    if wanted is None or wanted.format not in FORMATS:
        return _result("Unsupported", f"Sources are files by HTTPS, in {' or '.join(sorted(FORMATS))}.")
    try:
        data = await uspace.peers.read(wanted.url, max_bytes=context.settings.max_zone_file_bytes)
    except TransferError as error:
        return _result("Error", f"The source cannot be fetched: {error}")
    try:
        await importing.import_data(context, WHO, data, _name(geozone_source_id))
    except Problem as refused:
        reasons = "; ".join(f"{where}: {what}" for where, what in refused.errors[:3])
        return _result("Rejected", f"{refused} {reasons}".strip())
    return _result("Ready")


@router.get("/geozone_sources/{geozone_source_id}", responses=documented(NotFound))
async def get_geozone_source_status(context: ContextDep, geozone_source_id: SourceId) -> Response:
    """Whether a source's zones hold."""
    await _require(context, geozone_source_id)
    return _result("Ready")


@router.delete("/geozone_sources/{geozone_source_id}", responses=documented(NotFound))
async def delete_geozone_source(context: ContextDep, geozone_source_id: SourceId) -> Response:
    """A source's zones hold no longer."""
    await _require(context, geozone_source_id)
    await importing.end(context, WHO, _name(geozone_source_id))
    return _result("Deactivating")


@router.post("/geozones/check")
async def check_geozones(context: ContextDep, body: Annotated[dict[str, Any], Body()]) -> Response:
    """Whether there are zones that pass the filters, check by check."""
    asked = _parsed(CheckRequest, body)
    async with context.database.read() as database:
        rows = await queries.in_force(database)
    return Json({"applicableGeozone": [answer(check, rows) for check in asked.checks]}, headers=NO_STORE)


def _parsed(model: type[Model], body: dict[str, Any]) -> Model:
    try:
        return parse(model, body)
    except ValueError as error:
        raise BadRequest(said("request_unreadable", why=error)) from None


def _name(source_id: str) -> str:
    return f"test-{source_id.lower()}"


async def _require(context: Context, source_id: str) -> None:
    async with context.database.read() as database:
        if await store.current(database, _name(source_id)) is None:
            raise NotFound(said("no_such_source"))


def _result(result: str, message: str | None = None) -> Response:
    content = {"result": result} if message is None else {"result": result, "message": message}
    return Json(content, status_code=HTTPStatus.OK, headers=NO_STORE)
