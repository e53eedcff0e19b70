"""Answers written as JSON once, straight from what the database holds."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import orjson
from fastapi import Request
from fastapi.responses import Response

from backend.pagination import encode_cursor


class Json(Response):
    """A JSON answer, encoded by orjson; `orjson.Fragment` parts go through as they are."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        """The body."""
        return orjson.dumps(content)


def resource(request: Request, content: Any) -> Response:
    """One resource with an ETag (RFC 9110, 8.8.3); 304 without a body when the client has it already."""
    body = orjson.dumps(content)
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    known = request.headers.get("if-none-match", "")
    tags = [each.strip().removeprefix("W/") for each in known.split(",")]
    if tag in tags or tags == ["*"]:
        return Response(status_code=304, headers=headers)
    return Response(body, headers=headers, media_type="application/json")


def page(items: Iterable[Any], limit: int, *, cursor_of: Any) -> Json:
    """A page: `items` has one more than `limit` where another page follows; `cursor_of(item)` gives its sort key.

    Items are (row, content) pairs.
    """
    found = list(items)
    content: dict[str, Any] = {"items": [content for _, content in found[:limit]]}
    if len(found) > limit:
        content["next"] = encode_cursor(*cursor_of(found[limit - 1][0]))
    return Json(content, headers={"Cache-Control": "private, no-store"})


def record(text: str, **more: Any) -> Any:
    """A record's JSON text as part of an answer, with further fields in the same object.

    The text is what the ledger holds; it is not parsed again.
    """
    more = {name: value for name, value in more.items() if value is not None}
    if not more:
        return orjson.Fragment(text)
    rest = orjson.dumps(more).decode()
    if text == "{}":
        return orjson.Fragment(rest)
    return orjson.Fragment(f"{text[:-1]},{rest[1:]}")
