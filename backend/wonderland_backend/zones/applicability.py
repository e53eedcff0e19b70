"""When a zone holds: periods, weekly schedules and daylight, written out as spans of time (Unix, ms).

A time of a schedule has its own offset from UTC, and its day of the week is the one there. Daylight is that of the
zone's middle: BMCT and EECT are the sun's centre 6° below the horizon, SR and SS its upper limb on it. A span that
ends at or before its start goes over midnight. Where the sun does not set, daylight lasts the whole day; where it does
not rise, there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime, timedelta, timezone
from functools import lru_cache
from typing import Final

from astral import Observer
from astral.sun import dawn, dusk, elevation, sunrise, sunset

from wonderland_backend.zones.zone import Clock, Daily, Period, Zone

Span = tuple[int, int]
Validity = tuple[int | None, int | None]
"""Of a data set: from and until (Unix, ms); None: open."""
DAY_MS: Final = 86_400_000
MAX_DAYS: Final = 400
CIVIL_DEG: Final = 6.0
HORIZON_DEG: Final = -0.833
"""Of the sun's centre when its upper limb is on the horizon, refraction included."""
_MORNING: Final = frozenset({"BMCT", "SR"})


def spans(zone: Zone, from_ms: int, until_ms: int, validity: Validity = (None, None)) -> list[Span]:
    """The spans within [from, until) in which a zone holds, in order, without gaps that are none.

    ``validity``: of its data set. The span asked about is at most `MAX_DAYS` long.
    """
    assert until_ms - from_ms <= MAX_DAYS * DAY_MS
    first, last = validity
    from_ms = from_ms if first is None else max(from_ms, first)
    until_ms = until_ms if last is None else min(until_ms, last)
    if from_ms >= until_ms:
        return []
    if not zone.periods:
        return [(from_ms, until_ms)]
    return merged(span for period in zone.periods for span in _of_period(period, zone, from_ms, until_ms))


def merged(found: Iterable[Span]) -> list[Span]:
    """The same times as spans that do not touch each other."""
    result: list[Span] = []
    for start, end in sorted(found):
        if result and start <= result[-1][1]:
            result[-1] = (result[-1][0], max(result[-1][1], end))
        else:
            result.append((start, end))
    return result


def _of_period(period: Period, zone: Zone, from_ms: int, until_ms: int) -> Iterator[Span]:
    from_ms = from_ms if period.start_ms is None else max(from_ms, period.start_ms)
    until_ms = until_ms if period.end_ms is None else min(until_ms, period.end_ms)
    if from_ms >= until_ms:
        return
    if not period.daily:
        yield from_ms, until_ms
        return
    place = zone.place
    # A span may begin the day before at any offset, and its day may be the next one there.
    day = datetime.fromtimestamp(from_ms / 1000, UTC).date() - timedelta(days=3)
    last = datetime.fromtimestamp(until_ms / 1000, UTC).date() + timedelta(days=2)
    while day <= last:
        for daily in period.daily:
            if day.weekday() in daily.days:
                start, end = _on(daily, day, place)
                start, end = max(start, from_ms), min(end, until_ms)
                if start < end:
                    yield start, end
        day += timedelta(days=1)


def _on(daily: Daily, day: date, place: tuple[float, float]) -> Span:
    """The span of one day; it may be empty."""
    beside = daily.end if daily.start is None else daily.start
    start = _instant(daily.start, day, place, beside, whole=0)
    end = _instant(daily.end, day, place, beside, whole=1)
    if isinstance(daily.start, str) and isinstance(daily.end, str):
        night = daily.start not in _MORNING and daily.end in _MORNING
        over = night or (end < start)
    else:
        over = end <= start
    if over:
        end = _instant(daily.end, day + timedelta(days=1), place, beside, whole=1)
    return start, end


def _instant(
    edge: Clock | str | None, day: date, place: tuple[float, float], beside: Clock | str | None, *, whole: int
) -> int:
    """When an edge is on a day. One that is not given is the day's midnight where the other edge is told."""
    if isinstance(edge, str):
        return _event(edge, day, *place)
    if isinstance(edge, Clock):
        return _midnight(day, edge.offset_s) + edge.seconds * 1000
    offset_s = beside.offset_s if isinstance(beside, Clock) else _solar_s(place[1]) if beside is not None else 0
    return _midnight(day + timedelta(days=whole), offset_s)


def _midnight(day: date, offset_s: int) -> int:
    return (day - date(1970, 1, 1)).days * DAY_MS - offset_s * 1000


def _solar_s(lon: float) -> int:
    """Mean solar time's offset from UTC, in whole minutes."""
    return round(lon * 4) * 60


@lru_cache(maxsize=65_536)
def _event(name: str, day: date, lat: float, lon: float) -> int:
    """An event of daylight on a day by the sun."""
    offset_s = _solar_s(lon)
    observer, there = Observer(lat, lon), timezone(timedelta(seconds=offset_s))
    try:
        match name:
            case "BMCT":
                found = dawn(observer, day, CIVIL_DEG, there)
            case "EECT":
                found = dusk(observer, day, CIVIL_DEG, there)
            case "SR":
                found = sunrise(observer, day, there)
            case _:
                found = sunset(observer, day, there)
        return round(found.timestamp() * 1000)
    except ValueError:  # the sun does not come to that height on this day
        pass
    noon = datetime(day.year, day.month, day.day, 12, tzinfo=there)
    limit = -CIVIL_DEG if name in {"BMCT", "EECT"} else HORIZON_DEG
    if elevation(observer, noon) <= limit:
        return _midnight(day, offset_s) + DAY_MS // 2  # no daylight: from noon to noon is none
    return _midnight(day if name in _MORNING else day + timedelta(days=1), offset_s)
