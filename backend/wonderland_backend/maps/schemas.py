"""Shapes of the base maps' description."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland_backend.schemas import ApiModel


class MapCredit(ApiModel):
    """A piece of an attribution."""

    text: str
    href: str = Field(description="An https address, or empty")


class MapLayer(ApiModel):
    """A base map, heights of the ground, or aerial images."""

    url: str = Field(description="The archive, read by byte ranges; for a WMTS one address a tile, {z}/{x}/{y}")
    version: str = Field(description="Another one as soon as the file is")
    kind: Literal["vector", "png", "jpeg", "webp", "avif", "wmts"]
    size_bytes: int
    bounds: tuple[float, float, float, float] = Field(
        description="West, south, east, north, degrees", examples=[[22.0, 60.3, 22.6, 60.6]]
    )
    min_zoom: int
    max_zoom: int
    layers: list[str] = Field(description="Of vector tiles")
    encoding: Literal["terrarium", "mapbox"] | None = Field(
        default=None, description="Of terrain: how a pixel says its height"
    )
    attribution: list[MapCredit]


class MissingMap(ApiModel):
    """What was set but cannot be shown."""

    what: Literal["archive", "terrain", "imagery"]
    code: str = Field(description="Why, for a program", examples=["cut_off"])
    facts: dict[str, str | int | float] = Field(description="What the reason tells of", examples=[{"size": 9}])
    why: str = Field(description="The same in English, for a log")
    setting: str = Field(description="Where it is set")


class BaseMap(ApiModel):
    """What the map is drawn from; without an archive the console draws coasts and borders of its own."""

    archive: MapLayer | None = None
    terrain: MapLayer | None = None
    imagery: MapLayer | None = None
    missing: list[MissingMap]
