"""Site plans: what stands and is marked around a landing pad, as its operator drew it.

A plan is one file, a GeoJSON FeatureCollection whose coordinates are metres east and north of the pad's origin
(``"frame": "pad"``), or an image with its corners there, or both. Its SHA-256 goes on the ledger, so that a session of
years ago is shown on the plan that held then. ``parse`` says all that is wrong with a plan; nothing is mended silently,
since the hash is that of the file as it was given.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NoReturn

from wonderland.site_plans.geometry import Ring, area, crossing, within
from wonderland.site_plans.images import image_size

MAX_BYTES: Final = 3 << 20
MAX_FEATURES: Final = 500
MAX_POINTS: Final = 5_000
MAX_RING: Final = 250
"""Points of one ring or line: each edge is compared with each other one."""
MAX_OFF_M: Final = 1_000.0
MAX_SECTOR_M: Final = 5_000.0
MAX_HEIGHT_M: Final = 500.0
MAX_NAME: Final = 80
MAX_IMAGE_BYTES: Final = 2 << 20
MAX_IMAGE_SIDE: Final = 4_096
MAX_PROBLEMS: Final = 20
LEAST_AREA_M2: Final = 0.01
_AREA: Final = ("Polygon",)
KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    "surface": _AREA,
    "fato": _AREA,
    "tlof": _AREA,
    "safety_area": _AREA,
    "approach_sector": _AREA,
    "departure_sector": _AREA,
    "obstacle": ("Point", "Polygon"),
    "fence": ("LineString",),
    "charger": ("Point", "Polygon"),
    "marking": ("Point", "LineString", "Polygon"),
}
"""What can be drawn, and as which geometries."""
_SECTORS: Final = frozenset({"approach_sector", "departure_sector"})
_UNSEEN: Final = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode's categories of what is not seen, or turns the direction of what is."""


@dataclass(frozen=True)
class Problem:
    """What is wrong, where in the file, and what to do."""

    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}" if self.where else self.what


