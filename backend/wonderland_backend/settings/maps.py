"""Settings of the base maps."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, model_validator


class MapSettings(BaseModel):
    """``WONDERLAND_BACKEND_MAP__…``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    archive: Path | None = Field(
        default=None, description="PMTiles archive of vector tiles (Protomaps schema) that the map is drawn from"
    )
    terrain: Path | None = Field(
        default=None, description="PMTiles archive of heights (PNG, WebP): the drawn ground is shaded by its slopes"
    )
    terrain_encoding: Literal["terrarium", "mapbox"] = Field(
        default="terrarium", description="How a pixel of the terrain's images says its height"
    )
    imagery: Path | None = Field(default=None, description="PMTiles archive of aerial images (PNG, JPEG, WebP)")
    wmts: str | None = Field(
        default=None,
        max_length=1_000,
        description="WMTS of aerial images: its address for a tile, with {z}, {x} and {y}, in Web Mercator",
    )
    imagery_attribution: str = Field(default="", max_length=300, description="Whose aerial images these are")
    wmts_timeout_s: float = Field(default=6.0, gt=0, le=60, description="A WMTS that takes longer counts as away")

    @model_validator(mode="after")
    def _imagery_is_one(self) -> Self:
        if self.imagery is not None and self.wmts is not None:
            raise ValueError("imagery and wmts are both set: aerial images come from one of them")
        if self.wmts is not None:
            parts = urlsplit(self.wmts)
            if parts.scheme not in {"http", "https"} or not parts.hostname or "@" in parts.netloc:
                raise ValueError("wmts is no http(s) address")
            if not all(each in self.wmts for each in ("{z}", "{x}", "{y}")):
                raise ValueError("wmts has no {z}, {x} and {y}")
        return self
