"""A small DSS by the F3411-22a interface file: areas, subscriptions, versions, owners, who is to be told.

It keeps everything in memory and compares areas by their bounding boxes. What real ones refuse, it refuses: tokens
without the scope, versions that are not the present one, areas that are too large, an eleventh subscription.
"""

from __future__ import annotations

import time
import uuid
from dataclasses import dataclass, field

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse
from joserfc import jwt
from joserfc.jwk import KeySet

from wonderland_backend.http.times import rfc3339, unix_ms
from wonderland_backend.uspace.dss import models
from wonderland_backend.uspace.geo import Box

MAX_AREA_M2 = 2_500e6
MAX_SUBSCRIPTIONS = 10


class Refused(Exception):  # noqa: N818 - an answer
    def __init__(self, status, message, headers=None):
        super().__init__(message)
        self.status, self.message, self.headers = status, message, headers


@dataclass
class Entity:
    entity_id: str
    owner: str
    base_url: str
    box: Box
    start_ms: int
    end_ms: int
    version: str = field(default_factory=lambda: uuid.uuid4().hex)
    index: int = 0

    def area(self):
        return {
            "id": self.entity_id, "owner": self.owner, "uss_base_url": self.base_url, "version": self.version,
            "time_start": stamp(self.start_ms), "time_end": stamp(self.end_ms),
        }  # fmt: skip

    def subscription(self):
        return self.area() | {"notification_index": self.index}


def stamp(t_ms):
    return {"value": rfc3339(t_ms), "format": "RFC3339"}


