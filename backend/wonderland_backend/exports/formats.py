"""The files of an export, as pieces of text: GeoJSON (RFC 7946), CSV (RFC 4180), Moving Features JSON (19-045r3)."""

from __future__ import annotations

import csv
import io
from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import orjson

from wonderland_backend.exports.queries import ESTIMATE_FIELDS, TRACK_FIELDS, VERDICT_FIELDS, Record, Rows

CLAIMED: Final = "claimed"
ESTIMATE: Final = "estimate"
VERDICT: Final = "verdict"
KINDS: Final = (CLAIMED, ESTIMATE, VERDICT)
_CRS: Final = {"type": "Name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
_TRS: Final = {
    "type": "Link",
    "properties": {"type": "OGCDEF", "href": "http://www.opengis.net/def/uom/ISO-8601/0/Gregorian"},
}
_MEASURES: Final = {
    "height_mm": "http://qudt.org/vocab/unit/MilliM",
    "accuracy_mm": "http://qudt.org/vocab/unit/MilliM",
    "speed_mm_s": "http://qudt.org/vocab/unit/MilliM-PER-SEC",
    "likelihood_ppm": "http://qudt.org/vocab/unit/PPM",
}
"""What of a moving drone changes with time, and its unit."""


@dataclass
class Counts:
    """How many rows of each kind were written, and how many moments a format could not tell twice."""

    of: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))
    same_moment: int = 0

    @property
    def rows(self) -> int:
        """Rows of all kinds together."""
        return sum(self.of.values())


@dataclass(frozen=True)
class File:
    """A file to be, its content in pieces."""

    name: str
    content: AsyncIterator[str]


Format = Callable[[Rows, Counts], list[File]]


def geojson(rows: Rows, counts: Counts) -> list[File]:
    """One feature collection; `kind` of a feature says whose word it is."""
    return [File("window.geojson", _geojson(rows, counts))]


def csv_tables(rows: Rows, counts: Counts) -> list[File]:
    """A table for each kind. Coordinates are degrees × 10⁷, lengths millimetres, times Unix milliseconds."""
    return [
        File(f"{kind}.csv", _csv(names, kind, pages, counts))
        for kind, names, pages in (
            (CLAIMED, (*TRACK_FIELDS, "received_ms"), _claimed(rows)),
            (ESTIMATE, (*ESTIMATE_FIELDS, "received_ms"), rows.estimates()),
            (VERDICT, VERDICT_FIELDS, rows.verdicts()),
        )
    ]


def moving_features(rows: Rows, counts: Counts) -> list[File]:
    """Each drone as a moving point by its claims, each session by its estimates, each verdict as a moment."""
    return [File("window.mf.json", _moving(rows, counts))]


FORMATS: Final[dict[str, Format]] = {"geojson": geojson, "csv": csv_tables, "mfjson": moving_features}


async def _claimed(rows: Rows) -> AsyncIterator[list[Record]]:
    async for uav_id in rows.drones():
        async for page in rows.positions(uav_id):
            yield page


async def _geojson(rows: Rows, counts: Counts) -> AsyncIterator[str]:
    yield '{"type":"FeatureCollection","features":['
    between = "\n"
    for kind, pages in ((CLAIMED, _claimed(rows)), (ESTIMATE, rows.estimates()), (VERDICT, rows.verdicts())):
        async for page in pages:
            counts.of[kind] += len(page)
            yield between + ",\n".join(_dumps(_feature(kind, each)) for each in page)
            between = ",\n"
    yield "\n]}\n"


def _feature(kind: str, record: Record) -> Record:
    place = None
    if "lat_e7" in record:
        place = {"type": "Point", "coordinates": _coordinates(record)}
    properties = {name: value for name, value in record.items() if name not in {"lat_e7", "lon_e7"}}
    return {
        "type": "Feature",
        "geometry": place,
        "properties": {"kind": kind, "verified": _verified(record), "time": _iso(record["t_ms"]), **properties},
    }


