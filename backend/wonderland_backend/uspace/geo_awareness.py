"""Which zones a test of InterUSS asks for (`geo-awareness`): filters by place, time, restriction and U-space class."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Final, Literal

import shapely
from pydantic import AfterValidator, Field

from wonderland_backend.http.times import unix_ms
from wonderland_backend.uspace.dss.models import Foreign
from wonderland_backend.zones.applicability import DAY_MS, MAX_DAYS, Validity, spans
from wonderland_backend.zones.files.ed269 import FOOT_M, RESTRICTIONS, USPACE_CLASS
from wonderland_backend.zones.heights import Band, reaches
from wonderland_backend.zones.shown import Row
from wonderland_backend.zones.store import validity
from wonderland_backend.zones.zone import Zone, zone_of

MAX_CHECKS: Final = 200
MAX_FILTERS: Final = 50


def _time(text: str) -> str:
    unix_ms(text)
    return text


Time = Annotated[str, Field(max_length=64), AfterValidator(_time)]


class HttpsSource(Foreign):
    """`GeozoneHttpsSource`."""

    url: Annotated[str, Field(min_length=1, max_length=500)]
    format: str = "ED-269"


class SourceRequest(Foreign):
    """`CreateGeozoneSourceRequest`."""

    https_source: HttpsSource | None = None


class Position(Foreign):
    """`Position`."""

    uomDimensions: Literal["M", "FT"]  # noqa: N815 - the standard's names
    verticalReferenceType: Literal["AGL", "AMSL"]  # noqa: N815
    height: Annotated[float, Field(ge=-100_000, le=400_000)] = 0
    longitude: Annotated[float, Field(ge=-180, le=180)] = 0
    latitude: Annotated[float, Field(ge=-90, le=90)] = 0

    def band(self) -> Band:
        """Its height, as a band of heights that is one."""
        height_m = self.height * (FOOT_M if self.uomDimensions == "FT" else 1.0)
        return Band(height_m, height_m, self.verticalReferenceType)


class Ed269Filters(Foreign):
    """`ED269Filters`."""

    uSpaceClass: Annotated[str, Field(max_length=100)] | None = None  # noqa: N815
    acceptableRestrictions: tuple[  # noqa: N815
        Literal["PROHIBITED", "REQ_AUTHORISATION", "CONDITIONAL", "NO_RESTRICTION"], ...
    ] = ()


class FilterSet(Foreign):
    """`GeozonesFilterSet`: a zone has to pass all of it."""

    position: Position | None = None
    after: Time | None = None
    before: Time | None = None
    ed269: Ed269Filters = Ed269Filters()


class Check(Foreign):
    """`GeozonesCheck`: a zone has to pass one of the sets."""

    filterSets: Annotated[list[FilterSet], Field(max_length=MAX_FILTERS)]  # noqa: N815


class CheckRequest(Foreign):
    """`GeozonesCheckRequest`."""

    checks: Annotated[list[Check], Field(max_length=MAX_CHECKS)]


def answer(check: Check, rows: Iterable[Row]) -> dict[str, Any]:
    """`GeozonesCheckResult`: whether there is a zone among these. Where heights leave it open, there is one."""
    for wanted in check.filterSets:
        if wanted.after is not None and wanted.before is not None and unix_ms(wanted.after) > unix_ms(wanted.before):
            return {"geozone": "Error", "message": "`after` is a time after `before`."}
    found = any(
        _passes(zone_of(zone.feature), validity(data_set.about), wanted)
        for zone, data_set in rows
        for wanted in check.filterSets
    )
    return {"geozone": "Present" if found else "Absent"}


def _passes(zone: Zone, good: Validity, wanted: FilterSet) -> bool:
    named = wanted.ed269
    if named.acceptableRestrictions and zone.type not in {RESTRICTIONS[each] for each in named.acceptableRestrictions}:
        return False
    if named.uSpaceClass is not None and named.uSpaceClass not in _classes(zone):
        return False
    if wanted.position is not None and not _encompasses(zone, wanted.position):
        return False
    if wanted.after is None and wanted.before is None:
        return True
    after_ms = None if wanted.after is None else unix_ms(wanted.after)
    before_ms = None if wanted.before is None else unix_ms(wanted.before)
    return holds_sometime(zone, after_ms, before_ms, good)


def _classes(zone: Zone) -> set[str]:
    told = zone.feature["properties"].get("extendedProperties", {}).get(USPACE_CLASS)
    return set(told) if isinstance(told, list) else {told}


def _encompasses(zone: Zone, position: Position) -> bool:
    point, band = shapely.Point(position.longitude, position.latitude), position.band()
    return any(volume.area.intersects(point) and reaches(volume, band) != "no" for volume in zone.volumes)


def holds_sometime(zone: Zone, after_ms: int | None, before_ms: int | None, good: Validity = (None, None)) -> bool:
    """Whether a zone holds at any time from `after_ms` to `before_ms`, both included; None: without end."""
    begins, ends = _within((after_ms, None if before_ms is None else before_ms + 1), good)
    if begins is not None and ends is not None and begins >= ends:
        return False
    if not zone.periods:
        return True
    return any(
        _period_holds(zone, *_within((begins, ends), (period.start_ms, period.end_ms)), daily=bool(period.daily))
        for period in zone.periods
    )


def _period_holds(zone: Zone, begins: int | None, ends: int | None, *, daily: bool) -> bool:
    if begins is not None and ends is not None and begins >= ends:
        return False
    if not daily:
        return True
    # A schedule is one of the week, and the sun's year has less days than are looked at: later ones are no others.
    if begins is None:
        begins = 0 if ends is None else max(0, ends - MAX_DAYS * DAY_MS)
    ends = begins + MAX_DAYS * DAY_MS if ends is None else min(ends, begins + MAX_DAYS * DAY_MS)
    return begins < ends and bool(spans(zone, begins, ends))


def _within(this: Validity, other: Validity) -> Validity:
    begins = [each for each in (this[0], other[0]) if each is not None]
    ends = [each for each in (this[1], other[1]) if each is not None]
    return max(begins, default=None), min(ends, default=None)
