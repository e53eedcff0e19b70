"""What a pad heard of a drone: one broadcast position, attributed to who sent it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wonderland.proofs.records.sessions import BroadcastClaim


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """A broadcast position, unverified. ``t_ms`` is when the pad heard it, ``claim_t_ms`` when it says it was taken.

    ``height_mm`` is above the WGS-84 ellipsoid; ``operator_id`` has lost its secret characters; ``rssi_dbm`` is only
    known where the receiver told it.
    """

    uav_id: str
    t_ms: int
    lat_e7: int
    lon_e7: int
    transport: str
    height_mm: int | None = None
    accuracy_mm: int | None = None
    height_accuracy_mm: int | None = None
    speed_mm_s: int | None = None
    track_cdeg: int | None = None
    vertical_mm_s: int | None = None
    status: str | None = None
    operator_id: str | None = None
    operator_lat_e7: int | None = None
    operator_lon_e7: int | None = None
    operator_height_mm: int | None = None
    operator_place: str | None = None
    """What the operator's position is: ``takeoff``, ``live_gnss`` or ``fixed``."""
    above_mm: int | None = None
    above: str | None = None
    """What ``above_mm`` is measured from: ``takeoff`` or ``ground``."""
    pressure_mm: int | None = None
    """Altitude against 1013.25 hPa."""
    speed_accuracy_mm_s: int | None = None
    time_accuracy_ms: int | None = None
    ua_type: int | None = None
    eu_category: int | None = None
    eu_class: int | None = None
    description: str | None = None
    """What the operator says that it does (Self ID): anybody's text."""
    description_type: str | None = None
    """``text``, ``emergency``, ``extended_status`` or ``private``."""
    area_count: int | None = None
    """How many aircraft fly under this identity, where there are several, around its position."""
    area_radius_mm: int | None = None
    area_ceiling_mm: int | None = None
    area_floor_mm: int | None = None
    claim_t_ms: int | None = None
    rssi_dbm: int | None = None
    latency_ms: int | None = None
    """How long after its own time the position was heard; negative where the drone's clock is ahead."""
    lost: int = 0
    """Frames that were missed so far, by the gaps in the transports' counters."""
    duplicates: int = 0
    """Positions that were heard again, over another transport or repeated."""
    transports: tuple[str, ...] = ()
    """The transports over which the drone was heard within the last ten seconds."""
    drip: dict[str, str | int | bool] | None = None
    """Who signed its broadcasts (RFC 9575): what was verified, apart from whether the position is true."""

    def claim(self) -> BroadcastClaim:
        """The record that goes into a session's evidence."""
        return BroadcastClaim(
            lat_e7=self.lat_e7,
            lon_e7=self.lon_e7,
            t_ms=self.t_ms,
            height_mm=self.height_mm,
            accuracy_mm=self.accuracy_mm,
            transport=self.transport,
            said_ms=self.claim_t_ms if self.claim_t_ms is not None and self.claim_t_ms >= 0 else None,
        )

    def track(self) -> dict[str, Any]:
        """The body of a ``track`` record (docs/seams.md, "ingest")."""
        body = {
            "uav_id": self.uav_id,
            "lat_e7": self.lat_e7,
            "lon_e7": self.lon_e7,
            "height_mm": self.height_mm,
            "accuracy_mm": self.accuracy_mm,
            "speed_mm_s": self.speed_mm_s,
            "track_cdeg": self.track_cdeg,
            "vertical_mm_s": self.vertical_mm_s,
            "status": self.status,
            "operator_id": self.operator_id,
            "claim_t_ms": self.claim_t_ms,
            "transport": self.transport,
            "rssi": self.rssi_dbm,
            "latency_ms": self.latency_ms,
            "lost": self.lost or None,
            "duplicates": self.duplicates or None,
            "transports": list(self.transports) if len(self.transports) > 1 else None,
            "drip": self.drip,
            "description": self.description,
            "description_type": self.description_type,
            "area_count": self.area_count,
            "area_radius_mm": self.area_radius_mm,
            "area_ceiling_mm": self.area_ceiling_mm,
            "area_floor_mm": self.area_floor_mm,
            "ua_type": self.ua_type,
            "height_accuracy_mm": self.height_accuracy_mm,
            "above_mm": self.above_mm,
            "above": self.above,
            "pressure_mm": self.pressure_mm,
            "speed_accuracy_mm_s": self.speed_accuracy_mm_s,
            "time_accuracy_ms": self.time_accuracy_ms,
            "eu_category": self.eu_category,
            "eu_class": self.eu_class,
            **self._operator(),
        }
        return {name: value for name, value in body.items() if value is not None}

    def _operator(self) -> dict[str, Any]:
        """Where the operator is: for who may know it (docs/uspace), never kept by the backend."""
        if self.operator_lat_e7 is None or self.operator_lon_e7 is None:
            return {}
        return {
            "operator_lat_e7": self.operator_lat_e7,
            "operator_lon_e7": self.operator_lon_e7,
            "operator_height_mm": self.operator_height_mm,
            "operator_place": self.operator_place,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverCounts:
    """What became of the frames since the start; each frame is counted once in ``frames`` and at most once beside.

    ``bad``: no frame, or refused by the codec. ``limited``: dropped unread or unattributed because too many came.
    ``unattributed``: positions before (or without) an identity; ``ambiguous``: positions whose source had named
    several drones outside packs. ``duplicates``: positions heard before, by another way or again. ``heard``: positions
    attributed. ``lost`` are frames that never came, by their counters.
    """

    frames: int = 0
    bad: int = 0
    limited: int = 0
    unattributed: int = 0
    ambiguous: int = 0
    heard: int = 0
    duplicates: int = 0
    lost: int = 0
    drones: int = 0

    def health(self) -> dict[str, int]:
        """The ``receiver`` part of a health record."""
        return {"frames": self.frames, "bad": self.bad}
