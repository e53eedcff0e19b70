"""A client of the DSS: several instances of one service, whichever answers.

All instances of a region hold the same, so that a version from one is good at another. An instance that does not
answer is left alone for a while. No start time is ever sent: the DSS puts its own, and clocks need not agree.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar
from urllib.parse import quote, urlsplit

import orjson
from pydantic import BaseModel
from uas_standards.astm.f3411.v22a.constants import Scope

from wonderland_backend.http.backoff import Backoff, retry_after_s
from wonderland_backend.http.times import rfc3339
from wonderland_backend.http.transfer import TransferError, parse_object
from wonderland_backend.uspace.dss import models
from wonderland_backend.uspace.dss.errors import AreaTooLarge, DssAway, DssRefused, NotThere, TooMany, VersionConflict
from wonderland_backend.uspace.geo import E7, Box
from wonderland_backend.uspace.peers import Peers

logger = logging.getLogger(__name__)

SERVICE_PROVIDER: Final = Scope.ServiceProvider.value
DISPLAY_PROVIDER: Final = Scope.DisplayProvider.value
AREAS: Final = "/dss/identification_service_areas"
SUBSCRIPTIONS: Final = "/dss/subscriptions"
_REFUSALS: Final[Mapping[int, type[DssRefused]]] = {404: NotThere, 409: VersionConflict, 413: AreaTooLarge}
_Model = TypeVar("_Model", bound=BaseModel)


class _Instance:
    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self.host = urlsplit(url).hostname or ""
        self.backoff = Backoff(first_s=5.0, longest_s=300.0)


class DssClient:
    """Speaks to the DSS as service provider and as display provider."""

    def __init__(self, urls: Sequence[str], *, clock: Callable[[], int], peers: Peers) -> None:
        """`urls` are the instances' addresses, preferred first; `clock` gives Unix ms."""
        self._instances = [_Instance(url) for url in urls]
        self._clock = clock
        self._peers = peers

    @property
    def is_configured(self) -> bool:
        """Whether there is a DSS at all."""
        return bool(self._instances)

    async def versions(self, area_id: str) -> dict[str, str]:
        """The version of an area of ours at each instance that answers, by its address; "" where it is not there."""
        found = {}
        for instance in self._instances:
            try:
                path = _path(AREAS, area_id)
                answer = await self._ask_one(instance, models.GetArea, "GET", path, SERVICE_PROVIDER, None, None)
            except NotThere:
                found[instance.url] = ""
            except TransferError:
                continue
            else:
                found[instance.url] = answer.service_area.version
        return found

    async def put_area(
        self, area_id: str, extents: Mapping[str, Any], base_url: str, version: str | None
    ) -> models.PutArea:
        """Create an identification service area, or with `version` change it. Raises `DssError`."""
        body = {"extents": extents, "uss_base_url": base_url}
        return await self._ask(models.PutArea, "PUT", _path(AREAS, area_id, version), SERVICE_PROVIDER, body)

    async def get_area(self, area_id: str) -> models.Area:
        """An area as it is now. Raises `DssError`."""
        found = await self._ask(models.GetArea, "GET", _path(AREAS, area_id), SERVICE_PROVIDER)
        return found.service_area

    async def delete_area(self, area_id: str, version: str) -> models.PutArea:
        """Take an area back; who is to be told of it. Raises `DssError`."""
        return await self._ask(models.PutArea, "DELETE", _path(AREAS, area_id, version), SERVICE_PROVIDER)

    async def search_areas(self, box: Box, *, from_ms: int, until_ms: int) -> list[models.Area]:
        """The areas in or near a box during a time. Raises `DssError`."""
        query = {"area": polygon_text(box), "earliest_time": rfc3339(from_ms), "latest_time": rfc3339(until_ms)}
        found = await self._ask(models.FoundAreas, "GET", AREAS, DISPLAY_PROVIDER, params=query)
        return found.service_areas

    async def put_subscription(
        self, subscription_id: str, extents: Mapping[str, Any], base_url: str, version: str | None
    ) -> models.PutSubscription:
        """Subscribe, or with `version` change a subscription; with the areas that are there. Raises `DssError`."""
        body = {"extents": extents, "uss_base_url": base_url}
        path = _path(SUBSCRIPTIONS, subscription_id, version)
        return await self._ask(models.PutSubscription, "PUT", path, DISPLAY_PROVIDER, body)

    async def get_subscription(self, subscription_id: str) -> models.Subscription:
        """A subscription of ours. Raises `DssError`."""
        path = _path(SUBSCRIPTIONS, subscription_id)
        found = await self._ask(models.GetSubscription, "GET", path, DISPLAY_PROVIDER)
        return found.subscription

    async def delete_subscription(self, subscription_id: str, version: str) -> None:
        """End a subscription. Raises `DssError`."""
        path = _path(SUBSCRIPTIONS, subscription_id, version)
        await self._ask(models.PutSubscription, "DELETE", path, DISPLAY_PROVIDER)

    async def _ask(
        self,
        model: type[_Model],
        method: str,
        path: str,
        scope: str,
        body: Mapping[str, Any] | None = None,
        *,
        params: Mapping[str, str] | None = None,
    ) -> _Model:
        """The first good answer of an instance. Raises `DssRefused` for a no, `DssAway` when none answers."""
        problem = "no DSS is configured"
        now = self._clock()
        waiting = sorted(self._instances, key=lambda each: not each.backoff.is_open(now))
        for instance in waiting:
            try:
                answer = await self._ask_one(instance, model, method, path, scope, body, params)
            except DssRefused:
                instance.backoff.succeeded()
                raise
            except TransferError as error:
                instance.backoff.failed(self._clock())
                problem = str(error)
                logger.warning("a DSS could not be asked: %s", problem)
            else:
                instance.backoff.succeeded()
                return answer
        raise DssAway(problem)

    async def _ask_one(
        self,
        instance: _Instance,
        model: type[_Model],
        method: str,
        path: str,
        scope: str,
        body: Mapping[str, Any] | None,
        params: Mapping[str, str] | None,
    ) -> _Model:
        url = instance.url + path
        status, answered, content = await self._peers.ask(method, url, scope, json=body, params=params)
        if status in {200, 201}:
            try:
                return models.parse(model, parse_object(content, url))
            except ValueError as error:
                raise TransferError(f"{instance.host} answered what it should not: {error}") from None
        if status == 429:
            wait_s = retry_after_s(answered.get("retry-after"), self._clock())
            raise TooMany(status, _message(content), wait_s)
        if 400 <= status < 500 and status != 401:
            raise _REFUSALS.get(status, DssRefused)(status, _message(content))
        raise TransferError(f"{instance.host} answered {status}")


