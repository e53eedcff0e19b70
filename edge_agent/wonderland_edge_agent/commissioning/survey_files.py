"""A survey as surveyors deliver it: local coordinates, WGS-84, a map projection, or a total station's own frame.

CSV columns: ``anchor`` and one of ``x, y, z`` (m) or ``lat, lon, height`` (degrees, m above the ellipsoid); optional
``sigma`` (m, of each coordinate) and ``mac`` (short address, hexadecimal). TOML: the same names in ``[[anchors]]``
(``anchor`` or ``anchor_id``), and ``[origin]`` with ``lat``, ``lon``, ``height``.
"""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wonderland.proofs.frame import FIRST, MAX_DIFFERENCE_E7, MAX_HEIGHT_MM, SECOND
from wonderland.proofs.records.pads import Frame
from wonderland_edge_agent.commissioning.errors import SurveyError
from wonderland_edge_agent.commissioning.recording import Point
from wonderland_edge_agent.commissioning.survey import check_anchors
from wonderland_edge_agent.geodesy import GeodesyError, frame_at

DEFAULT_SIGMA_M: Final = 0.010
MAX_SIGMA_M: Final = 1.0
MAX_FILE_BYTES: Final = 1 << 20
MAC_BASE: Final = 0xA000
MAX_MAC: Final = 0xFFFD
MISMATCH_M: Final = 0.05
"""Control points that disagree by more than this are not the points that they are said to be."""


@dataclass(frozen=True)
class Origin:
    """Where a pad's frame stands: degrees, and metres above the ellipsoid."""

    lat: float
    lon: float
    height_m: float

    @property
    def frame(self) -> Frame:
        """The frame. Raises SurveyError."""
        if not (abs(self.lat) <= 90 and abs(self.lon) <= 180 and abs(self.height_m) < 10_000):
            raise SurveyError(
                f"origin {self.lat}, {self.lon}, {self.height_m}: no place on the globe (lat, lon, metres)"
            )
        try:
            return frame_at(round(self.lat * 1e7), round(self.lon * 1e7), round(self.height_m * 1000))
        except GeodesyError as error:
            raise SurveyError(f"origin {self.lat}, {self.lon}: {error}") from error


NOWHERE: Final = Origin(60.45031, 22.27124, 31.0)
"""Where a pad stands whose survey is not tied to the globe: enough for studies, not for a ledger."""


@dataclass(frozen=True)
class SurveyedAnchor:
    """One anchor in the pad's frame; metres."""

    anchor_id: str
    place_m: Point
    sigma_m: float
    mac: int


@dataclass(frozen=True)
class Survey:
    """All anchors, the frame that they stand in (None: not tied to the globe), and what the operator should know."""

    anchors: tuple[SurveyedAnchor, ...]
    frame: Frame | None
    notes: tuple[tuple[str, str], ...] = ()

    @property
    def places_m(self) -> dict[str, Point]:
        """Each anchor's place in metres, by its name."""
        return {anchor.anchor_id: anchor.place_m for anchor in self.anchors}


def load_survey(path: Path, *, origin: Origin | None = None, crs: str = "", control: Path | None = None) -> Survey:
    """Read and check a survey.

    ``crs``: x, y, z are easting, northing, height of this projection (as ``EPSG:3067``), not of the pad's frame.
    ``control``: CSV of points known in both frames (``x, y, z, lat, lon, height``), for coordinates of a total
    station's own frame. Raises SurveyError.
    """
    if crs and control is not None:
        raise SurveyError("--crs and --control exclude each other: are x, y, z of a projection, or a total station's?")
    rows, found = _rows(path)
    origin = origin or found
    sigmas = [_sigma(path, row) for row in rows]
    macs = [_mac(path, row, index) for index, row in enumerate(rows)]
    if len(set(macs)) != len(macs):
        raise SurveyError(f"{path}: two anchors have the same mac")
    geodetic = all(name in rows[0] for name in ("lat", "lon", "height"))
    if geodetic:
        globe = [_numbers(path, row, ("lat", "lon", "height")) for row in rows]
    elif crs:
        globe = [_unprojected(path, crs, _numbers(path, row, ("x", "y", "z"))) for row in rows]
    elif control is not None:
        globe = _tied(control, [_numbers(path, row, ("x", "y", "z")) for row in rows])
    else:
        globe = []
    frame: Frame | None = None
    if globe:
        if origin is None:
            count = len(globe)
            middle = [sum(place[axis] for place in globe) / count for axis in (0, 1)]
            origin = Origin(middle[0], middle[1], min(place[2] for place in globe))
        stands = frame = origin.frame
        places = [local_of(stands, place, str(path)) for place in globe]
    else:
        frame = None if origin is None else origin.frame
        places = [_numbers(path, row, ("x", "y", "z")) for row in rows]
    names = [row["anchor"] for row in rows]
    notes = check_anchors(dict(zip(names, places, strict=True)))
    if any("sigma" not in row or row["sigma"] in {"", None} for row in rows):
        notes.append(
            ("sigma_assumed", f"The survey does not say how good it is; {DEFAULT_SIGMA_M * 1000:.0f} mm are assumed.")
        )
    return Survey(
        tuple(SurveyedAnchor(*row) for row in zip(names, places, sigmas, macs, strict=True)), frame, tuple(notes)
    )


