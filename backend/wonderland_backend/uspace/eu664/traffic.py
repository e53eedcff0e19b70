"""What each recipient may know of a flight (EU 2021/664, article 8), and what has changed since it last looked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from uas_standards.astm.f3411.v22a.api import (
    OperatorLocationAltitudeType,
    RIDHeightReference,
    RIDOperationalStatus,
)

from wonderland.geoid import Geoid
from wonderland_backend.areas import Box
from wonderland_backend.uspace.eu664.schemas import Recipient
from wonderland_backend.uspace.flights import Flight, Flights

SCOPES: Final[dict[str, Recipient]] = {
    "wonderland.traffic.authority": "authority",
    "wonderland.traffic.ats": "ats",
    "wonderland.traffic.ussp": "ussp",
    "wonderland.traffic.public": "public",
}
"""The first of these that a token has says which recipient its bearer is."""
_EMERGENCY: Final = {
    RIDOperationalStatus.Undeclared: "unknown",
    RIDOperationalStatus.Ground: "none",
    RIDOperationalStatus.Airborne: "none",
    RIDOperationalStatus.Emergency: "emergency",
    RIDOperationalStatus.RemoteIDSystemFailure: "remote_id_failure",
}
_ABOVE: Final = {RIDHeightReference.TakeoffLocation: "takeoff", RIDHeightReference.GroundLevel: "ground"}
_PLACES: Final = {
    OperatorLocationAltitudeType.Takeoff: "takeoff",
    OperatorLocationAltitudeType.Dynamic: "pilot",
    OperatorLocationAltitudeType.Fixed: "fixed",
}


class TrafficInformation:
    """Tells recipients of flights."""

    def __init__(self, flights: Flights, serves: Callable[[Flight], bool], geoid: Geoid | None) -> None:
        """`serves` says whether we are a flight's service provider; without a `geoid` no height above sea is told."""
        self._flights = flights
        self._serves = serves
        self._geoid = geoid

    def items(
        self, recipient: Recipient, box: Box | None = None, *, after: int = -1
    ) -> tuple[list[dict[str, Any]], int]:
        """Flights that changed since the `after` that the last call gave (−1: all), and the next `after`."""
        upto = self._flights.changes
        found = [
            self._item(flight, recipient)
            for flight in self._flights
            if flight.changed > after
            and not flight.simulated
            and flight.is_airborne
            and (box is None or box.holds(flight.current.lat, flight.current.lng))
        ]
        return found, upto

    def _item(self, flight: Flight, recipient: Recipient) -> dict[str, Any]:
        state = flight.current
        item: dict[str, Any] = {
            "flight_id": flight.flight_id,
            "t_ms": state.t_ms,
            "heard_ms": flight.heard_ms,
            "lat_e7": state.lat,
            "lon_e7": state.lng,
            "altitude_amsl_mm": self._amsl_mm(state.altitude_m, state.lat, state.lng),
            "altitude_wgs84_mm": _thousandths(state.altitude_m),
            "height_mm": _thousandths(state.height_m),
            "height_above": _ABOVE[state.height_reference] if state.height_m is not None else None,
            "course_cdeg": None if state.track_deg is None else round(state.track_deg * 100) % 36_000,
            "ground_speed_mm_s": _thousandths(state.speed_m_s),
            "emergency": _EMERGENCY[state.status],
            "source": "service_provider" if self._serves(flight) else "broadcast",
            "verified": False,
        }
        if recipient != "public":
            item |= _identity(flight)
        return {name: value for name, value in item.items() if value is not None}

    def _amsl_mm(self, altitude_m: float | None, lat: int, lng: int) -> int | None:
        if altitude_m is None or self._geoid is None:
            return None
        return round(altitude_m * 1000) - self._geoid.undulation_mm(lat, lng)


def _identity(flight: Flight) -> dict[str, Any]:
    operator = flight.details.operator
    found: dict[str, Any] = {"serial": flight.drone, "operator_registration": operator.registration}
    if operator.lat is not None and operator.lng is not None:
        pilot: dict[str, Any] = {"lat_e7": operator.lat, "lon_e7": operator.lng}
        if operator.place is not None:
            pilot["place"] = _PLACES[operator.place]
        found["pilot"] = pilot
    return found


def _thousandths(value: float | None) -> int | None:
    return None if value is None else round(value * 1000)
