"""Site plans by REST."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland.site_plans import MAX_BYTES, SitePlanError, parse
from wonderland_backend.access import SIGNED_IN, SignedInPerson, require
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import Conflict, Forbidden, NotFound, Unprocessable, documented
from wonderland_backend.geojson import MEDIA_TYPE
from wonderland_backend.pads import queries
from wonderland_backend.responses import Json
from wonderland_backend.site_plans import store
from wonderland_backend.site_plans.schemas import CONTENT, StoredSitePlan

router = APIRouter(prefix="/site-plans", tags=["pads"], dependencies=SIGNED_IN)
KEPT: Final = "private, max-age=31536000, immutable"
_NOT_FOUND: Final = NotFound(said("no_such_pad", pad_id="aurajoki-2"))
_FILE: Final = {
    "requestBody": {
        "required": True,
        "description": f"GeoJSON in metres from the pad's origin, at most {MAX_BYTES >> 20} MiB (docs/site-plans.md)",
        "content": CONTENT,
    }
}
PadId = Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=64)]
Sha256 = Annotated[str, Path(pattern="^[0-9a-f]{64}$")]


@router.post(
    "/{pad_id}",
    status_code=201,
    response_model=StoredSitePlan,
    responses=documented(_NOT_FOUND, Forbidden, Conflict, Unprocessable)
    | {200: {"model": StoredSitePlan, "description": "This very file is kept already"}},
    openapi_extra=_FILE,
)
async def keep_site_plan(request: Request, context: ContextDep, person: SignedInPerson, pad_id: PadId) -> Response:
    """Check a plan of a pad's site and keep it. The ledger's SetSitePlan with its hash then makes it hold.

    Where something is wrong with it, `errors` names each place in the file and what to do.
    """
    require(person, "admin", "pad_operator")
    async with context.database.read() as database:
        if await queries.find_pad(database, person.scope, pad_id) is None:
            raise NotFound(said("no_such_pad", pad_id=pad_id))
    body = await request.body()
    try:
        plan = await asyncio.to_thread(parse, body)
        async with context.database.write() as connection:
            sha256, new = await store.keep(connection, pad_id, body, context.clock())
    except SitePlanError as error:
        problems = [(each.where or "file", each.what) for each in error.problems]
        raise Unprocessable(said("bad_site_plan"), *problems) from error
    except store.TooManyPlansError as error:
        raise Conflict(error.said) from error
    answer = {
        "pad_id": pad_id,
        "sha256": sha256,
        "size_bytes": len(body),
        "features": len(plan.features),
        "image": plan.image is not None,
    }
    return Json(answer, status_code=201 if new else 200)


@router.get(
    "/{pad_id}/{sha256}",
    response_class=Response,
    responses=documented(_NOT_FOUND) | {200: {"content": CONTENT}},
)
async def read_site_plan(context: ContextDep, person: SignedInPerson, pad_id: PadId, sha256: Sha256) -> Response:
    """The file of a site plan, byte for byte; its SHA-256 is in the address, and on the ledger."""
    async with context.database.read() as database:
        pad = await queries.find_pad(database, person.scope, pad_id)
        body = None if pad is None else await store.find_site_plan(database, pad_id, sha256)
    if body is None:
        raise NotFound(said("no_such_site_plan", pad_id=pad_id))
    headers = {"Cache-Control": KEPT, "ETag": f'"{sha256}"', "Content-Security-Policy": "default-src 'none'; sandbox"}
    return Response(body, media_type=MEDIA_TYPE, headers=headers)
