"""What is to go, marked so that clients learn of it: ``@router.get(…, **deprecated(since=…, until=…, instead=…))``."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, date, datetime, time, timedelta
from email.utils import format_datetime
from typing import Any, Final

from fastapi import Depends, Request

from wonderland_backend.answer_headers import add_headers

NOTICE: Final = timedelta(days=182)
"""So long what is deprecated still works, at least."""
SUNSET: Final = "x-sunset"
"""In the description, where OpenAPI has only ``deprecated: true``: the day of its end."""
INSTEAD: Final = "x-deprecated-for"


def deprecated(
    *, since: date, until: date, instead: str, openapi_extra: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Options of a route that is to go on `until`; `instead` is the address that tells of what takes its place.

    The description says so, and every answer has Deprecation (RFC 9745), Sunset (RFC 8594) and a link.
    """
    if until - since < NOTICE:
        raise ValueError(f"{until} is sooner than {NOTICE.days} days after {since}")
    headers = {
        "Deprecation": f"@{int(_begin(since).timestamp())}",
        "Sunset": format_datetime(_begin(until), usegmt=True),
        "Link": f'<{instead}>; rel="deprecation"; type="text/html"',
    }

    async def tell(request: Request) -> None:
        add_headers(request.scope, headers)

    return {
        "deprecated": True,
        "dependencies": [Depends(tell)],
        "openapi_extra": {**(openapi_extra or {}), SUNSET: until.isoformat(), INSTEAD: instead},
    }


def _begin(day: date) -> datetime:
    return datetime.combine(day, time(), UTC)
