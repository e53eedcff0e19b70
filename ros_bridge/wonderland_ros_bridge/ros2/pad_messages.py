"""What a pad says, as messages of ROS 2: from the ledger's records and its agent's reports. Pure.

Lengths are metres, angles radians, times since the Unix epoch; frames as in REP-105: ``map``, in it the pad's frame
(east, north, up from the origin of its survey, REP-103), in it one for each anchor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from wonderland import telemetry
from wonderland.asset_contract import CommittedEvent
from wonderland.proofs.records.pads import Anchor, Frame, Pad
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland_rmw_zenoh.wire import as_name

Message = Mapping[str, Any]

UNKNOWN_M2: Final = 1e6
"""Variance of what was not measured: a kilometre, and no direction at all."""
_OK, _WARN, _ERROR, _STALE = 0, 1, 2, 3
_LEVELS: Final = {"up": _OK, "silent": _WARN, "down": _ERROR}
_NO_ROTATION: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_INFRARED: Final = 1
"""The nearest that `sensor_msgs/Range` has: it knows no radio."""
_WGS84_ELLIPSOID_FIX: Final = 0


def stamp(t_ms: int) -> Message:
    """A time (ms) as ROS 2 has it."""
    return {"sec": t_ms // 1_000, "nanosec": t_ms % 1_000 * 1_000_000}


def header(t_ms: int, frame: str) -> Message:
    """When, and in which frame."""
    return {"stamp": stamp(t_ms), "frame_id": frame}


def anchor_frame(frame: str, anchor_id: str) -> str:
    """The frame of an anchor."""
    return f"{frame}_{as_name(anchor_id)}"


def transforms(t_ms: int, pad: Pad, frame: str, map_frame: str) -> Message:
    """``tf2_msgs/TFMessage``: where the pad and its anchors are, which does not change until the next survey."""
    anchors: Sequence[Anchor] = () if pad.commissioning is None else pad.commissioning.anchors
    own = [_transform(t_ms, map_frame, frame, (0, 0, 0))]
    return {
        "transforms": own
        + [
            _transform(t_ms, frame, anchor_frame(frame, each.anchor_id), (each.east_mm, each.north_mm, each.up_mm))
            for each in anchors
        ]
    }


def _transform(t_ms: int, parent: str, child: str, at_mm: tuple[int, int, int]) -> Message:
    east, north, up = (each / 1_000 for each in at_mm)
    return {
        "header": header(t_ms, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": east, "y": north, "z": up}, "rotation": _NO_ROTATION},
    }


def origin(t_ms: int, where: Frame, frame: str) -> Message:
    """``sensor_msgs/NavSatFix``: the WGS-84 position of the frame's origin; the height is above the ellipsoid."""
    return {
        "header": header(t_ms, frame),
        "status": {"status": _WGS84_ELLIPSOID_FIX, "service": 1},
        "latitude": where.lat_e7 / 1e7,
        "longitude": where.lon_e7 / 1e7,
        "altitude": where.height_mm / 1_000,
        "position_covariance_type": 0,
    }


def estimate(t_ms: int, said: telemetry.Estimate, frame: str) -> Message:
    """``geometry_msgs/PoseWithCovarianceStamped``: a running estimate. Its height and direction are not measured."""
    covariance = _covariance(said.ee_mm2, said.en_mm2, said.nn_mm2)
    return {"header": header(t_ms, frame), "pose": _pose(said.east_mm, said.north_mm, 0, covariance)}


def ranges(t_ms: int, said: telemetry.Estimate, frame: str, pad: Pad) -> Iterable[tuple[str, Message]]:
    """(anchor, ``sensor_msgs/Range``): the latest range of each; infinite where there is none (REP-117)."""
    if pad.commissioning is None:
        return
    for anchor in pad.commissioning.anchors:
        range_mm = said.ranges.get(anchor.anchor_id)
        if range_mm is None:
            continue
        yield (
            anchor.anchor_id,
            {
                "header": header(t_ms, anchor_frame(frame, anchor.anchor_id)),
                "radiation_type": _INFRARED,
                "field_of_view": 2 * math.pi,
                "min_range": 0.0,
                "max_range": pad.commissioning.max_range_mm / 1_000,
                "range": math.inf if range_mm < 0 else range_mm / 1_000,
                "variance": (pad.commissioning.range_sigma_mm / 1_000) ** 2,
            },
        )


def session(said: Session, event: CommittedEvent, block: int, frame: str) -> Message:
    """``wonderland_msgs/Session``, of a committed event."""
    return {
        "header": header(event.t_ms, frame),
        "session_id": said.session_id,
        "pad_id": said.pad_id,
        "uav_id": said.uav_id,
        "action": said.action,
        "state": said.state,
        "requested": stamp(said.requested_ms),
        "expires": stamp(said.expires_ms),
        "end": said.end or "",
        "tx_id": event.tx_id,
        "block": block,
    }


