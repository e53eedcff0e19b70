"""The same content as plain JSON or as GeoJSON (RFC 7946), whichever a request accepts."""

from __future__ import annotations

import hashlib
import typing
from collections.abc import Callable, Iterable
from typing import Any, Final

import orjson
from fastapi import Request
from fastapi.responses import Response

from backend.errors import NOT_MODIFIED
from backend.pagination import encode_cursor

MEDIA_TYPE: Final = "application/geo+json"
E7: Final = 10_000_000
EXAMPLE: Final = {"type": "Point", "coordinates": [22.2666, 60.45189, 42.0]}
PRIVATE: Final = "private, no-cache"

Geometry = dict[str, Any] | None
Item = dict[str, Any]


def point(item: Item | None) -> Geometry:
    """The point of whatever has `lat_e7` and `lon_e7`, with its height above the ellipsoid where it has one."""
    if item is None or "lat_e7" not in item or "lon_e7" not in item:
        return None
    coordinates = [item["lon_e7"] / E7, item["lat_e7"] / E7]
    if "height_mm" in item:
        coordinates.append(item["height_mm"] / 1000)
    return {"type": "Point", "coordinates": coordinates}


def feature(item: Item, geometry: Geometry, identifier: str) -> Item:
    """A Feature with the item for its properties."""
    return {"type": "Feature", "id": identifier, "geometry": geometry, "properties": item}


def wanted(request: Request) -> bool:
    """Whether the request accepts GeoJSON, and names it before plain JSON."""
    accepted = [part.partition(";")[0].strip().lower() for part in request.headers.get("accept", "").split(",")]
    if MEDIA_TYPE not in accepted:
        return False
    return "application/json" not in accepted or accepted.index(MEDIA_TYPE) < accepted.index("application/json")


def one(
    request: Request,
    content: Any,
    *,
    id_of: Callable[[Item], str],
    geometry_of: Callable[[Item], Geometry] = point,
    headers: dict[str, str] | None = None,
) -> Response:
    """One resource, with an ETag."""
    if wanted(request):
        item = _parsed(content)
        return tagged(request, feature(item, geometry_of(item), id_of(item)), MEDIA_TYPE, headers)
    return tagged(request, content, headers=headers)


def page(
    request: Request,
    items: Iterable[tuple[Any, Any]],
    limit: int,
    *,
    cursor_of: Callable[[Any], tuple[int | str, ...]],
    id_of: Callable[[Item], str],
    geometry_of: Callable[[Item], Geometry] = point,
    headers: dict[str, str] | None = None,
) -> Response:
    """A page of (row, content) pairs, with an ETag and a link to the next page.

    `items` has one more than `limit` where another page follows; `cursor_of(row)` gives its sort key.
    """
    found = list(items)
    contents = [content for _, content in found[:limit]]
    following = encode_cursor(*cursor_of(found[limit - 1][0])) if len(found) > limit else None
    answer: dict[str, Any]
    if wanted(request):
        parsed = [_parsed(content) for content in contents]
        features = [feature(item, geometry_of(item), id_of(item)) for item in parsed]
        answer = {"type": "FeatureCollection", "features": features}
    else:
        answer = {"items": contents}
    headers = dict(headers or {})
    if following is not None:
        answer["next"] = following
        address = request.url.include_query_params(cursor=following)
        headers["Link"] = f'<{address.path}?{address.query}>; rel="next"'
    return tagged(request, answer, MEDIA_TYPE if wanted(request) else "application/json", headers)


def tagged(
    request: Request, content: Any, media_type: str = "application/json", headers: dict[str, str] | None = None
) -> Response:
    """An answer with an ETag (RFC 9110, 8.8.3); 304 without a body when the client has it already."""
    body = orjson.dumps(content)
    tag = f'"{hashlib.sha256(media_type.encode() + body).hexdigest()[:32]}"'
    every = {"ETag": tag, "Cache-Control": PRIVATE, "Vary": "Accept, Accept-Language", **(headers or {})}
    known = [each.strip().removeprefix("W/") for each in request.headers.get("if-none-match", "").split(",")]
    if tag in known or known == ["*"]:
        return Response(status_code=304, headers=every)
    return Response(body, headers=every, media_type=media_type)


def documented(model: Any) -> dict[int | str, dict[str, Any]]:
    """The ``responses`` of a route that answers in both forms."""
    items = model.model_fields.get("items")
    schema = schema_of(model) if items is None else collection_of(schema_of(typing.get_args(items.annotation)[0]))
    return {200: {"model": model, "content": {MEDIA_TYPE: {"schema": schema}}}, 304: {"description": NOT_MODIFIED}}


def schema_of(properties: Any) -> Item:
    """The schema of a Feature with these properties: a model, or a schema."""
    about = properties if isinstance(properties, dict) else {"$ref": f"#/components/schemas/{properties.__name__}"}
    geometry = {"anyOf": [{"type": "object"}, {"type": "null"}], "examples": [EXAMPLE]}
    return {
        "type": "object",
        "description": "Feature (RFC 7946)",
        "required": ["type", "id", "geometry", "properties"],
        "properties": {
            "type": {"const": "Feature"},
            "id": {"type": "string"},
            "geometry": geometry,
            "properties": about,
        },
    }


def collection_of(feature: Item) -> Item:
    """The schema of a FeatureCollection."""
    return {
        "type": "object",
        "description": "FeatureCollection (RFC 7946)",
        "required": ["type", "features"],
        "properties": {
            "type": {"const": "FeatureCollection"},
            "features": {"type": "array", "items": feature},
        },
    }


def _parsed(content: Any) -> Item:
    """The content as an object, where it holds JSON texts of the database."""
    found = orjson.loads(orjson.dumps(content))
    assert isinstance(found, dict)
    return found
