"""From what a drone broadcast to what the backend is told of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland.attested import stated_accuracy_mm
from wonderland.telemetry import Drip, Signature, Track
from wonderland_edge_agent.receiver.heard import Heard
from wonderland_remote_id import (
    ClassificationType,
    DescriptionType,
    HeightReference,
    OperatorLocationType,
    System,
    resolve_time,
)

if TYPE_CHECKING:
    from wonderland.telemetry.fields import Above, DescriptionName, OperatorPlace
    from wonderland_edge_agent.receiver.tracks import DroneTrack
    from wonderland_remote_id import Location, SelfId
    from wonderland_remote_id.drip.observer import Observation

_UNSAID: Final = System()
_ABOVE: Final[dict[HeightReference, Above]] = {HeightReference.TAKEOFF: "takeoff", HeightReference.GROUND: "ground"}
_PLACES: Final[dict[OperatorLocationType, OperatorPlace]] = {
    OperatorLocationType.TAKEOFF: "takeoff",
    OperatorLocationType.LIVE_GNSS: "live_gnss",
    OperatorLocationType.FIXED: "fixed",
}
_DESCRIPTIONS: Final[dict[int, DescriptionName]] = {
    DescriptionType.TEXT: "text",
    DescriptionType.EMERGENCY: "emergency",
    DescriptionType.EXTENDED_STATUS: "extended_status",
}


def heard_of(
    uav_id: str, drone: DroneTrack, location: Location, *, transport: str, now_ms: int, rssi_dbm: int | None
) -> Heard:
    """A position with what is known of its drone. ``location`` must have a latitude and a longitude."""
    assert location.lat_e7 is not None
    assert location.lon_e7 is not None
    claim_t_ms = resolve_time(location, now_ms)
    if claim_t_ms is not None:
        drone.latency_ms = now_ms - claim_t_ms
    system = drone.system or _UNSAID
    is_placed = system.operator_lat_e7 is not None and system.operator_lon_e7 is not None
    is_eu = system.classification is ClassificationType.EU
    is_group = system.area_count > 1
    transports = drone.transports(now_ms)
    track = Track(
        uav_id=uav_id,
        lat_e7=location.lat_e7,
        lon_e7=location.lon_e7,
        transport=transport,
        height_mm=location.altitude_mm,
        accuracy_mm=stated_accuracy_mm(location),
        height_accuracy_mm=location.vertical_accuracy.mm,
        speed_mm_s=location.speed_mm_s,
        track_cdeg=location.track_cdeg,
        vertical_mm_s=location.vertical_mm_s,
        status=location.status.name.lower(),
        claim_t_ms=claim_t_ms,
        rssi=rssi_dbm,
        latency_ms=drone.latency_ms if claim_t_ms is not None else None,
        lost=drone.lost or None,
        duplicates=drone.duplicates or None,
        transports=transports if len(transports) > 1 else None,
        drip=drip_of(drone.drip) if drone.drip is not None else None,
        description=drone.self_id.text.strip() if drone.self_id is not None else None,
        description_type=_description_type(drone.self_id) if drone.self_id is not None else None,
        area_count=system.area_count if is_group else None,
        area_radius_mm=system.area_radius_mm if is_group else None,
        area_ceiling_mm=system.area_ceiling_mm if is_group else None,
        area_floor_mm=system.area_floor_mm if is_group else None,
        ua_type=int(drone.ua_type) if drone.ua_type is not None else None,
        above_mm=location.height_mm,
        above=_ABOVE[location.height_reference] if location.height_mm is not None else None,
        pressure_mm=location.pressure_altitude_mm,
        speed_accuracy_mm_s=location.speed_accuracy.mm_s,
        time_accuracy_ms=location.time_accuracy_ms,
        eu_category=int(system.category) if is_eu else None,
        eu_class=int(system.uas_class) if is_eu else None,
        # Where the operator is: for who may know it (docs/uspace), never kept by the backend.
        operator_id=drone.operator_id,
        operator_lat_e7=system.operator_lat_e7 if is_placed else None,
        operator_lon_e7=system.operator_lon_e7 if is_placed else None,
        operator_height_mm=system.operator_altitude_mm if is_placed else None,
        operator_place=_PLACES[system.operator_location] if is_placed else None,
    )
    return Heard(now_ms, track)


def drip_of(seen: Observation) -> Drip:
    """What an authentication message came to."""
    return Drip(
        state=seen.state,
        format=seen.format,
        det=seen.det,
        t_ms=seen.t_ms,
        covers_location=seen.covers_location,
        bound=seen.bound,
        signer=seen.signer,
        reason=seen.reason,
    )


def signature_of(strongest: Observation, refused: int) -> Signature:
    """The strongest signature of a session, and how many messages were refused in it."""
    return Signature(
        state=strongest.state,
        format=strongest.format,
        det=strongest.det,
        t_ms=strongest.t_ms,
        covers_location=strongest.covers_location,
        bound=strongest.bound,
        signer=strongest.signer,
        reason=strongest.reason,
        refused=refused,
    )


def _description_type(self_id: SelfId) -> DescriptionName:
    return _DESCRIPTIONS.get(self_id.description_type, "private")
