"""Answers written as JSON once, straight from what the database holds."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from typing import Any

import orjson
from fastapi import Request
from fastapi.responses import Response

from wonderland_backend.errors import PreconditionFailed
from wonderland_backend.pagination import encode_cursor


class Json(Response):
    """A JSON answer, encoded by orjson; `orjson.Fragment` parts go through as they are."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        """The body."""
        return orjson.dumps(content)


def resource(
    request: Request, content: Any, media_type: str = "application/json", headers: dict[str, str] | None = None
) -> Response:
    """What is there, with an ETag (RFC 9110, 8.8.3); 304 without a body when the client has it already."""
    body = orjson.dumps(content)
    tag = _tag(body, media_type)
    every = {"ETag": tag, "Cache-Control": "private, no-cache", "Vary": "Accept, Accept-Language", **(headers or {})}
    if _names(request, "if-none-match", tag):
        return Response(status_code=304, headers=every)
    return Response(body, headers=every, media_type=media_type)


def prefers(request: Request, media_type: str) -> bool:
    """Whether the request accepts this type, and names it before plain JSON."""
    accepted = [part.partition(";")[0].strip().lower() for part in request.headers.get("accept", "").split(",")]
    if media_type not in accepted:
        return False
    return "application/json" not in accepted or accepted.index(media_type) < accepted.index("application/json")


def page(
    request: Request,
    items: Iterable[Any],
    limit: int,
    *,
    cursor_of: Callable[[Any], tuple[int | str, ...]],
    headers: dict[str, str] | None = None,
) -> Response:
    """A page of (row, content) pairs, with an ETag and a link to the next page.

    `items` has one more than `limit` where another page follows; `cursor_of(row)` gives its sort key.
    """
    found = list(items)
    answer: dict[str, Any] = {"items": [content for _, content in found[:limit]]}
    more, link = following(request, found, limit, cursor_of)
    return resource(request, answer | more, headers=(headers or {}) | link)


def following(
    request: Request, found: list[Any], limit: int, cursor_of: Callable[[Any], tuple[int | str, ...]]
) -> tuple[dict[str, str], dict[str, str]]:
    """What a page says of the next one, in its body and in its headers; nothing on the last."""
    if len(found) <= limit:
        return {}, {}
    cursor = encode_cursor(*cursor_of(found[limit - 1][0]))
    address = request.url.include_query_params(cursor=cursor)
    return {"next": cursor}, {"Link": f'<{address.path}?{address.query}>; rel="next"'}


def etag_of(content: Any) -> str:
    """The ETag that this content has as a JSON `resource`."""
    return _tag(orjson.dumps(content), "application/json")


def require_match(request: Request, content: Any) -> None:
    """Refuse a change of something that is no longer what the client saw (If-Match). Raises `PreconditionFailed`."""
    if "if-match" in request.headers and not _names(request, "if-match", etag_of(content)):
        raise PreconditionFailed(PreconditionFailed.example)


def _tag(body: bytes, media_type: str) -> str:
    return f'"{hashlib.sha256(media_type.encode() + body).hexdigest()[:32]}"'


def _names(request: Request, header: str, tag: str) -> bool:
    """Whether a header of entity tags has this one. If-Match compares strongly: there a weak tag is none of ours."""
    known = [each.strip() for each in request.headers.get(header, "").split(",")]
    if header == "if-none-match":
        known = [each.removeprefix("W/") for each in known]
    return tag in known or known == ["*"]


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
