"""Aerial images from somebody's WMTS, asked for by this server, so that a browser asks nobody else.

A server that hangs or refuses costs one request at a time and some seconds; then it is left alone for a while.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from typing import Final

import httpx

from wonderland_backend.maps.archive import MapError
from wonderland_backend.settings.maps import MapSettings

MAX_TILE: Final = 2 << 20
KEPT_BYTES: Final = 48 << 20
AT_ONCE: Final = 8
REST_S: Final = 20.0
"""How long a server that did not answer is left alone."""
PLAIN: Final = {"Accept-Encoding": "identity"}
"""What is packed can be a thousand times larger than it looks."""
IMAGES: Final = ("image/png", "image/jpeg", "image/webp", "image/avif")


class ImageryError(MapError):
    """The WMTS gave no image that browsers may be shown."""


class Imagery:
    """Tiles of one WMTS, the last ones kept."""

    def __init__(self, settings: MapSettings, client: httpx.AsyncClient) -> None:
        self._settings = settings
        self._client = client
        self._kept: OrderedDict[tuple[int, int, int], tuple[str, bytes]] = OrderedDict()
        self._size = 0
        self._free = asyncio.Semaphore(AT_ONCE)
        self._rests_until_s = 0.0
        self.failure: ImageryError | None = None
        """What was wrong at the last request."""

    async def tile(self, z: int, x: int, y: int) -> tuple[str, bytes]:
        """Its media type and content. Raises `ImageryError`."""
        key = (z, x, y)
        if (known := self._kept.get(key)) is not None:
            self._kept.move_to_end(key)
            return known
        async with self._free:
            loop = asyncio.get_running_loop()
            if self.failure is not None and loop.time() < self._rests_until_s:
                raise self.failure.with_traceback(None)
            try:
                found = await self._ask(z, x, y)
            except ImageryError as error:
                self.failure = error
                self._rests_until_s = loop.time() + REST_S
                raise
        self.failure = None
        self._keep(key, found)
        return found

    async def _ask(self, z: int, x: int, y: int) -> tuple[str, bytes]:
        assert self._settings.wmts is not None
        url = self._settings.wmts.replace("{z}", str(z)).replace("{x}", str(x)).replace("{y}", str(y))
        limit_s = self._settings.wmts_timeout_s
        body = bytearray()
        try:
            async with asyncio.timeout(limit_s), self._client.stream("GET", url, headers=PLAIN) as answer:
                kind = answer.headers.get("content-type", "").partition(";")[0].strip().lower()
                if answer.status_code == httpx.codes.NOT_FOUND:
                    return "image/png", b""
                if answer.is_redirect:
                    raise ImageryError("wmts_elsewhere")
                if answer.status_code != httpx.codes.OK or kind not in IMAGES:
                    raise ImageryError("wmts_answer", status=answer.status_code, kind=kind or "no type")
                if answer.headers.get("content-encoding", "identity") != "identity":
                    raise ImageryError("wmts_packed")
                async for part in answer.aiter_raw():
                    body += part
                    if len(body) > MAX_TILE:
                        raise ImageryError("wmts_large", limit=MAX_TILE >> 20)
        except TimeoutError:
            raise ImageryError("wmts_slow", limit=f"{limit_s:g}") from None
        except (httpx.HTTPError, httpx.InvalidURL) as cause:
            raise ImageryError("wmts_away", error=type(cause).__name__) from None
        return kind, bytes(body)

    def _keep(self, key: tuple[int, int, int], found: tuple[str, bytes]) -> None:
        self._kept[key] = found
        self._size += len(found[1])
        while self._size > KEPT_BYTES:
            _, (_, dropped) = self._kept.popitem(last=False)
            self._size -= len(dropped)
