"""Site plans of the demo's pads: what their operators would have drawn of quay, mole and heliport."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final

Point = tuple[float, float]


def _turned(points: Sequence[Point], bearing_deg: float, at: Point = (0.0, 0.0)) -> list[list[float]]:
    """Points given along and across, with the first axis towards a bearing (clockwise from north)."""
    turn = math.radians(bearing_deg)
    return [
        [
            round(at[0] + along * math.sin(turn) + across * math.cos(turn), 2),
            round(at[1] + along * math.cos(turn) - across * math.sin(turn), 2),
        ]
        for along, across in points
    ]


def _area(kind: str, points: list[list[float]], **properties: object) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": [[*points, points[0]]]}
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def _box(
    kind: str, long_m: float, wide_m: float, bearing_deg: float, at: Point = (0.0, 0.0), **properties: object
) -> dict[str, Any]:
    along, across = long_m / 2, wide_m / 2
    corners = ((along, -across), (along, across), (-along, across), (-along, -across))
    return _area(kind, _turned(corners, bearing_deg, at), **properties)


def _circle(kind: str, radius_m: float, **properties: object) -> dict[str, Any]:
    around = [(radius_m * math.cos(a), radius_m * math.sin(a)) for a in (math.tau * i / 48 for i in range(48))]
    return _area(kind, _turned(around, 0.0), **properties)


def _sector(kind: str, bearing_deg: float, length_m: float, name: str) -> dict[str, Any]:
    """A fan that opens by 15 % to each side from the safety area outwards."""
    near, far = 6.0, 6.0 + length_m
    corners = ((near, -5.0), (far, -5.0 - 0.15 * length_m), (far, 5.0 + 0.15 * length_m), (near, 5.0))
    return _area(kind, _turned(corners, bearing_deg), name=name)


def _line(kind: str, points: Sequence[Point], bearing_deg: float, **properties: object) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": _turned(points, bearing_deg)}
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def _mast(name: str, east_m: float, north_m: float, height_m: float) -> dict[str, Any]:
    properties = {"kind": "obstacle", "name": name, "height_m": height_m}
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Point", "coordinates": [east_m, north_m]},
    }


def _touchdown(bearing_deg: float) -> list[dict[str, Any]]:
    """Safety area, FATO, TLOF and the H in the middle."""
    letter = ((-0.7, -0.45), (0.7, -0.45)), ((-0.7, 0.45), (0.7, 0.45)), ((0.0, -0.45), (0.0, 0.45))
    return [
        _circle("safety_area", 6.0),
        _box("fato", 7.0, 7.0, bearing_deg),
        _box("tlof", 4.0, 4.0, bearing_deg),
        *(_line("marking", stroke, bearing_deg) for stroke in letter),
    ]


_PLANS: Final[dict[str, list[dict[str, Any]]]] = {
    "hatter-quay": [
        _box("surface", 18.0, 12.0, 130.0, (-2.3, -2.7), name="Quay"),
        *_touchdown(130.0),
        _sector("approach_sector", 10.0, 60.0, "Over the harbour"),
        _sector("departure_sector", 190.0, 60.0, "Along the quay"),
        _mast("Lamp", -9.5, 2.5, 6.5),
        _mast("Crane", -3.5, -9.0, 9.0),
        _box("charger", 1.6, 1.0, 130.0, (-7.0, -3.0), name="Charger", height_m=1.4),
        _line("fence", ((-9.0, 9.3), (9.0, 9.3)), 130.0, name="Fence", height_m=1.2),
    ],
    "looking-glass-mole": [
        _box("surface", 16.0, 14.0, 45.0, name="Mole"),
        *_touchdown(45.0),
        _sector("approach_sector", 315.0, 60.0, "From the bay"),
        _sector("departure_sector", 135.0, 60.0, "Out to sea"),
        _mast("Beacon", 7.5, 6.0, 8.0),
        _box("obstacle", 6.0, 2.4, 45.0, (-8.5, -6.0), name="Container office", height_m=2.6),
        _box("charger", 1.6, 1.0, 45.0, (6.5, -5.5), name="Charger", height_m=1.4),
    ],
    "cheshire-heliport": [
        _box("surface", 22.0, 22.0, 60.0, name="Apron"),
        *_touchdown(60.0),
        _sector("approach_sector", 150.0, 80.0, "From the sea"),
        _sector("departure_sector", 330.0, 60.0, "Along the rock"),
        _mast("Wind sock", 10.0, -3.0, 5.0),
        _box("obstacle", 8.0, 4.0, 60.0, (-9.0, 10.0), name="Hangar", height_m=4.5),
        _box("charger", 2.0, 1.2, 60.0, (8.5, 6.5), name="Charger", height_m=1.6),
        _line("fence", ((-12.0, -11.5), (11.5, -11.5), (11.5, 11.5)), 60.0, name="Fence", height_m=2.0),
    ],
}


def site_plan(pad_id: str) -> bytes | None:
    """The file of a pad's plan; None for a pad of another place."""
    features = _PLANS.get(pad_id)
    if features is None:
        return None
    return json.dumps({"type": "FeatureCollection", "frame": "pad", "features": features}, indent=1).encode()
