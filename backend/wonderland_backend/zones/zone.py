"""A zone as it is asked about: volumes with their vertical limits, periods, texts. Made from a checked feature."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from math import cos, pi
from typing import Any, Final

import orjson
import shapely
from pyproj import Geod

from wonderland_backend.zones.files.common import DAYS, Json

FOOT_M: Final = 0.3048
CIRCLE_POINTS: Final = 96
STRICTNESS: Final = ("PROHIBITED", "REQ_AUTHORIZATION", "USPACE", "CONDITIONAL", "NO_RESTRICTION")
"""The most restrictive type first."""
_GEOD: Final = Geod(ellps="WGS84")
_WEEK: Final = frozenset(range(7))


@dataclass(frozen=True)
class Limit:
    """A vertical limit in metres above ``AGL``, ``AMSL`` or ``WGS84``."""

    metres: float
    reference: str


@dataclass(frozen=True)
class Volume:
    """An area (longitude, latitude; circles as polygons around them) between two limits; None: no limit."""

    area: Any
    lower: Limit | None
    upper: Limit | None


@dataclass(frozen=True)
class Clock:
    """A time of the day: seconds after midnight at an offset from UTC."""

    seconds: int
    offset_s: int


@dataclass(frozen=True)
class Daily:
    """On these days of the week (0: Monday) from an edge to an edge: a time, an event of daylight, or midnight."""

    days: frozenset[int]
    start: Clock | str | None
    end: Clock | str | None


@dataclass(frozen=True)
class Period:
    """Between two times; within that as scheduled, or throughout."""

    start_ms: int | None
    end_ms: int | None
    daily: tuple[Daily, ...]


@dataclass(frozen=True)
class Zone:
    """One zone of a data set."""

    zone_id: str
    type: str
    volumes: tuple[Volume, ...]
    periods: tuple[Period, ...]
    """None: it holds at all times."""
    feature: Json

    @property
    def place(self) -> tuple[float, float]:
        """(latitude, longitude) where its daylight is that of."""
        point = shapely.union_all([each.area for each in self.volumes]).centroid
        return point.y, point.x

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        boxes = [each.area.bounds for each in self.volumes]
        return (
            min(box[0] for box in boxes), min(box[1] for box in boxes),
            max(box[2] for box in boxes), max(box[3] for box in boxes),
        )  # fmt: skip


@lru_cache(maxsize=4_096)
def zone_of(feature: str) -> Zone:
    """The zone in a feature's JSON, as the reader of files left it."""
    document = orjson.loads(feature)
    properties = document["properties"]
    return Zone(
        zone_id=f"{properties['country']}:{properties['identifier']}",
        type=properties["type"],
        volumes=tuple(volumes_of(document["geometry"])),
        periods=tuple(map(_period, properties.get("limitedApplicability", ()))),
        feature=document,
    )


def volumes_of(geometry: Json) -> list[Volume]:
    """The volumes of an ED-318 geometry."""
    if geometry["type"] == "GeometryCollection":
        return [volume for part in geometry["geometries"] for volume in volumes_of(part)]
    layer = geometry.get("layer", {})
    unit = FOOT_M if layer.get("uom") == "ft" else 1.0
    lower, upper = (
        Limit(layer[edge] * unit, layer[f"{edge}Reference"]) if edge in layer else None for edge in ("lower", "upper")
    )
    return [Volume(shapely.geometry.shape(plain(geometry)), lower, upper)]


def plain(geometry: Json) -> Json:
    """The geometry in plain GeoJSON: a circle as a polygon that lies just around it."""
    if geometry["type"] == "GeometryCollection":
        return {"type": "GeometryCollection", "geometries": [plain(each) for each in geometry["geometries"]]}
    if geometry["type"] != "Point":
        return {"type": geometry["type"], "coordinates": geometry["coordinates"]}
    lon, lat = geometry["coordinates"]
    # The sides, not the corners, touch the circle: no place inside of it is left out.
    reach = geometry["extent"]["radius"] / cos(pi / CIRCLE_POINTS)
    azimuths = [-360.0 * step / CIRCLE_POINTS for step in range(CIRCLE_POINTS)]
    count = len(azimuths)
    lons, lats, _ = _GEOD.fwd([lon] * count, [lat] * count, azimuths, [reach] * count)
    # Across the 180th meridian the numbers go on, so that the ring stays whole.
    ring = [[lon + (each - lon + 180) % 360 - 180, there] for each, there in zip(lons, lats, strict=True)]
    return {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}


def _period(document: Json) -> Period:
    return Period(
        _ms(document.get("startDateTime")),
        _ms(document.get("endDateTime")),
        tuple(map(_daily, document.get("schedule", ()))),
    )


def _daily(document: Json) -> Daily:
    named = set(document["day"])
    days = _WEEK if "ANY" in named else frozenset(DAYS.index(each) for each in named)
    return Daily(days, _edge(document, "start"), _edge(document, "end"))


def _edge(document: Json, name: str) -> Clock | str | None:
    event: str | None = document.get(f"{name}Event")
    time = document.get(f"{name}Time")
    if time is None:
        return event
    hours, minutes, seconds = (int(time[at : at + 2]) for at in (0, 3, 6))
    zone = time[8:]
    offset = 0 if zone == "Z" else int(zone[0] + "1") * (int(zone[1:3]) * 3600 + int(zone[4:6]) * 60)
    return Clock(hours * 3600 + minutes * 60 + seconds, offset)


def _ms(text: str | None) -> int | None:
    return None if text is None else round(datetime.fromisoformat(text[:19] + _offset(text)).timestamp() * 1000)


def _offset(text: str) -> str:
    """Without the fraction of a second, which no zone needs."""
    return "+00:00" if text[-1] in "Zz" else text[-6:]