def parse_origin(text: str) -> Origin:
    """``LAT,LON,HEIGHT``. Raises SurveyError."""
    try:
        lat, lon, height = (float(part) for part in text.split(","))
    except ValueError:
        raise SurveyError(f"origin {text!r}: give LAT,LON,HEIGHT in degrees and metres, as 60.45,22.27,31") from None
    if not all(math.isfinite(value) for value in (lat, lon, height)):
        raise SurveyError(f"origin {text!r}: these must be finite numbers")
    return Origin(lat, lon, height)


def _rows(path: Path) -> tuple[list[dict[str, Any]], Origin | None]:
    try:
        data = path.read_bytes()
        if len(data) > MAX_FILE_BYTES:
            raise SurveyError(f"{path}: larger than a list of anchors can be")
        text = data.decode("utf-8-sig")
        if path.suffix.lower() == ".toml":
            document = tomllib.loads(text)
            rows = [dict(row) for row in document.get("anchors", [])]
            place = document.get("origin")
            origin = None if place is None else Origin(*(float(place[name]) for name in ("lat", "lon", "height")))
        else:
            rows, origin = [dict(row) for row in csv.DictReader(text.splitlines())], None
    except (OSError, UnicodeDecodeError, csv.Error, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise SurveyError(f"{path}: no list of anchors ({error})") from error
    seen: set[str] = set()
    for row in rows:
        name = row.get("anchor", row.get("anchor_id"))
        if not isinstance(name, str) or not name:
            raise SurveyError(f"{path}: a row without a name; the column is called anchor")
        if name in seen:
            raise SurveyError(f"{path}: anchor {name!r} is there twice; remove one of them")
        seen.add(name)
        row["anchor"] = name
    if len(rows) < 3:
        raise SurveyError(f"{path}: {len(rows)} anchors; at least 3 are needed")
    return rows, origin


def _numbers(path: Path, row: dict[str, Any], names: Sequence[str]) -> Point:
    values = []
    for name in names:
        try:
            value = float(row[name])
        except (KeyError, TypeError, ValueError):
            raise SurveyError(f"{path}, anchor {row.get('anchor', '?')}: {name} is missing or no number") from None
        if not math.isfinite(value):
            raise SurveyError(f"{path}, anchor {row.get('anchor', '?')}: {name} is {value}")
        values.append(value)
    return (values[0], values[1], values[2])


def _sigma(path: Path, row: dict[str, Any]) -> float:
    text = row.get("sigma")
    if text is None or text == "":
        return DEFAULT_SIGMA_M
    value = _numbers(path, {**row, "one": text}, ("one", "one", "one"))[0]
    if not 0.0 < value <= MAX_SIGMA_M:
        raise SurveyError(f"{path}, anchor {row['anchor']}: sigma {value} m; it is above 0 and at most {MAX_SIGMA_M} m")
    return value


def _mac(path: Path, row: dict[str, Any], index: int) -> int:
    text = row.get("mac")
    if text is None or text == "":
        return MAC_BASE + index
    try:
        value = text if isinstance(text, int) else int(str(text).lower().removeprefix("0x"), 16)
    except ValueError:
        value = -1
    if not 0 < value <= MAX_MAC:
        raise SurveyError(f"{path}, anchor {row['anchor']}: mac {text!r}; give up to four hexadecimal digits, as a001")
    return value


def _unprojected(path: Path, crs: str, place: Point) -> Point:
    """(lat, lon, height) of a projected point."""
    from pyproj import Transformer  # noqa: PLC0415 - 20 MB that only surveys in a projection need
    from pyproj.exceptions import ProjError  # noqa: PLC0415

    try:
        # always_xy: easting and northing in, longitude and latitude out, whatever order the projection's axes have.
        lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(place[0], place[1])
    except ProjError as error:
        raise SurveyError(f"--crs {crs}: no projection that is known here ({error})") from error
    if not (math.isfinite(lat) and math.isfinite(lon)):
        raise SurveyError(f"{path}: {place[0]}, {place[1]} lies outside of {crs}")
    return (float(lat), float(lon), place[2])


def _tied(control: Path, places: Sequence[Point]) -> list[Point]:
    """Points of a total station's frame on the globe: turned about the vertical and moved onto the control points."""
    rows = _control(control)
    middle = [sum(row[1][axis] for row in rows) / len(rows) for axis in range(3)]
    origin = Origin(middle[0], middle[1], middle[2])
    frame = origin.frame
    known = [local_of(frame, row[1], str(control)) for row in rows]
    own = [row[0] for row in rows]
    count = len(rows)
    a = [sum(p[axis] for p in own) / count for axis in range(3)]
    b = [sum(p[axis] for p in known) / count for axis in range(3)]
    cosine = sum((p[0] - a[0]) * (q[0] - b[0]) + (p[1] - a[1]) * (q[1] - b[1]) for p, q in zip(own, known, strict=True))
    sine = sum((p[0] - a[0]) * (q[1] - b[1]) - (p[1] - a[1]) * (q[0] - b[0]) for p, q in zip(own, known, strict=True))
    size = math.hypot(cosine, sine)
    if size <= 0.0:
        raise SurveyError(f"{control}: the control points lie at one place; two apart from each other are needed")
    cosine, sine = cosine / size, sine / size

    def turned(p: Point) -> Point:
        x, y = p[0] - a[0], p[1] - a[1]
        return (b[0] + cosine * x - sine * y, b[1] + sine * x + cosine * y, b[2] + p[2] - a[2])

    off = max(math.dist(turned(p), q) for p, q in zip(own, known, strict=True))
    if off > MISMATCH_M:
        raise SurveyError(
            f"{control}: the control points disagree by {off:.2f} m; are they the same points, and the heights "
            "ellipsoidal in both?"
        )
    return [globe_of(frame, turned(place)) for place in places]


def _control(path: Path) -> list[tuple[Point, Point]]:
    try:
        rows = [dict(row) for row in csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines())]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SurveyError(f"{path}: no control points ({error})") from error
    if len(rows) < 2:
        raise SurveyError(f"{path}: {len(rows)} control points; at least 2 are needed, 3 check each other")
    return [
        (
            _numbers(path, {**row, "anchor": f"row {index + 1}"}, ("x", "y", "z")),
            _numbers(path, {**row, "anchor": f"row {index + 1}"}, ("lat", "lon", "height")),
        )
        for index, row in enumerate(rows)
    ]


