"""From the extract of the demo's place to its archive: some seconds of one core, 0.6 MB."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import shapely

from wonderland_simulator.place import archive, osm
from wonderland_simulator.place.layers import features_of, harbour_names
from wonderland_simulator.place.shore import earth, fading, known_ground, shore
from wonderland_simulator.place.vector_tiles import Plane, cut

ATTRIBUTION: Final = '<a href="https://www.openstreetmap.org/copyright">© OpenStreetMap contributors</a>'
SCHEMA: Final = "wonderland-place/1"
ZOOMS: Final = range(11, 16)
WINDOW: Final = (7.3300, 43.6700, 7.5300, 43.8000)
"""West, south, east, north: far enough out to sea that no screen shows its end at the scale of a town."""
LEADS: Final = (
    ((7.3290, 43.6850), (7.3950, 43.7120), (7.4105, 43.7212)),
    ((7.4425, 43.7503), (7.4620, 43.7600), (7.4900, 43.7760), (7.5310, 43.7880)),
)
"""How the coast goes on beyond the frontier, roughly: where the map has faded."""


@dataclass(frozen=True)
class Built:
    """What was made."""

    tiles: int
    size_bytes: int
    features: Counter[str]
    heights: Counter[str]


def build(extract_file: Path, target: Path) -> Built:
    """Make the archive. Raises `ExtractError`, OSError."""
    extract = osm.read(extract_file.read_bytes())
    plane = Plane((WINDOW[1] + WINDOW[3]) / 2)
    west, north = plane.at(WINDOW[0], WINDOW[3])
    east, south = plane.at(WINDOW[2], WINDOW[1])
    window = shapely.box(west, north, east, south)
    contents = features_of(extract, plane)
    sea = shore(extract, plane, window, LEADS)
    known = known_ground(contents.features)
    features = [
        *earth(sea, window),
        *contents.features,
        *harbour_names(extract, plane),
        *fading(known, sea, window),
    ]
    # Out at sea and beyond the data all tiles are alike: the archive keeps one of them.
    tiles = cut(features, plane, ZOOMS, window)
    names = sorted({each.layer for each in features})
    metadata = {
        "name": "Monaco",
        "attribution": ATTRIBUTION,
        "description": "OpenStreetMap extract of 2023-12-26; sea from the coastline; heights partly estimated",
        "schema": SCHEMA,
        "type": "baselayer",
        "vector_layers": [{"id": name, "fields": {}, "minzoom": ZOOMS[0], "maxzoom": ZOOMS[-1]} for name in names],
    }
    size = archive.write(target, tiles, metadata, WINDOW)
    return Built(len(tiles), size, Counter(each.layer for each in features), contents.heights)