class Dss:
    """One DAR; `instances` of it can be served at several addresses."""

    def __init__(self, authority):
        self.authority = authority
        self.areas = {}
        self.subscriptions = {}
        self.asked = []
        self.refusals = []
        """Answers to give instead, one for each request: (status, headers)."""
        self.offset_ms = 0
        self.url = ""
        self.app = self.instance()

    def instance(self):
        app = FastAPI()
        app.add_exception_handler(Refused, lambda _, e: JSONResponse({"message": e.message}, e.status, e.headers))
        for path, methods, endpoint in (
            ("/dss/identification_service_areas", ["GET"], self.search_areas),
            ("/dss/identification_service_areas/{entity_id}", ["GET"], self.get_area),
            ("/dss/identification_service_areas/{entity_id}", ["PUT"], self.put_area),
            ("/dss/identification_service_areas/{entity_id}/{version}", ["PUT"], self.put_area),
            ("/dss/identification_service_areas/{entity_id}/{version}", ["DELETE"], self.delete_area),
            ("/dss/subscriptions", ["GET"], self.search_subscriptions),
            ("/dss/subscriptions/{entity_id}", ["GET"], self.get_subscription),
            ("/dss/subscriptions/{entity_id}", ["PUT"], self.put_subscription),
            ("/dss/subscriptions/{entity_id}/{version}", ["PUT"], self.put_subscription),
            ("/dss/subscriptions/{entity_id}/{version}", ["DELETE"], self.delete_subscription),
        ):
            app.add_api_route(path, endpoint, methods=methods)
        return app

    def now_ms(self):
        return time.time_ns() // 1_000_000 + self.offset_ms

    def owner(self, request, *scopes):
        self.asked.append((request.method, request.url.path))
        if self.refusals:
            status, headers = self.refusals.pop(0)
            raise Refused(status, "as the test wants", headers)
        token = request.headers.get("authorization", "").removeprefix("Bearer ")
        keys = KeySet([self.authority.keys[name] for name in self.authority.published])
        try:
            claims = jwt.decode(token, keys, algorithms=["RS256", "ES256"]).claims
        except Exception as error:
            raise Refused(401, str(error)) from error
        if claims["exp"] < time.time() or claims["aud"] != request.url.hostname:
            raise Refused(401, "expired, or for somebody else")
        if not set(claims["scope"].split()) & set(scopes):
            raise Refused(403, "scope")
        return claims["sub"]

    async def extents(self, request):
        body = await request.json()
        extents = body["extents"]
        box = models.parse(models.Volume4D, extents).volume.box()
        if box is None:
            raise Refused(400, "no outline")
        if box.area_m2() > MAX_AREA_M2:
            raise Refused(413, "too large")
        start = extents.get("time_start")
        start_ms = unix_ms(start["value"]) if start else self.now_ms()
        if start_ms < self.now_ms() - 5_000:
            raise Refused(400, "starts in the past")
        end_ms = unix_ms(extents["time_end"]["value"])
        if end_ms <= start_ms:
            raise Refused(400, "ends before it starts")
        return body["uss_base_url"], box, start_ms, end_ms

    def live(self, entities):
        return [each for each in entities.values() if each.end_ms > self.now_ms()]

    def put(self, entities, entity_id, version, owner, base_url, box, start_ms, end_ms):
        known = entities.get(entity_id)
        if known is not None and known.end_ms <= self.now_ms():
            known = entities.pop(entity_id) and None
        if version is None and known is not None:
            raise Refused(409, "exists already")
        if version is not None and known is None:
            raise Refused(404, "is not there")
        if known is not None and known.owner != owner:
            raise Refused(403, "is somebody else's")
        if known is not None and known.version != version:
            raise Refused(409, "has another version")
        start_ms = start_ms if known is None else known.start_ms
        made = Entity(entity_id, owner, base_url, box, start_ms, end_ms, index=known.index if known else 0)
        entities[entity_id] = made
        return made

    def take(self, entities, entity_id, version, owner):
        known = entities.get(entity_id)
        if known is None:
            raise Refused(404, "is not there")
        if known.owner != owner:
            raise Refused(403, "is somebody else's")
        if known.version != version:
            raise Refused(409, "has another version")
        return entities.pop(entity_id)

    def subscribers(self, box):
        told = {}
        for each in self.live(self.subscriptions):
            if each.box.meets(box):
                each.index += 1
                state = {"subscription_id": each.entity_id, "notification_index": each.index}
                told.setdefault(each.base_url, []).append(state)
        return [{"url": url, "subscriptions": states} for url, states in told.items()]

    async def search_areas(self, request: Request):
        self.owner(request, "rid.display_provider")
        numbers = [float(each) for each in request.query_params["area"].split(",")]
        points = [{"lat": lat, "lng": lng} for lat, lng in zip(numbers[::2], numbers[1::2], strict=True)]
        box = models.parse(models.Polygon, {"vertices": points})
        box = models.Volume3D(outline_polygon=box).box()
        return {"service_areas": [each.area() for each in self.live(self.areas) if each.box.meets(box)]}

    async def get_area(self, request: Request, entity_id: str):
        self.owner(request, "rid.display_provider", "rid.service_provider")
        if entity_id not in self.areas:
            raise Refused(404, "is not there")
        return {"service_area": self.areas[entity_id].area()}

    async def put_area(self, request: Request, entity_id: str, version: str | None = None):
        owner = self.owner(request, "rid.service_provider")
        made = self.put(self.areas, entity_id, version, owner, *await self.extents(request))
        return {"service_area": made.area(), "subscribers": self.subscribers(made.box)}

    async def delete_area(self, request: Request, entity_id: str, version: str):
        owner = self.owner(request, "rid.service_provider")
        gone = self.take(self.areas, entity_id, version, owner)
        return {"service_area": gone.area(), "subscribers": self.subscribers(gone.box)}

    async def search_subscriptions(self, request: Request):
        owner = self.owner(request, "rid.display_provider")
        return {"subscriptions": [each.subscription() for each in self.live(self.subscriptions) if each.owner == owner]}

    async def get_subscription(self, request: Request, entity_id: str):
        self.owner(request, "rid.display_provider", "rid.service_provider")
        if entity_id not in self.subscriptions:
            raise Refused(404, "is not there")
        return {"subscription": self.subscriptions[entity_id].subscription()}

    async def put_subscription(self, request: Request, entity_id: str, version: str | None = None):
        owner = self.owner(request, "rid.display_provider")
        base_url, box, start_ms, end_ms = await self.extents(request)
        same = [each for each in self.live(self.subscriptions) if each.owner == owner and each.box.meets(box)]
        if version is None and len(same) >= MAX_SUBSCRIPTIONS:
            raise Refused(429, "too many subscriptions", {"Retry-After": "7"})
        made = self.put(self.subscriptions, entity_id, version, owner, base_url, box, start_ms, end_ms)
        areas = [each.area() for each in self.live(self.areas) if each.box.meets(box)]
        return {"subscription": made.subscription(), "service_areas": areas}

    async def delete_subscription(self, request: Request, entity_id: str, version: str):
        owner = self.owner(request, "rid.display_provider")
        return {"subscription": self.take(self.subscriptions, entity_id, version, owner).subscription()}
