"""Who serves in the tiles that somebody looks at: subscriptions in the DSS, kept while they are looked at."""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Final

from wonderland.problems import said
from wonderland_backend.errors import Problem, TooManyRequests
from wonderland_backend.http.backoff import Backoff
from wonderland_backend.http.transfer import TransferError
from wonderland_backend.uspace.dss.client import DssClient, extents_of
from wonderland_backend.uspace.dss.errors import DssError, NotThere, TooMany, VersionConflict
from wonderland_backend.uspace.dss.models import Area, AreaNotification
from wonderland_backend.uspace.geo import Cell

logger = logging.getLogger(__name__)

LIFETIME_MS: Final = 10 * 60_000
RENEW_MS: Final = 2 * 60_000
"""With less than this left, a subscription that is in use is renewed."""
UNUSED_MS: Final = 2 * 60_000
SEARCH_MS: Final = 10_000
"""Where the DSS gives no more subscriptions, areas are looked up this often instead."""
MAX_WATCHES: Final = 400


class NotTheOwner(Problem):
    """The area belongs to somebody else than who sends it."""

    status, code = HTTPStatus.FORBIDDEN, "not-the-owner"
    example = said("area_of_other")


class OtherArea(Problem):
    """This version of the area was received before, with other content."""

    status, code = HTTPStatus.CONFLICT, "version-conflict"
    example = said("area_version_differs")


@dataclass
class _Watch:
    cell: Cell
    subscription_id: str
    version: str | None = None
    until_ms: int = 0
    """Until when what is known here is good."""
    used_ms: int = 0
    index: int = 0
    areas: dict[str, Area] = field(default_factory=dict)
    backoff: Backoff = field(default_factory=lambda: Backoff(first_s=2.0))
    renewing: asyncio.Lock = field(default_factory=asyncio.Lock)


class Watches:
    """Knows who serves where, as far as somebody asked lately."""

    def __init__(self, dss: DssClient, *, base_url: str, clock: Callable[[], int]) -> None:
        self._dss = dss
        self._base_url = base_url
        self._clock = clock
        self._watches: dict[Cell, _Watch] = {}

    async def providers(self, cells: Iterable[Cell]) -> set[str]:
        """The addresses of others that serve in these tiles now. Raises `TooManyRequests`."""
        if not self._dss.is_configured:
            return set()
        now = self._clock()
        watches = [self._watch(cell, now) for cell in cells]
        await asyncio.gather(*(self._refresh(watch) for watch in watches))
        now = self._clock()
        return {
            area.uss_base_url
            for watch in watches
            for area in watch.areas.values()
            if area.time_end.t_ms > now and area.uss_base_url != self._base_url
        }

    def take_notification(self, area_id: str, notice: AreaNotification, sender: str) -> None:
        """A notification about an area, from whom its token names. Raises `NotTheOwner`, `OtherArea`."""
        area = notice.service_area
        if area is not None and (area.owner != sender or area.id.lower() != area_id.lower()):
            raise NotTheOwner(said("area_not_by_owner"))
        for watch in self._watches.values():
            known = watch.areas.get(area_id.lower())
            if known is not None:
                _require_owner(known, area, sender)
        told = {each.subscription_id.lower(): each.notification_index for each in notice.subscriptions}
        for watch in self._watches.values():
            if watch.subscription_id not in told:
                continue
            index = told[watch.subscription_id]
            if index > watch.index + 1:
                watch.until_ms = 0  # one was missed: look again
            watch.index = max(index, watch.index)
            if area is None:
                watch.areas.pop(area_id.lower(), None)
            else:
                watch.areas[area_id.lower()] = area

    async def tidy(self) -> None:
        """End the subscriptions that nobody uses any more."""
        now = self._clock()
        unused = [watch for watch in self._watches.values() if now - watch.used_ms > UNUSED_MS]
        for watch in unused:
            del self._watches[watch.cell]
        await asyncio.gather(*(self._end(watch) for watch in unused))

    def _watch(self, cell: Cell, now_ms: int) -> _Watch:
        watch = self._watches.get(cell)
        if watch is None:
            if len(self._watches) >= MAX_WATCHES:
                raise TooManyRequests(said("watches_busy"))
            watch = self._watches[cell] = _Watch(cell, str(uuid.uuid4()))
        watch.used_ms = now_ms
        return watch

    async def _refresh(self, watch: _Watch) -> None:
        async with watch.renewing:
            now = self._clock()
            ends_ms = watch.until_ms - (RENEW_MS if watch.version is not None else 0)
            if now < ends_ms or not watch.backoff.is_open(now):
                return
            try:
                await self._subscribe(watch)
            except TooMany:
                await self._search(watch)
            except TransferError as error:
                watch.backoff.failed(now)
                logger.warning("providers could not be looked up: %s", error)
            else:
                watch.backoff.succeeded()

    async def _subscribe(self, watch: _Watch) -> None:
        until_ms = self._clock() + LIFETIME_MS
        extents = extents_of(watch.cell.box(), until_ms=until_ms, is_cap=watch.cell.is_cap)
        try:
            put = await self._dss.put_subscription(watch.subscription_id, extents, self._base_url, watch.version)
        except (NotThere, VersionConflict):
            # Ended meanwhile, or changed by an answer that never reached us: a new one is as good.
            watch.subscription_id, watch.version = str(uuid.uuid4()), None
            put = await self._dss.put_subscription(watch.subscription_id, extents, self._base_url, None)
        watch.version = put.subscription.version
        watch.index = put.subscription.notification_index
        ends = put.subscription.time_end
        watch.until_ms = until_ms if ends is None else min(until_ms, ends.t_ms)
        watch.areas = {area.id.lower(): area for area in put.service_areas}

    async def _search(self, watch: _Watch) -> None:
        now = self._clock()
        try:
            areas = await self._dss.search_areas(watch.cell.box(), from_ms=now, until_ms=now + SEARCH_MS)
        except DssError as error:
            watch.backoff.failed(now)
            logger.warning("providers could not be looked up: %s", error)
        else:
            watch.version = None
            watch.until_ms = now + SEARCH_MS
            watch.areas = {area.id.lower(): area for area in areas}

    async def _end(self, watch: _Watch) -> None:
        if watch.version is None:
            return
        try:
            await self._dss.delete_subscription(watch.subscription_id, watch.version)
        except TransferError as error:
            logger.info("a subscription ends by itself: %s", error)


def _require_owner(known: Area, area: Area | None, sender: str) -> None:
    if known.owner != sender:
        raise NotTheOwner(said("area_of_other"))
    if area is not None and area.version == known.version and area != known:
        raise OtherArea(said("area_version_differs"))