def polygon_text(box: Box) -> str:
    """A box as `GeoPolygonString`."""
    return ",".join(f"{vertex['lat']},{vertex['lng']}" for vertex in box.vertices())


def extents_of(box: Box, *, until_ms: int, is_cap: bool) -> dict[str, Any]:
    """`Volume4D` of a box over all heights that drones fly in, from now on; around a pole it is a circle."""
    outline: dict[str, Any] = {"outline_polygon": {"vertices": box.vertices()}}
    if is_cap:
        pole, edge = (box.north, box.south) if box.north > 0 else (box.south, box.north)
        radius_m = abs(pole - edge) / E7 * 111_700
        center = {"lat": pole / E7, "lng": 0.0}
        outline = {"outline_circle": {"center": center, "radius": {"value": radius_m, "units": "M"}}}
    return {
        "volume": {**outline, "altitude_lower": _altitude(-500), "altitude_upper": _altitude(10_000)},
        "time_end": {"value": rfc3339(until_ms), "format": "RFC3339"},
    }


def _altitude(value_m: float) -> dict[str, Any]:
    return {"value": value_m, "reference": "W84", "units": "M"}


def _path(collection: str, *parts: str | None) -> str:
    # Quoted: a version is the DSS's own text, and may hold anything.
    return "/".join((collection, *(quote(part, safe="") for part in parts if part is not None)))


def _message(content: bytes) -> str:
    """`ErrorResponse`'s message, as far as there is one."""
    try:
        found = orjson.loads(content).get("message")
    except (orjson.JSONDecodeError, AttributeError):
        found = None
    return found[:300] if isinstance(found, str) else "without a reason"
