"""Positions as JSON, one in each datagram."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any, Final

from wonderland_edge_agent.references import STAMPED_S, Point, PositionError

MAX_DATAGRAM_OCTETS: Final = 2_048
PlaceOf = Callable[[Point], Point]
"""From latitude, longitude (degrees) and height (m) to the survey's frame. Raises PositionError."""


def position(data: bytes, place_of: PlaceOf | None, received_s: float) -> tuple[float, Point]:
    """A live position: JSON with ``x, y, z`` or ``lat, lon, height``, and ``t`` (s) if the sender's clock is ours.

    Raises PositionError.
    """
    try:
        value = json.loads(data[:MAX_DATAGRAM_OCTETS])
    except (ValueError, RecursionError):
        raise PositionError("a datagram that is no JSON") from None
    if not isinstance(value, dict):
        raise PositionError("a datagram that is no JSON object")
    if isinstance(value.get("pose"), dict):  # a PoseStamped as rosbridge has it
        inner = value["pose"].get("position", value["pose"])
        value = inner if isinstance(inner, dict) else {}
    try:
        if "lat" in value:
            if place_of is None:
                raise PositionError("positions on the globe, but the survey has no origin there (--origin)")
            point = place_of(_three(value, ("lat", "lon", "height")))
        else:
            point = _three(value, ("x", "y", "z"))
        t_s = float(value.get("t", received_s))
    except (KeyError, TypeError, ValueError):
        raise PositionError("a datagram without x, y, z or lat, lon, height") from None
    if not all(math.isfinite(number) for number in (t_s, *point)):
        raise PositionError("a datagram with numbers that are none")
    return received_s if abs(t_s - received_s) > STAMPED_S else t_s, point


def _three(value: dict[str, Any], names: tuple[str, str, str]) -> Point:
    return (float(value[names[0]]), float(value[names[1]]), float(value[names[2]]))
