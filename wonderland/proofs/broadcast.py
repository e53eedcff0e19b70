"""The public claim: what the drone broadcast over Remote ID, judged beside the one that it signed.

A broadcast says less than a signed claim: its position is as good as it states (95 %), some tenths of a second old when
it is heard, and of a drone that may have moved since. Asked is therefore not whether the drone is within the buffer of
it, which for an accuracy of 10 m nobody could prove, but whether it is where that broadcast *can mean*. Every message
is a word to the public; so the one that is farthest beyond what it can mean is judged, and not their mean, in which two
lies might cancel. An honest one leaves more room than the signed claim does; so it costs an honest drone no rounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import Offset
from wonderland.proofs.frame import to_local
from wonderland.proofs.judgement import Measured, judge
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import BroadcastClaim, Evidence, Session
from wonderland.proofs.records.verdicts import Judgement
from wonderland.proofs.reduction import distance

NEAR_CLAIM_MS: Final = 3_000
"""How far a broadcast may lie from the signed claims in time and still be judged by them."""
SAME_TIME_MS: Final = 250
"""Within this the nearest signed claim stands for the moment of a broadcast."""
UNCLAIMED_SPEED_MM_MS: Final = 20.0
"""Between a broadcast and the signed claims a drone may have moved at this speed (20 m/s, 95 %)."""
AGE_MS: Final = 600.0
"""Age of a position when it is heard, 95 %: Remote ID sends once a second and stamps tenths."""
STATED_TIMES: Final = 2.0
"""A position may be off by twice what it states at 95 %: of normal errors one in 160,000 is, so that none of the some
ten messages of an honest session will be."""
_HALF_SECOND_MS: Final = 500
_FARTHEST_MM: Final = 50_000_000.0


@dataclass(frozen=True, slots=True)
class _Heard:
    """One message against the signed claim of its moment."""

    east: float
    north: float
    """Broadcast minus signed claim, mm."""
    tolerance: float
    """How far (mm) from it the drone can be if the message is honest."""


@dataclass(frozen=True, slots=True)
class PublicClaim:
    """The broadcast's judgement."""

    judgement: Judgement
    offset: Offset
    """Estimate minus broadcast."""
    policy: Policy
    """With the tolerance as its buffer."""


def judge_broadcast(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    measured: Measured,
    path: ClaimedPath,
    *,
    may_refute: bool,
) -> PublicClaim | None:
    """The farthest message that was heard beside the signed claims; None where none was."""
    farthest: _Heard | None = None
    for heard in _messages(session, commissioning, evidence, path):
        if farthest is None or _beyond(heard) > _beyond(farthest):
            farthest = heard
    if farthest is None:
        return None
    policy = replace(session.policy, buffer_mm=int(farthest.tolerance))
    judgement = judge(
        policy,
        commissioning,
        measured,
        (farthest.east, farthest.north),
        may_verify=measured.agreement.usable,
        may_refute=may_refute,
    )
    offset = replace(
        measured.offset, east=measured.offset.east - farthest.east, north=measured.offset.north - farthest.north
    )
    return PublicClaim(
        replace(
            judgement,
            paper_rule=judgement.error_mm <= session.policy.buffer_mm,
            tolerance_mm=policy.buffer_mm,
        ),
        offset,
        policy,
    )


def tolerance_mm(policy: Policy, accuracy_mm: int | None, speed_mm_ms: float, gap_ms: int) -> float:
    """How far from its broadcast an honest drone can be.

    One that states no accuracy is held to the buffer, and one that states a very poor one gains no more than the
    policy lets a signed claim state.
    """
    accuracy = float(min(accuracy_mm or 0, policy.max_claim_accuracy_mm))
    aged = speed_mm_ms * AGE_MS
    moved = UNCLAIMED_SPEED_MM_MS * gap_ms if gap_ms > SAME_TIME_MS else 0.0
    return max(float(policy.buffer_mm), STATED_TIMES * sqrt(accuracy * accuracy + aged * aged + moved * moved))


def _messages(session: Session, commissioning: Commissioning, evidence: Evidence, path: ClaimedPath) -> list[_Heard]:
    """Those heard while claims were signed; where there are none, the nearest in time."""
    first_ms, last_ms = path.points[0].t_ms, path.points[-1].t_ms
    gaps = [max(first_ms - heard.t_ms, heard.t_ms - last_ms, 0) for heard in evidence.broadcast]
    nearest_ms = min(gaps, default=NEAR_CLAIM_MS + 1)
    if nearest_ms > NEAR_CLAIM_MS:
        return []
    reach_ms = max(nearest_ms, SAME_TIME_MS)
    return [
        _heard(heard, gap_ms, session, commissioning, path)
        for heard, gap_ms in zip(evidence.broadcast, gaps, strict=True)
        if gap_ms <= reach_ms
    ]


def _heard(
    heard: BroadcastClaim, gap_ms: int, session: Session, commissioning: Commissioning, path: ClaimedPath
) -> _Heard:
    points = path.points
    claimed = path.at(heard.t_ms) or points[0 if heard.t_ms < points[0].t_ms else -1]
    height = heard.height_mm if heard.height_mm is not None else session.claim.height_mm
    try:
        east, north, _ = to_local(commissioning.frame, heard.lat_e7, heard.lon_e7, height)
    except GeometryError:
        east, north = 100_000_000, 0  # broadcast from elsewhere: as far off as the records can say
    speed = 0.0
    for moment in (heard.t_ms - _HALF_SECOND_MS, heard.t_ms + _HALF_SECOND_MS):
        other = path.at(moment)
        if other is not None:
            speed = max(speed, distance(other.east - claimed.east, other.north - claimed.north, 0.0) / _HALF_SECOND_MS)
    return _Heard(
        max(-_FARTHEST_MM, min(_FARTHEST_MM, east - claimed.east)),
        max(-_FARTHEST_MM, min(_FARTHEST_MM, north - claimed.north)),
        tolerance_mm(session.policy, heard.accuracy_mm, speed, gap_ms),
    )


def _beyond(heard: _Heard) -> float:
    return distance(heard.east, heard.north, 0.0) - heard.tolerance