def verdict(said: Verdict, event: CommittedEvent, block: int, frame: str) -> Message:
    """``wonderland_msgs/Verdict``, of a committed event."""
    pose: Message = {"pose": {"orientation": _NO_ROTATION}, "covariance": _covariance(None, 0, None)}
    if said.estimate is not None and said.covariance is not None:
        covariance = _covariance(said.covariance.ee_mm2, said.covariance.en_mm2, said.covariance.nn_mm2)
        up_mm = 0
        if said.height is not None and said.height.outcome != "claimed":
            up_mm = said.height.measured_mm
            covariance[14] = said.height.uu_mm2 / 1e6
            covariance[2] = covariance[12] = said.height.eu_mm2 / 1e6
            covariance[8] = covariance[13] = said.height.nu_mm2 / 1e6
        pose = _pose(said.estimate.east_mm, said.estimate.north_mm, up_mm, covariance)
    return {
        "header": header(said.decided_ms, frame),
        "session_id": said.session_id,
        "pad_id": said.pad_id,
        "uav_id": said.uav_id,
        "action": said.action,
        "outcome": said.outcome,
        "permission": said.permission,
        "authorised": said.authorised,
        "assurance": said.assurance,
        "rounds": said.rounds,
        "buffer_m": said.buffer_mm / 1_000,
        "reasons": [each.code for each in said.reasons],
        "has_estimate": said.estimate is not None,
        "estimate": pose,
        "likelihood": 0.0 if said.signed is None else said.signed.likelihood_ppm / 1e6,
        "evidence_sha256": said.evidence_sha256,
        "tx_id": event.tx_id,
        "block": block,
    }


def step(said: telemetry.Step, frame: str) -> Message:
    """``wonderland_msgs/Step``."""
    return {
        "header": header(said.t_ms, frame),
        "session_id": said.session_id,
        "uav_id": said.uav_id,
        "step": said.step,
        "ok": said.ok,
        "detail": said.detail or "",
    }


def state(
    t_ms: int, pad: Pad | None, health: telemetry.Health | None, *, frame: str, session_id: str, on_ledger: bool
) -> Message:
    """``wonderland_msgs/PadState``; ``health`` is None while its agent says nothing."""
    anchors = () if health is None else health.anchors
    return {
        "header": header(t_ms, frame),
        "pad_id": "" if pad is None else pad.pad_id,
        "reporting": health is not None,
        "on_ledger": on_ledger,
        "status": "" if pad is None else pad.status,
        "anchors": [
            {"anchor_id": each.anchor_id, "state": each.state, "detail": each.detail or ""} for each in anchors
        ],
        "prekeys": -1 if health is None or health.prekeys is None else health.prekeys,
        "drift": "" if health is None or health.drift is None else health.drift.state,
        "session_id": session_id,
        "version": "" if health is None else health.version or "",
    }


def diagnostics(
    t_ms: int,
    pad_id: str,
    health: telemetry.Health | None,
    *,
    on_ledger: bool,
    door: tuple[str, str, Message] | None = None,
) -> Message:
    """``diagnostic_msgs/DiagnosticArray``: the agent, the ledger, Open-RMF's door, each anchor."""

    def status(name: str, level: int, message: str, **values: object) -> Message:
        pairs = [{"key": key, "value": str(value)} for key, value in values.items()]
        return {"level": level, "name": f"{pad_id}: {name}", "message": message, "hardware_id": pad_id, "values": pairs}

    ledger = status("ledger", *((_OK, "followed") if on_ledger else (_ERROR, "away")))
    doors = [] if door is None else [status("door", _LEVELS[door[0]], door[1], **door[2])]
    if health is None:
        return {"header": header(t_ms, ""), "status": [status("agent", _STALE, "it reports nothing"), ledger, *doors]}
    spool = health.spool
    waiting = {} if spool is None else {"spooled": spool.records, "dropped": spool.dropped}
    none_left = health.prekeys == 0
    agent = status("agent", _ERROR if none_left else _OK, "no prekeys left" if none_left else "reports", **waiting)
    anchors = [
        status(f"anchor {each.anchor_id}", _LEVELS.get(each.state, _WARN), each.detail or each.state)
        for each in health.anchors
    ]
    return {"header": header(t_ms, ""), "status": [agent, ledger, *doors, *anchors]}


def _pose(east_mm: int, north_mm: int, up_mm: int, covariance: list[float]) -> Message:
    place = {"x": east_mm / 1_000, "y": north_mm / 1_000, "z": up_mm / 1_000}
    return {"pose": {"position": place, "orientation": _NO_ROTATION}, "covariance": covariance}


def _covariance(ee_mm2: int | None, en_mm2: int, nn_mm2: int | None) -> list[float]:
    """Row by row: x, y, z and the turns about them."""
    found = [0.0] * 36
    for index in range(6):
        found[index * 7] = UNKNOWN_M2
    if ee_mm2 is not None and nn_mm2 is not None:
        found[0], found[7] = ee_mm2 / 1e6, nn_mm2 / 1e6
        found[1] = found[6] = en_mm2 / 1e6
    return found
