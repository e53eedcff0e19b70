"""The same content as plain JSON or as GeoJSON (RFC 7946), whichever a request accepts."""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterable
from typing import Any, Final

import orjson
from fastapi import Request
from fastapi.responses import Response

from wonderland_backend import responses
from wonderland_backend.errors import NOT_MODIFIED

MEDIA_TYPE: Final = "application/geo+json"
E7: Final = 10_000_000
EXAMPLE: Final = {"type": "Point", "coordinates": [22.2666, 60.45189, 42.0]}

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
    return responses.prefers(request, MEDIA_TYPE)


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
        return responses.resource(request, feature(item, geometry_of(item), id_of(item)), MEDIA_TYPE, headers)
    return responses.resource(request, content, headers=headers)


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
    """`responses.page`, in either form."""
    if not wanted(request):
        return responses.page(request, items, limit, cursor_of=cursor_of, headers=headers)
    found = list(items)
    parsed = [_parsed(content) for _, content in found[:limit]]
    features = [feature(item, geometry_of(item), id_of(item)) for item in parsed]
    more, link = responses.following(request, found, limit, cursor_of)
    answer = {"type": "FeatureCollection", "features": features, **more}
    return responses.resource(request, answer, MEDIA_TYPE, (headers or {}) | link)


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
