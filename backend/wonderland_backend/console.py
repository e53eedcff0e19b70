"""Serving the built console: files that never change for long, the page itself afresh each time."""

from __future__ import annotations

import mimetypes
from pathlib import Path
from typing import Final

from fastapi import FastAPI
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

IMMUTABLE: Final = "public, max-age=31536000, immutable"
FRESH: Final = "no-cache"
ASSETS: Final = "assets/"
ENCODINGS: Final = (("br", ".br"), ("gzip", ".gz"))
"""What the console's build puts beside an asset (frontend/scripts/compress.ts), the smallest first."""
NOT_BUILT: Final = (
    "The console is not built, so that there is no page to show; the interface under /api/v1 works.\n"
    "In a working tree `make setup` builds it; an installed package brings it.\n"
)


class _Console(StaticFiles):
    """Any address that is no file is the console's own: its page finds out what to show."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """A file, or the page."""
        try:
            response = await self._found(path, scope)
        except HTTPException as error:
            if error.status_code != 404 or "." in path.rpartition("/")[2]:
                raise
            response = await super().get_response("index.html", scope)
            path = "index.html"
        response.headers["Cache-Control"] = IMMUTABLE if path.startswith(ASSETS) else FRESH
        return response

    async def _found(self, path: str, scope: Scope) -> Response:
        """The file, as small as it lies there in an encoding that the browser takes."""
        if not path.startswith(ASSETS):
            return await super().get_response(path, scope)
        accepted = _accepted(Headers(scope=scope).get("accept-encoding", ""))
        for encoding, ending in ENCODINGS:
            if encoding not in accepted or self.lookup_path(path + ending)[1] is None:
                continue
            response = await super().get_response(path + ending, scope)
            response.headers["Content-Type"] = mimetypes.guess_type(path)[0] or "application/octet-stream"
            response.headers["Content-Encoding"] = encoding
            response.headers["Vary"] = "Accept-Encoding"
            return response
        return await super().get_response(path, scope)


def _accepted(header: str) -> set[str]:
    """The encodings that a browser takes; those with a weight of nought it does not."""
    parts = (part.partition(";") for part in header.lower().split(","))
    return {
        name.strip()
        for name, _, weight in parts
        if weight.replace(" ", "") not in {"q=0", "q=0.0", "q=0.00", "q=0.000"}
    }


def find_console(directory: Path | None) -> Path | None:
    """Where the built console is: as told, inside the installed package, or in a working tree."""
    candidates = (
        [directory]
        if directory is not None
        else [Path(__file__).parent / "static", Path(__file__).parents[2] / "frontend" / "dist"]
    )
    return next((each for each in candidates if (each / "index.html").is_file()), None)


def install(app: FastAPI, directory: Path | None) -> None:
    """Serve the console at /; without one, a text that says so."""
    if directory is not None:
        files = _Console(directory=directory, html=True)
        # A route and no mount: a mount would take what other routes have with another method.
        app.router.routes.append(Route("/{path:path}", files, methods=["GET"], include_in_schema=False))
        return

    async def not_built() -> Response:
        return PlainTextResponse(NOT_BUILT, headers={"Cache-Control": FRESH})

    app.add_api_route("/", not_built, include_in_schema=False)
