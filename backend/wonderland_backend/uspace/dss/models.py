"""What a DSS and other providers send about areas, checked where it comes in.

Only what is used is read, and unknown fields are ignored, as F3411 asks.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from wonderland_backend.field_texts import FieldRefused, first_error
from wonderland_backend.http.addresses import ADDRESS
from wonderland_backend.http.times import unix_ms
from wonderland_backend.uspace.geo import E7, TURN, Box

UUID4 = r"^[0-9a-fA-F]{8}-[0-9a-fA-F]{4}-[0-9a-fA-F]{4}-[0-9a-fA-F]{4}-[0-9a-fA-F]{12}$"
EntityId = Annotated[str, Field(pattern=UUID4)]
Address = Annotated[str, Field(max_length=500, pattern=f"^{ADDRESS}$")]
Version = Annotated[str, Field(min_length=1, max_length=200)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]


class Foreign(BaseModel):
    """Base of what others send."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


def _is_time(text: str) -> str:
    unix_ms(text)
    return text


class Time(Foreign):
    """`Time`."""

    value: Annotated[str, Field(max_length=64), AfterValidator(_is_time)]

    @property
    def t_ms(self) -> int:
        """The time as Unix ms."""
        return unix_ms(self.value)


class Point(Foreign):
    """`LatLngPoint`."""

    lat: Latitude
    lng: Longitude


class Area(Foreign):
    """`IdentificationServiceArea`."""

    id: EntityId
    uss_base_url: Address
    owner: Annotated[str, Field(max_length=256)]
    time_start: Time
    time_end: Time
    version: Version

    def content(self) -> dict[str, Any]:
        """As it is sent on."""
        times = {
            name: {"value": time.value, "format": "RFC3339"}
            for name, time in (("time_start", self.time_start), ("time_end", self.time_end))
        }
        return {**self.model_dump(exclude={"time_start", "time_end"}), **times}


class Notified(Foreign):
    """`SubscriptionState`."""

    subscription_id: EntityId
    notification_index: Annotated[int, Field(ge=0)] = 0


class Subscriber(Foreign):
    """`SubscriberToNotify`."""

    url: Address
    subscriptions: Annotated[list[Notified], Field(max_length=1_000)]


class Subscription(Foreign):
    """`Subscription`."""

    id: EntityId
    version: Version
    notification_index: Annotated[int, Field(ge=0)] = 0
    time_end: Time | None = None


class Polygon(Foreign):
    """`Polygon`."""

    vertices: Annotated[list[Point], Field(min_length=3, max_length=1_500)]


class Radius(Foreign):
    """`Radius`."""

    value: Annotated[float, Field(gt=0, le=20_000_000)]


class Circle(Foreign):
    """`Circle`."""

    center: Point
    radius: Radius


class Volume3D(Foreign):
    """`Volume3D`."""

    outline_circle: Circle | None = None
    outline_polygon: Polygon | None = None

    def box(self) -> Box | None:
        """A box around it; None where it has no outline."""
        if self.outline_polygon is not None:
            return _around(self.outline_polygon.vertices)
        if self.outline_circle is not None:
            center = self.outline_circle.center
            return Box.around(center.lat, center.lng, self.outline_circle.radius.value)
        return None


class Volume4D(Foreign):
    """`Volume4D`."""

    volume: Volume3D


class PutArea(Foreign):
    """`PutIdentificationServiceAreaResponse`, and the answer to a deletion."""

    service_area: Area
    subscribers: Annotated[list[Subscriber], Field(max_length=10_000)] = []


class GetArea(Foreign):
    """`GetIdentificationServiceAreaResponse`."""

    service_area: Area


class FoundAreas(Foreign):
    """`SearchIdentificationServiceAreasResponse`."""

    service_areas: Annotated[list[Area], Field(max_length=10_000)] = []


class PutSubscription(Foreign):
    """`PutSubscriptionResponse`, and the answer to a deletion."""

    subscription: Subscription
    service_areas: Annotated[list[Area], Field(max_length=10_000)] = []


class GetSubscription(Foreign):
    """`GetSubscriptionResponse`."""

    subscription: Subscription


class AreaNotification(Foreign):
    """`PutIdentificationServiceAreaNotificationParameters`."""

    service_area: Area | None = None
    subscriptions: Annotated[list[Notified], Field(max_length=500)]
    extents: Volume4D | None = None


_Model = TypeVar("_Model", bound=BaseModel)


def parse(model: type[_Model], document: Any) -> _Model:
    """What somebody sent, as it should be. Raises ValueError with the first thing that is wrong."""
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise FieldRefused(first_error(error.errors(include_input=False, include_url=False))) from None


def _around(points: list[Point]) -> Box:
    """The narrowest box around a polygon: its widest gap in longitude lies outside."""
    lats = [round(point.lat * E7) for point in points]
    lngs = sorted({round(point.lng * E7) % TURN for point in points})
    gaps = [((lngs[(i + 1) % len(lngs)] - lng - 1) % TURN + 1, i) for i, lng in enumerate(lngs)]
    widest, before = max(gaps)
    west = lngs[(before + 1) % len(lngs)]
    west = west - TURN if west >= TURN // 2 else west
    return Box(min(lats), west, max(lats), TURN - widest)
