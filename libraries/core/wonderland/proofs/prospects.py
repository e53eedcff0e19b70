"""What a pad can settle at a place before anything is ranged: from its commissioning alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from wonderland.proofs.differences import frames_needed
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import solve
from wonderland.proofs.frame import to_local
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim
from wonderland.proofs.reduction import HEIGHT_SIGMA_FLOOR_MM, Reduced, anchor_mean, distance
from wonderland.proofs.space import solve_in_space
from wonderland.proofs.stopping import rounds_needed

TIMED_ASSURANCE: Final = 3
"""From this assurance on the time stamps alone have to prove the claim."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What to expect of an honest drone at a place."""

    rounds: int
    """Rounds that settle an honest claim on average; −1 where no number does."""
    one_round: Matrix2
    """Covariance of the estimate after one round, mm²."""
    floor: Matrix2
    """The part of it that more rounds do not shrink."""


def prospect(
    commissioning: Commissioning,
    policy: Policy,
    east: float,
    north: float,
    up: float,
    *,
    height_sigma_mm: float = HEIGHT_SIGMA_FLOOR_MM,
    bias_left: float = 1.0,
) -> Prospect | None:
    """What this pad can settle about a drone at a place of its frame (mm); None where its geometry gives no position.

    ``bias_left``: what the drone's way leaves of the biases' variance (``travel``); 1 for a drone that hovers.

    The number of rounds is that of a claim that is exactly right and of a sample that falls as it should; real
    sessions need half as many again.
    """
    reduced = _expected(commissioning, east, north, up, height_sigma_mm, bias_left)
    if reduced is None:
        return None
    offset = solve(reduced)
    if offset is None:
        return None
    axes = offset.covariance.ellipse()
    settled = offset.floor.along(axes.east, axes.north)
    white = max(offset.covariance.along(axes.east, axes.north) - settled, 0.0)
    rounds = rounds_needed(0.0, white, settled, policy) if offset.mirror is None else -1
    return Prospect(rounds, offset.covariance, offset.floor)


def height_rounds(
    commissioning: Commissioning, policy: Policy, east: float, north: float, up: float, *, bias_left: float = 1.0
) -> int:
    """Rounds that prove an honest height at a place (mm), one that is exactly right; −1 where no number does."""
    reduced = _expected(commissioning, east, north, up, HEIGHT_SIGMA_FLOOR_MM, bias_left)
    found = solve_in_space(reduced, 0.0, 0.0) if reduced is not None else None
    if found is None or any(abs(other) >= policy.height_buffer_mm for other in found.others):
        return -1
    wanted = replace(policy, buffer_mm=policy.height_buffer_mm)
    return rounds_needed(0.0, max(found.uu - found.floor, 0.0), found.floor, wanted)


def _expected(
    commissioning: Commissioning, east: float, north: float, up: float, height_sigma_mm: float, bias_left: float
) -> Reduced | None:
    """One round of a drone at a place, as it is on average; None where fewer than three anchors reach it."""
    correlation = (commissioning.correlation_ppm or 0) / 1_000_000.0
    white = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)
    white = white * (1.0 + correlation) / (1.0 - correlation)
    anchors = []
    for index, anchor in enumerate(commissioning.anchors):
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        if expected > commissioning.max_range_mm:
            continue
        anchors.append(anchor_mean(index, anchor, expected, 0.0, count=1, white=white, left=bias_left))
    if len(anchors) < 3:
        return None
    return Reduced(
        anchors=tuple(anchors),
        east=east,
        north=north,
        up=up,
        t_ms=0,
        rounds=1,
        effective=1.0,
        bursts=0,
        height_sigma_mm=max(height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM),
        installation_sigma_mm=float(commissioning.installation_sigma_mm),
    )


def hopeless(commissioning: Commissioning, policy: Policy, claim: Claim) -> str:
    """Why this pad can never verify an honest drone at its claim, whatever it measures; empty where it can."""
    try:
        east, north, up = (
            float(value) for value in to_local(commissioning.frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
        )
    except GeometryError:
        return "the claimed position is nowhere near this pad"
    fixed = commissioning.bias_fixed_ppm
    # It may fly about: nothing less can be left than what is fixed.
    left = 1.0 if fixed is None else fixed / 1_000_000.0
    expected = prospect(commissioning, policy, east, north, up, bias_left=left)
    if expected is None:
        return "the claimed position is out of the pad's reach, or its geometry gives none there"
    if expected.rounds < 0:
        return "no number of rounds would settle it there: too little is known of the pad's biases and survey"
    if policy.height_required and height_rounds(commissioning, policy, east, north, up, bias_left=left) < 0:
        return "the policy demands a proven height, and the pad's anchors do not tell it there"
    if policy.min_assurance >= TIMED_ASSURANCE:
        frames = frames_needed(commissioning, policy, east, north, up)
        if frames == 0:
            return (
                f"the policy demands assurance {policy.min_assurance}, and the pad's nodes share no commissioned clock"
            )
        if frames < 0:
            return f"the policy demands assurance {policy.min_assurance}, and time stamps prove too little there"
    return ""