class SitePlanError(Exception):
    """A file that is no site plan; ``problems`` are all that were found, ``MAX_PROBLEMS`` at most."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("; ".join(map(str, problems)))
        self.problems = tuple(problems)


@dataclass(frozen=True)
class Feature:
    """One thing of a plan. ``rings``: of a polygon its rings, of a line its points, of a point itself; metres."""

    kind: str
    name: str
    geometry: str
    rings: tuple[Ring, ...]
    height_m: float | None


@dataclass(frozen=True)
class Image:
    """An image of the site: its bytes, and where its corners lie (upper left, then clockwise), metres."""

    media_type: str
    data: bytes
    corners: Ring


@dataclass(frozen=True)
class SitePlan:
    """A plan that was checked."""

    features: tuple[Feature, ...]
    image: Image | None


def parse(body: bytes) -> SitePlan:
    """Check a plan. Raises SitePlanError, which names everything that is wrong."""
    if len(body) > MAX_BYTES:
        size_kb = -(-len(body) // 1000)
        _fail("", f"the file has {size_kb} kB, more than {MAX_BYTES // 1000}: leave out what a visitor need not see")
    document = _read(body)
    if document.get("type") != "FeatureCollection":
        _fail("type", 'must be "FeatureCollection"; a GeoJSON file of features is wanted')
    if document.get("frame") != "pad":
        _fail(
            "frame",
            'must be "pad": coordinates are metres east and north of the pad\'s origin, not degrees. Subtract the '
            "origin, and multiply by 111,320 m per degree (east: by the cosine of the latitude as well)",
        )
    found = _Found()
    features = found.features(document.get("features"))
    image = found.image(document["image"]) if document.get("image") is not None else None
    found.together(features)
    if not features and image is None and not found.problems:
        found.add("features", "the plan is empty: draw at least the surface, or give an image")
    if found.problems:
        raise SitePlanError(found.problems[:MAX_PROBLEMS])
    return SitePlan(features, image)


def _fail(where: str, what: str) -> NoReturn:
    raise SitePlanError([Problem(where, what)])


def _read(body: bytes) -> dict[str, Any]:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(pairs)
        if len(result) != len(pairs):
            raise ValueError("a name stands twice in one object")
        return result

    def constant(name: str) -> NoReturn:
        raise ValueError(f"{name} is no JSON number")

    try:
        document = json.loads(body.decode(), object_pairs_hook=once, parse_constant=constant)
    except RecursionError:
        _fail("", "it is nested too deeply")
    except ValueError as error:
        _fail("", f"it is no JSON: {error}")
    if not isinstance(document, dict):
        _fail("", "it is no GeoJSON object")
    return document


class _Found:
    """What is found in one plan: its parts, and what is wrong with them."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self._points = 0

    def add(self, where: str, what: str) -> None:
        self.problems.append(Problem(where, what))

    def features(self, given: Any) -> tuple[Feature, ...]:
        if not isinstance(given, list):
            self.add("features", "must be a list")
            return ()
        if len(given) > MAX_FEATURES:
            self.add("features", f"there are {len(given)}, more than {MAX_FEATURES}")
            return ()
        features = []
        for index, each in enumerate(given):
            if len(self.problems) >= MAX_PROBLEMS:
                break
            feature = self._feature(f"features[{index}]", each)
            if feature is not None:
                features.append(feature)
        return tuple(features)

    def _feature(self, where: str, given: Any) -> Feature | None:
        properties = given.get("properties") if isinstance(given, dict) else None
        geometry = given.get("geometry") if isinstance(given, dict) else None
        if not isinstance(properties, dict) or not isinstance(geometry, dict):
            self.add(where, "must be a Feature with properties and a geometry")
            return None
        before = len(self.problems)
        kind = properties.get("kind")
        if not isinstance(kind, str) or kind not in KINDS:
            self.add(f"{where}.properties.kind", f"must be one of {', '.join(KINDS)}")
            return None
        shape = geometry.get("type")
        if not isinstance(shape, str) or shape not in KINDS[kind]:
            self.add(f"{where}.geometry.type", f"of {kind} must be {' or '.join(KINDS[kind])}")
            return None
        name = self._name(f"{where}.properties.name", properties.get("name"))
        height_m = self._height(f"{where}.properties.height_m", kind, properties.get("height_m"))
        rings = self._rings(f"{where}.geometry.coordinates", kind, shape, geometry.get("coordinates"))
        if len(self.problems) > before:
            return None
        return Feature(kind, name, shape, rings, height_m)

    def _name(self, where: str, given: Any) -> str:
        if given is None:
            return ""
        if not isinstance(given, str) or len(given) > MAX_NAME:
            self.add(where, f"must be a text of at most {MAX_NAME} characters")
            return ""
        if any(unicodedata.category(each) in _UNSEEN for each in given):
            self.add(where, "has characters that cannot be seen, or that turn the direction of others; type it anew")
        return given

    def _height(self, where: str, kind: str, given: Any) -> float | None:
        if given is None:
            if kind == "obstacle":
                self.add(where, "is missing: an obstacle has a height above the pad, metres")
            return None
        height_m = _number(given)
        if height_m is None or not 0 < height_m <= MAX_HEIGHT_M:
            self.add(where, f"must be metres above the pad, more than 0 and at most {MAX_HEIGHT_M:g}")
        return height_m

    def _rings(self, where: str, kind: str, shape: str, given: Any) -> tuple[Ring, ...]:
        most_m = MAX_SECTOR_M if kind in _SECTORS else MAX_OFF_M
        if shape == "Point":
            return (self._points_of(where, [given], most_m),)
        if shape == "LineString":
            line = self._points_of(where, given, most_m)
            if len(line) < 2:
                self.add(where, "a line has two points or more")
            return (line,)
        if not isinstance(given, list) or not given:
            self.add(where, "must be a list of rings")
            return ()
        rings = []
        for index, each in enumerate(given):
            at = f"{where}[{index}]"
            ring = self._points_of(at, each, most_m)
            if ring:
                self._ring(at, ring)
                rings.append(ring)
        return tuple(rings)

    def _ring(self, where: str, ring: Ring) -> None:
        if len(ring) < 4 or ring[0] != ring[-1]:
            self.add(where, "a ring has at least four points, and its last is its first")
        elif (met := crossing(ring)) is not None:
            first, second = met
            self.add(where, f"the ring crosses itself: its edges {first} and {second} meet; draw it in order")
        elif abs(area(ring)) < LEAST_AREA_M2:
            self.add(where, "the ring encloses nothing")

    def _points_of(self, where: str, given: Any, most_m: float) -> Ring:
        if not isinstance(given, list):
            self.add(where, "must be a list of points")
            return ()
        self._points += len(given)
        if len(given) > MAX_RING or self._points > MAX_POINTS:
            self.add(where, f"too many points: {MAX_RING} for each ring or line, {MAX_POINTS} in all; simplify it")
            return ()
        points = []
        for index, each in enumerate(given):
            pair = [_number(value) for value in each] if isinstance(each, list) and len(each) == 2 else [None]
            if None in pair:
                self.add(f"{where}[{index}]", "must be two numbers: metres east, metres north")
                return ()
            east_m, north_m = (float(value or 0.0) for value in pair)
            if max(abs(east_m), abs(north_m)) > most_m:
                far = math.hypot(east_m, north_m) / 1000
                self.add(f"{where}[{index}]", f"lies {far:.1f} km from the pad; at most {most_m / 1000:g} km is drawn")
                return ()
            points.append((east_m, north_m))
        return tuple(points)

    def together(self, features: Sequence[Feature]) -> None:
        """What concerns two features: where there is a FATO, each TLOF lies within one."""
        fatos = [each.rings[0] for each in features if each.kind == "fato"]
        for index, each in enumerate(features):
            if each.kind == "tlof" and fatos and not any(within(each.rings[0], fato) for fato in fatos):
                self.add(f"features[{index}]", "the TLOF lies outside the FATO; it must be within")

    def image(self, given: Any) -> Image | None:
        """The image of a plan: base64 of a PNG or JPEG, and its four corners."""
        if not isinstance(given, dict):
            self.add("image", "must be an object with data and corners")
            return None
        before = len(self.problems)
        corners = self._points_of("image.corners", given.get("corners"), MAX_OFF_M)
        if len(self.problems) == before:
            if len(corners) != 4:
                self.add("image.corners", "must be four points: upper left, upper right, lower right, lower left")
            else:
                self._ring("image.corners", (*corners, corners[0]))
        data = given.get("data")
        try:
            raw = base64.b64decode(data, validate=True) if isinstance(data, str) else b""
        except (binascii.Error, ValueError):
            raw = b""
        if not raw or len(raw) > MAX_IMAGE_BYTES:
            self.add("image.data", f"must be base64 of a PNG or JPEG of at most {MAX_IMAGE_BYTES >> 20} MiB")
            return None
        media_type, width, height = image_size(raw)
        if not media_type:
            self.add("image.data", "is neither PNG nor JPEG")
        elif not (0 < width <= MAX_IMAGE_SIDE and 0 < height <= MAX_IMAGE_SIDE):
            self.add("image.data", f"has {width} × {height} pixels; at most {MAX_IMAGE_SIDE} on a side")
        return None if len(self.problems) > before else Image(media_type, raw, corners)


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None