def local_of(frame: Frame, place: Point, where: str) -> Point:
    """(lat, lon in degrees, height in m) in a pad's frame (m).

    As ``proofs.frame`` has it, but not rounded to 10⁻⁷ degrees, which are a centimetre. Raises SurveyError.
    """
    d_lat, d_lon, d_up = place[0] * 1e7 - frame.lat_e7, place[1] * 1e7 - frame.lon_e7, place[2] * 1e3 - frame.height_mm
    if abs(d_lat) > MAX_DIFFERENCE_E7 or abs(d_lon) > MAX_DIFFERENCE_E7 or abs(d_up) > MAX_HEIGHT_MM:
        raise SurveyError(f"{where}: {place[0]}, {place[1]} is too far from the pad's origin")
    return _applied(frame, d_lat, d_lon, d_up)


def globe_of(frame: Frame, place: Point) -> Point:
    """The inverse of ``local_of``."""
    d_lat = d_lon = d_up = 0.0
    for _ in range(5):
        east, north, up = _applied(frame, d_lat, d_lon, d_up)
        d_lon += (place[0] - east) * 1e3 * 2.0**FIRST / frame.e1
        d_lat += (place[1] - north) * 1e3 * 2.0**FIRST / frame.n1
        d_up += (place[2] - up) * 1e3
    return ((frame.lat_e7 + d_lat) / 1e7, (frame.lon_e7 + d_lon) / 1e7, (frame.height_mm + d_up) / 1e3)


def _applied(frame: Frame, d_lat: float, d_lon: float, d_up: float) -> Point:
    first, second = 2.0**FIRST, 2.0**SECOND
    east = frame.e1 * d_lon / first + (frame.e2 * d_lat * d_lon + frame.e3 * d_lon * d_up) / second
    north = frame.n1 * d_lat / first
    north += (frame.n2 * d_lat * d_lat + frame.n3 * d_lon * d_lon + frame.n4 * d_lat * d_up) / second
    up = d_up + (frame.u2 * d_lat * d_lat + frame.u3 * d_lon * d_lon) / second
    return (east / 1e3, north / 1e3, up / 1e3)
