"""The live picture as GeoJSON: claims, estimates and verdicts of now, as features of their own."""

from __future__ import annotations

from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from wonderland_backend import geojson
from wonderland_backend.access import SignedInPerson
from wonderland_backend.clients.scopes import PROOFS, TRACKS
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import SwitchedOff, documented
from wonderland_backend.live.hub import HubDep
from wonderland_backend.live.lens import Lens
from wonderland_backend.outputs.items import Item, items_of
from wonderland_backend.responses import resource
from wonderland_backend.settings.outputs import KINDS, Kind
from wonderland_backend.tokens import ScopeMissing

router = APIRouter(tags=["picture"])
_SCOPES: Final[dict[Kind, str]] = {"claim": TRACKS, "estimate": TRACKS, "verdict": PROOFS}
_PROPERTIES: Final = {
    "type": "object",
    "required": ["kind", "verified", "uav_id"],
    "properties": {
        "kind": {"enum": list(KINDS)},
        "verified": {"type": "boolean", "description": "Only of a verdict with that outcome"},
        "uav_id": {"type": "string"},
    },
    "description": "With the fields of a Track, of an estimate or of a Verdict",
    "examples": [{"kind": "claim", "verified": False, "uav_id": "OH-DRN-0417", "t_ms": 1_800_000_000_000}],
}
_CONTENT: Final = {geojson.MEDIA_TYPE: {"schema": geojson.collection_of(geojson.schema_of(_PROPERTIES))}}

Tell = Annotated[
    list[Kind] | None, Query(max_length=len(KINDS), description="Which things; by default all that you may")
]


@router.get(
    "/picture",
    response_class=Response,
    responses=documented(SwitchedOff, etag=True) | {200: {"content": _CONTENT}},
)
async def read_picture(
    request: Request, context: ContextDep, hub: HubDep, person: SignedInPerson, tell: Tell = None
) -> Response:
    """What is known of each drone now: where it says it is, where a pad sees it, what the ledger decided last.

    Each is a feature of its own, and its properties say which (`kind`). `verified` is a verdict with that outcome only.
    """
    if not context.settings.outputs.live_geojson:
        raise SwitchedOff(SwitchedOff.example)
    kinds = _allowed(getattr(request.state, "scopes", None), tell)
    text = orjson.dumps({"type": "snapshot", **hub.board.snapshot()}).decode()
    lens = Lens.of(person, pad_owner=hub.pad_owner, drone_owner=hub.drone_owner)
    frame = orjson.loads(text if lens is None else lens.frame(text))
    last = {(item.kind, item.uav_id): item for item in items_of(frame) if item.kind in kinds}
    features = [
        geojson.feature(item.to_json(), _geometry(item), f"{kind}/{uav_id}") for (kind, uav_id), item in last.items()
    ]
    return resource(request, {"type": "FeatureCollection", "features": features}, geojson.MEDIA_TYPE)


def _allowed(scopes: frozenset[str] | None, tell: list[Kind] | None) -> frozenset[Kind]:
    """What is wanted and may be seen; people (no scopes) may see all. Raises `ScopeMissing`."""
    wanted = frozenset(tell or KINDS)
    if scopes is None:
        return wanted
    closed = {kind for kind in wanted if _SCOPES[kind] not in scopes}
    if tell is not None and closed:
        raise ScopeMissing(frozenset(_SCOPES[kind] for kind in closed))
    return wanted - closed


def _geometry(item: Item) -> geojson.Geometry:
    body: dict[str, Any] = item.body
    if item.kind != "verdict":
        return geojson.point(body)
    claim = (body.get("signed") or body.get("broadcast") or {}).get("claim")
    return geojson.point(body.get("estimate") or claim)
