"""The base maps by REST: their description, archives by byte ranges, aerial images by tiles."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend.access import SIGNED_IN
from wonderland_backend.errors import NotFound, documented
from wonderland_backend.maps.archive import Archive, ArchiveError, ReplacedError
from wonderland_backend.maps.imagery import ImageryError
from wonderland_backend.maps.ranges import RangeError, parse
from wonderland_backend.maps.schemas import BaseMap
from wonderland_backend.maps.service import MapsDep
from wonderland_backend.responses import resource

router = APIRouter(prefix="/map", tags=["map"], dependencies=SIGNED_IN)
KEPT: Final = "private, max-age=604800, immutable"
"""Under an address that names the version of the file."""
ASKED_ANEW: Final = "private, no-cache"
BYTES: Final = "application/octet-stream"
IMAGE_KEPT: Final = "private, max-age=86400"
MAX_ZOOM: Final = 22

Zoom = Annotated[int, Path(ge=0, le=MAX_ZOOM)]
Index = Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)]


@router.get("", response_model=BaseMap, responses=documented(etag=True))
async def read_base_map(request: Request, maps: MapsDep) -> Response:
    """What the console's map is drawn from, and what of it is missing and where that is set."""
    prefix = request.url.path.removesuffix("/map")
    return resource(request, await asyncio.to_thread(maps.describe, prefix))


@router.get("/archive", include_in_schema=False)
async def read_archive(request: Request, maps: MapsDep) -> Response:
    """The archive of vector tiles, by byte ranges."""
    return await _part(request, maps.archive)


@router.get("/terrain", include_in_schema=False)
async def read_terrain(request: Request, maps: MapsDep) -> Response:
    """The archive of heights, by byte ranges."""
    return await _part(request, maps.terrain)


@router.get("/imagery", include_in_schema=False)
async def read_imagery(request: Request, maps: MapsDep) -> Response:
    """The archive of aerial images, by byte ranges."""
    return await _part(request, maps.images)


@router.get("/imagery/{z}/{x}/{y}", include_in_schema=False)
async def read_image(maps: MapsDep, z: Zoom, x: Index, y: Index) -> Response:
    """One aerial image of the WMTS."""
    wmts = maps.wmts
    if wmts is None or x >= 1 << z or y >= 1 << z:
        raise NotFound(said("no_such_image"))
    try:
        kind, body = await wmts.tile(z, x, y)
    except ImageryError:
        # What is wrong with it is in the description, which the console shows once instead of for each tile.
        return Response(status_code=204, headers={"Cache-Control": "no-store"})
    if not body:
        return Response(status_code=204, headers={"Cache-Control": IMAGE_KEPT})
    return Response(body, media_type=kind, headers={"Cache-Control": IMAGE_KEPT})


async def _part(request: Request, archive: Archive | None) -> Response:
    if archive is None:
        raise NotFound(said("no_such_map"))
    wanted = request.query_params.get("v")
    try:
        description = await asyncio.to_thread(archive.describe)
        if wanted not in {None, description.tag}:
            return _replaced()
        tag = f'"{description.tag}"'
        # What is kept for a week must be what its address says.
        kept = wanted is not None and description.settled
        headers = {"ETag": tag, "Accept-Ranges": "bytes", "Cache-Control": KEPT if kept else ASKED_ANEW}
        if tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        asked = request.headers.get("range")
        if request.headers.get("if-range", tag) != tag:
            asked = None
        if getattr(request.state, "is_head", False):  # nothing of a large file is read for it
            headers["Content-Length"] = str(description.size_bytes)
            return Response(headers=headers, media_type=BYTES)
        try:
            first, length = parse(asked, description.size_bytes)
        except RangeError as error:
            headers |= {"Content-Range": f"bytes */{description.size_bytes}", "Cache-Control": "no-store"}
            return Response(f"{error}\n", 416, headers, "text/plain")
        body = await asyncio.to_thread(archive.part, first, length, description.tag)
    except ReplacedError:
        return _replaced()
    except ArchiveError as error:
        raise NotFound(said("map_unreadable", why=error)) from error
    if asked is None:
        return Response(body, headers=headers, media_type=BYTES)
    headers["Content-Range"] = f"bytes {first}-{first + len(body) - 1}/{description.size_bytes}"
    return Response(body, 206, headers, BYTES)


def _replaced() -> Response:
    """Never a part of another archive than the one that the reader has begun: it asks for the description anew."""
    return Response("The map was replaced.\n", 410, {"Cache-Control": "no-store"}, "text/plain")
