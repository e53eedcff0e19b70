"""Data sets of zones in the database: the one that holds for each source, and those before it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any, Final

import orjson
from sqlalchemy import Select, and_, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.areas import E7, Box
from wonderland_backend.db.bulk import append
from wonderland_backend.db.tables.zones import ZoneRow, ZoneSetRow
from wonderland_backend.zones.applicability import Validity
from wonderland_backend.zones.files.common import moment
from wonderland_backend.zones.files.reading import ZoneFile
from wonderland_backend.zones.zone import zone_of

CHUNK: Final = 2_000
Row = dict[str, Any]


def rows_of(file: ZoneFile, import_id: str) -> list[Row]:
    """The rows of a file's zones; long work for large files, without a database."""
    return [_row(orjson.dumps(feature).decode(), import_id) for feature in file.features]


def _row(feature: str, import_id: str) -> Row:
    zone = zone_of.__wrapped__(feature)
    west, south, east, north = zone.bounds
    if west < -180 or east > 180:
        west, east = -180.0, 180.0  # around the 180th meridian: found from either side
    return {
        "import_id": import_id,
        "zone_id": zone.zone_id,
        "type": zone.type,
        "country": zone.feature["properties"]["country"],
        "west": math.floor(west * E7),
        "south": math.floor(max(south, -90.0) * E7),
        "east": math.ceil(east * E7),
        "north": math.ceil(min(north, 90.0) * E7),
        "feature": feature,
    }


def set_row(file: ZoneFile, import_id: str, source: str, who: str, now_ms: int) -> Row:
    """The row of a data set."""
    return {
        "import_id": import_id,
        "source": source,
        "current": source,
        "format": file.format,
        "file_sha256": file.sha256,
        "size_bytes": file.size_bytes,
        "zones": len(file.features),
        "notices": orjson.dumps([asdict(each) for each in file.notices]).decode(),
        "about": orjson.dumps(file.about).decode(),
        "imported_ms": now_ms,
        "imported_by": who,
        "replaced_ms": None,
    }


async def replace(connection: AsyncConnection, data_set: Row, zones: list[Row]) -> None:
    """Put a data set in the place of its source's last, within the caller's transaction."""
    await end(connection, data_set["source"], data_set["imported_ms"])
    await append(connection, ZoneSetRow, [data_set])
    for start in range(0, len(zones), CHUNK):
        await append(connection, ZoneRow, zones[start : start + CHUNK])


async def end(connection: AsyncConnection, source: str, now_ms: int) -> None:
    """A source's data set holds no longer, within the caller's transaction."""
    holds = update(ZoneSetRow).where(ZoneSetRow.current == source)
    await connection.execute(holds.values(current=None, replaced_ms=now_ms))


async def current(database: AsyncSession, source: str) -> ZoneSetRow | None:
    """The data set of a source that holds."""
    found: ZoneSetRow | None = await database.scalar(select(ZoneSetRow).where(ZoneSetRow.current == source))
    return found


async def features_of(database: AsyncSession, import_id: str) -> dict[str, str]:
    """The features of a data set by zone."""
    rows = await database.execute(select(ZoneRow.zone_id, ZoneRow.feature).where(ZoneRow.import_id == import_id))
    return {row.zone_id: row.feature for row in rows}


async def elsewhere(database: AsyncSession, source: str, zone_ids: Iterable[str]) -> dict[str, str]:
    """Which of these zones another source's data set has already, and whose that is."""
    query = (
        select(ZoneRow.zone_id, ZoneSetRow.source)
        .join(ZoneSetRow, ZoneSetRow.import_id == ZoneRow.import_id)
        .where(ZoneSetRow.current.is_not(None), ZoneSetRow.current != source)
    )
    held = {row.zone_id: row.source for row in await database.execute(query)}
    return {zone_id: held[zone_id] for zone_id in zone_ids if zone_id in held}


def holding(at_ms: int | None = None) -> Select[ZoneRow, ZoneSetRow]:
    """The zones of the data sets that hold, or that held at a time of the past, by zone."""
    replaced = ZoneSetRow.replaced_ms
    return (
        select(ZoneRow, ZoneSetRow)
        .join(ZoneSetRow, ZoneSetRow.import_id == ZoneRow.import_id)
        .where(
            ZoneSetRow.current.is_not(None)
            if at_ms is None
            else and_(ZoneSetRow.imported_ms <= at_ms, or_(replaced.is_(None), replaced > at_ms))
        )
        .order_by(ZoneRow.zone_id)
    )


def within(query: Select[ZoneRow, ZoneSetRow], box: Box) -> Select[ZoneRow, ZoneSetRow]:
    """Only those whose box meets this one."""
    beside = (
        and_(ZoneRow.west <= box.east, ZoneRow.east >= box.west)
        if box.west <= box.east
        else or_(ZoneRow.east >= box.west, ZoneRow.west <= box.east)
    )
    return query.where(ZoneRow.south <= box.north, ZoneRow.north >= box.south, beside)


def around(lat: float, lon: float, reach_m: float) -> Box:
    """A box that holds every place within reach of one."""
    north = reach_m / 110_000
    east = min(180.0, north / max(math.cos(math.radians(min(abs(lat) + north, 89.9))), 1e-3))
    west_end, east_end = lon - east, lon + east
    if east >= 180:
        west_end, east_end = -180.0, 180.0
    elif west_end < -180:
        west_end += 360
    elif east_end > 180:
        east_end -= 360
    degrees = (west_end, max(lat - north, -90.0), east_end, min(lat + north, 90.0))
    return Box(*(round(each * E7) for each in degrees))


def validity(about: str) -> Validity:
    """From when until when a data set says that it is good (Unix, ms)."""
    metadata = orjson.loads(about).get("metadata", {})
    start, end = (
        round(moment(metadata[name]).timestamp() * 1000) if name in metadata else None
        for name in ("validFrom", "validTo")
    )
    return start, end


async def data_sets(database: AsyncSession) -> Sequence[ZoneSetRow]:
    """Those that hold, by source."""
    query = select(ZoneSetRow).where(ZoneSetRow.current.is_not(None)).order_by(ZoneSetRow.source)
    return (await database.scalars(query)).all()
