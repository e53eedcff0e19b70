"""Identification service areas: tiles of the grid in which flights of ours are, announced to the DSS while they fly.

A tile is about 10 km wide and lies where it lies, so that an area tells nothing about a flight's path. Its id follows
from this installation and the tile: whoever starts again finds its areas, and replicas share them.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import uuid
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Final

from wonderland_backend.http.backoff import Backoff
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.uspace.dss import models
from wonderland_backend.uspace.dss.client import DssClient, extents_of
from wonderland_backend.uspace.dss.errors import NotThere, TooMany, VersionConflict
from wonderland_backend.uspace.geo import Box, Cell
from wonderland_backend.uspace.netrid.notify import Notifier

logger = logging.getLogger(__name__)

LIFETIME_MS: Final = 10 * 60_000
"""An area that nobody takes back ends by itself after so long."""
EXTEND_MS: Final = 4 * 60_000
"""With less than this left, an area that is still needed is extended."""
LINGER_MS: Final = 60_000
"""Kept so long after its last flight's last position, which is itself shown for a minute."""
ATTEMPTS: Final = 3
COMPARE_MS: Final = 5 * 60_000
"""How often it is looked whether all instances of the DSS have the same."""


@dataclass
class _Announced:
    cell: Cell
    area_id: str
    version: str | None = None
    until_ms: int = 0
    wanted_ms: int = 0
    salt: int = 0
    backoff: Backoff = field(default_factory=Backoff)


class Areas:
    """Keeps the DSS told where flights of ours are."""

    def __init__(
        self,
        dss: DssClient,
        notifier: Notifier,
        *,
        base_url: str,
        clock: Callable[[], int],
        on_problem: Callable[[str], None],
    ) -> None:
        """`base_url` is where other systems reach us; `on_problem` is told when an area cannot be announced."""
        self.instance = ""
        self._dss = dss
        self._notifier = notifier
        self._base_url = base_url
        self._clock = clock
        self._on_problem = on_problem
        self._announced: dict[Cell, _Announced] = {}
        self._compared_ms = clock()

    def covers(self, view: Box) -> bool:
        """Whether an area that stands meets a view."""
        return any(each.version is not None and cell.box().meets(view) for cell, each in self._announced.items())

    def find_extents(self, area_id: str) -> dict[str, Any] | None:
        """The extents of an area of ours."""
        for each in self._announced.values():
            if each.area_id == area_id and each.version is not None:
                return _extents(each.cell, each.until_ms)
        return None

    def __len__(self) -> int:
        return sum(each.version is not None for each in self._announced.values())

    async def step(self, wanted: Collection[Cell]) -> None:
        """Announce, extend and take back what is due. Never raises for what a DSS does; it is tried again."""
        now = self._clock()
        for cell in wanted:
            known = self._announced.get(cell)
            if known is None:
                known = self._announced[cell] = _Announced(cell, self._id(cell, 0))
            known.wanted_ms = now
        due = [each for each in self._announced.values() if each.backoff.is_open(now) and self._is_due(each, now)]
        await asyncio.gather(*(self._tend(each) for each in due))
        if now - self._compared_ms >= COMPARE_MS:
            self._compared_ms = now
            await self._compare()

    async def _compare(self) -> None:
        """Instances that differ lead others to look for flights where there are none, or not where they are."""
        for each in list(self._announced.values()):
            if each.version is None:
                continue
            versions = await self._dss.versions(each.area_id)
            if len(set(versions.values())) > 1:
                told = ", ".join(f"{url}: {version or 'none'}" for url, version in versions.items())
                logger.error("the instances of the DSS differ about our area %s (%s)", each.area_id, told)
                self._on_problem(f"The instances of the DSS differ about an area of ours ({told})")

    @staticmethod
    def _is_due(each: _Announced, now_ms: int) -> bool:
        if each.wanted_ms == now_ms:
            return each.version is None or each.until_ms - now_ms < EXTEND_MS
        return now_ms - each.wanted_ms >= LINGER_MS

    async def _tend(self, each: _Announced) -> None:
        now = self._clock()
        try:
            if now - each.wanted_ms >= LINGER_MS:
                await self._take_back(each)
                del self._announced[each.cell]
            else:
                await self._announce(each)
            each.backoff.succeeded()
        except TransferError as error:
            each.backoff.failed(now, error.retry_s if isinstance(error, TooMany) else None)
            logger.warning("an identification service area could not be announced: %s", error)
            self._on_problem(f"Network Remote ID is not announced just now: {error}")

    async def _announce(self, each: _Announced) -> None:
        for attempt in range(ATTEMPTS):
            until_ms = self._clock() + LIFETIME_MS
            extents = _extents(each.cell, until_ms)
            try:
                put = await self._dss.put_area(each.area_id, extents, self._base_url, each.version)
            except (VersionConflict, NotThere):
                if attempt + 1 == ATTEMPTS:
                    raise
                await self._look(each)
            else:
                each.version = put.service_area.version
                each.until_ms = min(until_ms, put.service_area.time_end.t_ms)
                self._tell(put, extents)
                return

    async def _look(self, each: _Announced) -> None:
        """Learn the area's version as it is now; one that is not ours is left alone, and another id is taken."""
        try:
            area = await self._dss.get_area(each.area_id)
        except NotThere:
            each.version = None
            return
        if area.uss_base_url == self._base_url:
            each.version = area.version
        else:
            each.salt += 1
            each.area_id, each.version = self._id(each.cell, each.salt), None

    async def _take_back(self, each: _Announced) -> None:
        for _ in range(ATTEMPTS):
            if each.version is None:
                return
            try:
                gone = await self._dss.delete_area(each.area_id, each.version)
            except NotThere:
                return
            except VersionConflict:
                await self._look(each)
            else:
                self._tell(gone, None)
                return

    def _tell(self, put: models.PutArea, extents: dict[str, Any] | None) -> None:
        for subscriber in put.subscribers:
            if subscriber.url == self._base_url:
                continue
            body: dict[str, Any] = {"subscriptions": [each.model_dump() for each in subscriber.subscriptions]}
            if extents is not None:
                body |= {"service_area": put.service_area.content(), "extents": extents}
            self._notifier.tell_subscriber(subscriber.url, put.service_area.id, body)

    def _id(self, cell: Cell, salt: int) -> str:
        text = f"{self.instance} {cell.level} {cell.row} {cell.column} {salt}"
        return str(uuid.UUID(bytes=hashlib.sha256(text.encode()).digest()[:16], version=4))


def _extents(cell: Cell, until_ms: int) -> dict[str, Any]:
    return extents_of(cell.box(), until_ms=until_ms, is_cap=cell.is_cap)
