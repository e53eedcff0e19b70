"""Shapes of zones, imports, the geo-awareness service and closures."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.closures import Closure
from wonderland.proofs.records.fields import MAX_TIME_MS
from wonderland_backend.areas import DESCRIPTION, PATTERN
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.filters import PageQuery
from wonderland_backend.schemas import ApiModel, model_of, page_of
from wonderland_backend.zones.applicability import DAY_MS
from wonderland_backend.zones.files.common import TYPES

SOURCE = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,62}$"
MAX_SPAN_MS = 31 * DAY_MS
ZoneType = Literal["PROHIBITED", "REQ_AUTHORIZATION", "USPACE", "CONDITIONAL", "NO_RESTRICTION"]
HeightReference = Literal["AGL", "AMSL", "WGS84"]
assert set(TYPES) == set(ZoneType.__args__)  # type: ignore[attr-defined]


class ZoneText(ApiModel):
    """A text and its language; `und` where its file did not say."""

    text: str
    lang: str


class ZoneLimit(ApiModel):
    """A vertical limit."""

    metres: float
    reference: HeightReference


class ZoneLayer(ApiModel):
    """Between which heights a part of the zone holds; a limit that is missing is none."""

    lower: ZoneLimit | None = None
    upper: ZoneLimit | None = None


class TimeSpan(ApiModel):
    """A span of time; `until_ms` is not part of it."""

    from_ms: int
    until_ms: int


class Zone(ApiModel):
    """A zone of a data set that is in force."""

    zone_id: str = Field(description="Country and identifier", examples=["FIN:EFP20"])
    source: str
    import_id: str
    type: ZoneType
    variant: str
    name: str | None = Field(default=None, description="In the language asked for, where there is one")
    message: str | None = None
    names: list[ZoneText]
    messages: list[ZoneText]
    reasons: list[str]
    conditions: str | None = None
    authorities: list[dict[str, Any]] = Field(description="As ED-318's `zoneAuthority`")
    layers: list[ZoneLayer]
    limited: bool = Field(description="Whether it holds at certain times only")
    active: bool = Field(description="Whether it holds now")
    changes_ms: int | None = Field(default=None, description="When that changes, within 31 days")
    bbox: list[float] = Field(description="West, south, east, north")
    feature: dict[str, Any] | None = Field(default=None, description="The ED-318 feature; not in GeoJSON")


ZonePage = page_of("ZonePage", Zone)


class ZoneQuery(PageQuery):
    """What a list of zones is narrowed by."""

    bbox: str | None = Field(default=None, pattern=PATTERN, description=DESCRIPTION)
    type: ZoneType | None = None
    country: str | None = Field(default=None, pattern=r"^[A-Z]{3}$", description="ISO 3166-1 alpha-3")
    source: str | None = Field(default=None, pattern=SOURCE, description="Only of this source's data set")
    since_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Only those that hold after this")
    until_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Only those that hold before this")
    at_ms: int | None = Field(
        default=None, ge=0, le=MAX_TIME_MS, description="As they were known at this time of the past; `active` is then"
    )

    @model_validator(mode="after")
    def _both_ends(self) -> Self:
        if (self.since_ms is None) != (self.until_ms is None):
            raise FieldRefused(said("fields_together", first="since_ms", second="until_ms"))
        _require_span(self.since_ms, self.until_ms)
        return self


class ZoneFinding(ApiModel):
    """An error or a notice about a file."""

    line: int
    column: int
    path: str = Field(description="Where in the JSON document")
    message: str = Field(description="What was wrong and what to do")


class ImportReport(ApiModel):
    """What a file of zones says, or all that is wrong with it."""

    format: Literal["ed318", "ed269"] | None = None
    sha256: str
    size_bytes: int
    zones: int
    valid: bool
    errors: list[ZoneFinding] = Field(description="At most 200")
    error_count: int
    notices: list[ZoneFinding] = Field(description="What was repaired or left out; at most 200")
    notice_count: int
    added: int = Field(description="Zones that the source did not have")
    removed: int
    changed: int
    import_id: str | None = Field(default=None, description="Where the file was imported")


class ZoneImport(ApiModel):
    """A data set that was imported."""

    import_id: str
    source: str
    format: Literal["ed318", "ed269"]
    sha256: str
    size_bytes: int
    zones: int
    notices: list[ZoneFinding]
    about: dict[str, Any]
    imported_ms: int
    imported_by: str
    replaced_ms: int | None = Field(default=None, description="When the next one took its place; it holds otherwise")


ZoneImportPage = page_of("ZoneImportPage", ZoneImport)


class ImportQuery(BaseModel):
    """Of which source the file is, and whether it is only looked at."""

    model_config = ConfigDict(extra="forbid")

    source: str = Field(pattern=SOURCE, description="Whose data set it replaces", examples=["traficom"])
    dry_run: bool = Field(default=False, description="Read and report, import nothing")


class ImportsQuery(PageQuery):
    """What the list of imports is narrowed by."""

    source: str | None = Field(default=None, pattern=SOURCE)
    current: bool | None = Field(default=None, description="Only those that hold, or only those that were replaced")


class ExportQuery(BaseModel):
    """The source whose data set is exported; all without."""

    model_config = ConfigDict(extra="forbid")

    source: str | None = Field(default=None, pattern=SOURCE, description="Only this source's")


class AwarenessQuery(BaseModel):
    """A place, heights and a time."""

    model_config = ConfigDict(extra="forbid")

    lat: float = Field(ge=-90, le=90)
    lon: float = Field(ge=-180, le=180)
    height_m: float | None = Field(default=None, ge=-1_000, le=100_000, description="Without it: all heights")
    height_reference: HeightReference = "AGL"
    from_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="Now, where it is missing")
    until_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS, description="`from_ms`, where it is missing")

    @model_validator(mode="after")
    def _span(self) -> Self:
        _require_span(self.from_ms, self.until_ms)
        return self


class AwarenessArea(BaseModel):
    """A route or an area, heights and a time."""

    model_config = ConfigDict(extra="forbid")

    geometry: dict[str, Any] = Field(description="GeoJSON: Point, LineString or Polygon, of at most 1 000 positions")
    margin_m: float = Field(default=0, ge=0, le=5_000, description="So far to every side of it")
    lower_m: float | None = Field(default=None, ge=-1_000, le=100_000)
    upper_m: float | None = Field(default=None, ge=-1_000, le=100_000)
    height_reference: HeightReference = "AGL"
    from_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS)
    until_ms: int | None = Field(default=None, ge=0, le=MAX_TIME_MS)

    @model_validator(mode="after")
    def _spans(self) -> Self:
        _require_span(self.from_ms, self.until_ms)
        if self.lower_m is not None and self.upper_m is not None and self.lower_m > self.upper_m:
            raise FieldRefused(said("fields_lower_upper"))
        return self


class ZoneThere(Zone):
    """A zone that holds there and then."""

    spans: list[TimeSpan] = Field(description="When, within the time asked about")
    reaches: Literal["yes", "perhaps"] = Field(
        description="`perhaps`: whether it reaches these heights cannot be said without the terrain or the geoid"
    )


class DataSet(ApiModel):
    """What the answer stands on."""

    source: str
    import_id: str
    imported_ms: int
    valid_from_ms: int | None = None
    valid_until_ms: int | None = None


class Awareness(ApiModel):
    """Which zones hold there and then, the most restrictive first."""

    t_ms: int
    from_ms: int
    until_ms: int
    most_restrictive: ZoneType | None = None
    zones: list[ZoneThere]
    more: bool = Field(description="There are more than the 500 listed")
    data_sets: list[DataSet] = Field(description="With none, no zone is known: that is not the same as free")


class TouchingZone(ApiModel):
    """A zone that comes within a pad's reach."""

    zone_id: str
    type: ZoneType
    name: str | None = None
    distance_m: float = Field(description="From the pad's middle to its nearest part")
    reaches: Literal["yes", "perhaps"]
    closes: bool = Field(description="It forbids landing there while it holds")
    active: bool
    changes_ms: int | None = None