async def _csv(
    names: tuple[str, ...], kind: str, pages: AsyncIterator[list[Record]], counts: Counts
) -> AsyncIterator[str]:
    yield _table([names])
    async for page in pages:
        counts.of[kind] += len(page)
        yield _table([_cell(record.get(name)) for name in names] for record in page)


def _table(lines: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text).writerows(lines)
    return text.getvalue()


def _cell(value: Any) -> Any:
    """A text that a spreadsheet would take for a formula is one no longer; yes and no as JSON writes them."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str) and value[:1] in {"=", "+", "-", "@", "\t", "\r"}:
        return f"'{value}"
    return "" if value is None else value


async def _moving(rows: Rows, counts: Counts) -> AsyncIterator[str]:
    yield f'{{"type":"FeatureCollection","crs":{_dumps(_CRS)},"trs":{_dumps(_TRS)},"features":['
    between = "\n"
    async for uav_id in rows.drones():
        begun = False
        last_ms = -1
        async for page in rows.positions(uav_id):
            counts.of[CLAIMED] += len(page)
            moments = _moments(page, last_ms, counts)
            if not moments:
                continue
            last_ms = moments[-1]["t_ms"]
            if not begun:
                properties = {"kind": CLAIMED, "uav_id": uav_id, "verified": False}
                head = f'{{"type":"Feature","id":{_dumps(uav_id)},"properties":{_dumps(properties)}'
                yield f'{between}{head},"temporalGeometry":{{"type":"MovingGeometryCollection","prisms":['
                begun, between = True, ",\n"
            else:
                yield ","
            yield _dumps(_point(moments))
        if begun:
            yield "]}}"
    async for page in rows.estimates():
        counts.of[ESTIMATE] += len(page)
        moments = _moments(page, -1, counts)
        yield between + _dumps(_whole(ESTIMATE, moments, moments[0]["session_id"]))
        between = ",\n"
    async for page in rows.verdicts():
        counts.of[VERDICT] += len(page)
        for record in page:
            if "lat_e7" in record:
                yield between + _dumps(_whole(VERDICT, [record], f"{record['session_id']}/verdict"))
                between = ",\n"
    yield "\n]}\n"


def _moments(page: list[Record], after_ms: int, counts: Counts) -> list[Record]:
    """Records at rising times: at one moment a point is at one place, the first that was told."""
    found: list[Record] = []
    for record in page:
        if record["t_ms"] > after_ms:
            after_ms = record["t_ms"]
            found.append(record)
        else:
            counts.same_moment += 1
    return found


def _point(moments: list[Record]) -> Record:
    return {
        "type": "MovingPoint",
        "datetimes": [_iso(record["t_ms"]) for record in moments],
        "coordinates": [_coordinates(record) for record in moments],
        "interpolation": "Discrete",
    }


def _whole(kind: str, moments: list[Record], identifier: str) -> Record:
    """A feature whose moments are all here, with what changed besides its place."""
    first = moments[0]
    same = {
        name: value
        for name, value in first.items()
        if name not in {"lat_e7", "lon_e7", "t_ms", "received_ms"} and all(each.get(name) == value for each in moments)
    }
    feature: Record = {
        "type": "Feature",
        "id": identifier,
        "properties": {"kind": kind, "verified": _verified(first), **same},
        "temporalGeometry": _point(moments),
    }
    changing = []
    for name, unit in _MEASURES.items():
        told = [each for each in moments if name in each]
        if told and name not in same:
            values = [each[name] for each in told]
            measure = {"type": "Measure", "form": unit, "values": values, "interpolation": "Discrete"}
            changing.append({"datetimes": [_iso(each["t_ms"]) for each in told], name: measure})
    if changing:
        feature["temporalProperties"] = changing
    return feature


def _verified(record: Record) -> bool:
    """Whether the ledger says that the drone is where it says: never so of a refutation."""
    return bool(record.get("outcome") == "verified")


def _coordinates(record: Record) -> list[float]:
    return [record["lon_e7"] / 1e7, record["lat_e7"] / 1e7]


def _iso(t_ms: int) -> str:
    return datetime.fromtimestamp(t_ms / 1000, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _dumps(content: Any) -> str:
    return orjson.dumps(content).decode()
