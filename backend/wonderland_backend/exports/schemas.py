"""Shapes of exports."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN, MAX_TIME_MS
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.schemas import ApiModel
from wonderland_backend.settings.outputs import Format

_ID = f"^{ID_PATTERN}$"
TimeMs = Annotated[int, Field(strict=True, ge=0, le=MAX_TIME_MS, description="Unix, ms")]
Latitude = Annotated[int, Field(strict=True, ge=-900_000_000, le=900_000_000)]
Longitude = Annotated[int, Field(strict=True, ge=-1_800_000_000, le=1_800_000_000)]


class ExportArea(BaseModel):
    """A part of the globe, its edges included. One whose west is east of its east lies across the date line."""

    model_config = ConfigDict(extra="forbid")

    south_e7: Latitude = Field(examples=[604_400_000])
    west_e7: Longitude = Field(examples=[222_500_000])
    north_e7: Latitude = Field(examples=[604_600_000])
    east_e7: Longitude = Field(examples=[222_800_000])

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.north_e7 < self.south_e7:
            raise FieldRefused(said("fields_south_north"))
        return self

    def holds(self, lat_e7: int, lon_e7: int) -> bool:
        """Whether a place lies within it."""
        if not self.south_e7 <= lat_e7 <= self.north_e7:
            return False
        if self.west_e7 <= self.east_e7:
            return self.west_e7 <= lon_e7 <= self.east_e7
        return lon_e7 >= self.west_e7 or lon_e7 <= self.east_e7


class ExportQuery(BaseModel):
    """Window, format and filters of an export."""

    model_config = ConfigDict(extra="forbid")

    format: Format = Field(description="`mfjson` is OGC Moving Features JSON (19-045r3)")
    from_ms: TimeMs = Field(examples=[1_800_000_000_000])
    until_ms: TimeMs = Field(examples=[1_800_000_600_000], description="Unix, ms; later than `from_ms`")
    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only this serial number")
    pad: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only what this pad told")
    area: ExportArea | None = Field(default=None, description="Only what lies within it")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.until_ms <= self.from_ms:
            raise FieldRefused(said("fields_order", later="until_ms", earlier="from_ms"))
        return self


class Export(ApiModel):
    """An export, and how far it has come."""

    export_id: str
    created_ms: int
    expires_ms: int = Field(description="Until then its file can be fetched, by whoever asked for it")
    expected: int = Field(description="About so many rows, before filters by pad and area")
    state: Literal["prepared", "running", "done", "broken"]
    rows: int = Field(description="Rows written so far")
    bytes: int = Field(description="Size so far of the archive")
    sha256: str | None = Field(default=None, description="Of the archive, once it is whole")