ClosureModel = model_of(Closure)


class PublishedClosures(ApiModel):
    """What the ledger has."""

    closures: list[ClosureModel]  # type: ignore[valid-type]
    valid_until_ms: int
    set_by: str
    set_ms: int
    block: int
    tx_index: int


class PadClosures(ApiModel):
    """A pad, the zones that reach it, and whether the ledger knows of them."""

    pad_id: str
    name: str
    reach_m: float
    zones: list[TouchingZone]
    state: Literal["open", "missing", "current", "ending", "differs", "outdated"] = Field(
        description="open: no zone closes it and none was published; missing: never published; differs: the ledger's "
        "closures are not those of today's zones; ending: within three days; outdated: nothing is permitted there"
    )
    published: PublishedClosures | None = None


PadClosuresPage = page_of("PadClosuresPage", PadClosures)


class ClosurePlan(ApiModel):
    """The argument of SetClosures by today's zones, to be signed by an officer."""

    pad_id: str
    closures: list[ClosureModel]  # type: ignore[valid-type]
    valid_until_ms: int


class PlanQuery(BaseModel):
    """How far ahead."""

    model_config = ConfigDict(extra="forbid")

    days: int = Field(default=14, ge=1, le=90, description="Days (UTC), today included")


def _require_span(from_ms: int | None, until_ms: int | None) -> None:
    if from_ms is not None and until_ms is not None and not 0 <= until_ms - from_ms <= MAX_SPAN_MS:
        raise FieldRefused(said("fields_span"))
    if from_ms is None and until_ms is not None:
        raise FieldRefused(said("fields_together", first="from_ms", second="until_ms"))
