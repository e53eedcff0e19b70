"""Pads and the zones that reach them: what the ledger knows of it, and what it should be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import orjson
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.messages import Language
from wonderland.proofs.records.closures import Closure
from wonderland_backend.db.tables.ledger import ClosuresRow, PadRow
from wonderland_backend.errors import Unprocessable
from wonderland_backend.person import Scope
from wonderland_backend.zones import closing, queries, store
from wonderland_backend.zones.closing import PadPlace, Plan, TooManyClosuresError, Touch
from wonderland_backend.zones.shown import active, in_language, spans_ahead
from wonderland_backend.zones.zone import zone_of

DAYS: Final = 14
ENDING_MS: Final = 3 * 86_400_000


@dataclass(frozen=True)
class PadZones:
    """A pad, what touches it, and what the ledger has."""

    pad: PadRow
    place: PadPlace
    touches: Sequence[tuple[Touch, Any]]
    """With the data set that each is of."""
    published: ClosuresRow | None


async def listing(database: AsyncSession, scope: Scope, *, after: str | None, limit: int) -> list[PadZones]:
    """Pads in service with their zones, by name."""
    rows = (await database.execute(scope.narrow(queries.in_service(after, limit), pad=PadRow.pad_id))).all()
    return [await zones_of(database, row[0], row[1]) for row in rows]


async def find_pad_zones(database: AsyncSession, scope: Scope, pad_id: str) -> PadZones | None:
    """One pad in service with its zones."""
    query = scope.narrow(queries.in_service(None, 1).where(PadRow.pad_id == pad_id), pad=PadRow.pad_id)
    row = (await database.execute(query)).first()
    return None if row is None else await zones_of(database, row[0], row[1])


async def zones_of(database: AsyncSession, pad: PadRow, published: ClosuresRow | None) -> PadZones:
    """The zones within a pad's reach."""
    place = PadPlace.of(orjson.loads(pad.record))
    box = store.around(place.lat, place.lon, place.reach_m)
    rows = (await database.execute(store.within(store.holding(), box))).all()
    sets = {row[0].zone_id: row[1] for row in rows}
    touches = closing.touching(place, ((zone_of(row[0].feature), store.validity(row[1].about)) for row in rows))
    return PadZones(pad, place, [(touch, sets[touch.zone.zone_id]) for touch in touches], published)


def planned(its: PadZones, now_ms: int, days: int = DAYS) -> Plan:
    """What should be published. Raises `Unprocessable`."""
    try:
        return closing.plan((touch for touch, _ in its.touches), now_ms, days)
    except TooManyClosuresError as error:
        raise Unprocessable(error.said) from None


def state_of(its: PadZones, now_ms: int) -> str:
    """How what the ledger has compares with today's zones; see `PadClosures.state`."""
    if its.published is None:
        return "missing" if any(touch.closes for touch, _ in its.touches) else "open"
    until = its.published.valid_until_ms
    if until <= now_ms:
        return "outdated"
    due = planned(its, now_ms)
    published = [Closure.parse(each) for each in orjson.loads(its.published.record)["closures"]]
    if not closing.same(published, due.closures, now_ms, min(until, due.valid_until_ms)):
        return "differs"
    return "ending" if until - now_ms < ENDING_MS else "current"


def pad_closures_json(its: PadZones, language: Language, now_ms: int) -> dict[str, Any]:
    """The PadClosures of the API: zones that reach the pad, and what is published of them."""
    content: dict[str, Any] = {
        "pad_id": its.pad.pad_id,
        "name": orjson.loads(its.pad.record)["name"],
        "reach_m": its.place.reach_m,
        "zones": [_touching(touch, data_set, language, now_ms) for touch, data_set in its.touches],
        "state": state_of(its, now_ms),
    }
    if its.published is not None:
        record = orjson.loads(its.published.record)
        names = ("closures", "valid_until_ms", "set_by", "set_ms")
        place = {"block": its.published.block, "tx_index": its.published.tx_index}
        content["published"] = {name: record[name] for name in names} | place
    return content


def _touching(touch: Touch, data_set: Any, language: Language, now_ms: int) -> dict[str, Any]:
    zone = touch.zone
    content = {
        "zone_id": zone.zone_id,
        "type": zone.type,
        "name": in_language(zone.feature["properties"].get("name", []), language),
        "distance_m": round(touch.distance_m, 1),
        "reaches": touch.heights,
        "closes": touch.closes,
        **active(spans_ahead(zone, data_set, now_ms), now_ms),
    }
    return {name: value for name, value in content.items() if value is not None}
