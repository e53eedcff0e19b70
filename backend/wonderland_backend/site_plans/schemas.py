"""Shapes of site plans."""

from __future__ import annotations

from typing import Any, Final

from pydantic import Field

from wonderland_backend.geojson import MEDIA_TYPE
from wonderland_backend.schemas import ApiModel

_TLOF: Final = {
    "type": "Feature",
    "properties": {"kind": "tlof"},
    "geometry": {"type": "Polygon", "coordinates": [[[-2, -2], [2, -2], [2, 2], [-2, 2], [-2, -2]]]},
}
_LAMP: Final = {
    "type": "Feature",
    "properties": {"kind": "obstacle", "name": "Lamp", "height_m": 6.5},
    "geometry": {"type": "Point", "coordinates": [-9.5, 2.5]},
}
# What is in a file, `wonderland.site_plans` checks: by place and in words, which no schema does.
CONTENT: Final[dict[str, Any]] = {
    MEDIA_TYPE: {
        "schema": {"type": "object"},
        "example": {"type": "FeatureCollection", "frame": "pad", "features": [_TLOF, _LAMP]},
    }
}


class StoredSitePlan(ApiModel):
    """A site plan that was checked and is kept; it holds as soon as SetSitePlan has put its hash on the ledger."""

    pad_id: str
    sha256: str = Field(description="Of the file, as SetSitePlan takes it", examples=["9f86d08" + "0" * 57])
    size_bytes: int
    features: int
    image: bool = Field(description="Whether it has one")
