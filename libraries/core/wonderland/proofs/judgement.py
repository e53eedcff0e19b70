"""One claim, judged by what was measured: part of step 8 of the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.agreement import REFUTING_ANCHORS, Agreement
from wonderland.proofs.claims import ClaimedPath, LocalClaim
from wonderland.proofs.estimate import Offset, least_chi2_within
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.likelihood import Matrix2, distance_to_disc, inside_disc
from wonderland.proofs.moments import EDGE_MS, Moments
from wonderland.proofs.reasons import Reasons, milli, nearest, reason
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim
from wonderland.proofs.records.verdicts import Judgement, Position
from wonderland.proofs.reduction import Reduced, Residuals, distance, said_at
from wonderland.proofs.stopping import proved_outside, sides, step_of

STATED_ACCURACIES: Final = 2.0
"""A claimed height may be off by so many of the accuracies (95 %) that it states."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What the rounds say, before any claim is judged."""

    reduced: Reduced
    agreement: Agreement
    whole: Offset
    """The fit of all anchors, whether they agree or not."""

    @property
    def offset(self) -> Offset:
        """The best estimate: of all anchors, or of the subset that agrees best."""
        return self.agreement.offsets[0] if self.agreement.offsets else self.whole


def judge(
    policy: Policy,
    commissioning: Commissioning,
    measured: Measured,
    shift: tuple[float, float],
    *,
    may_verify: bool,
    may_refute: bool,
) -> Judgement:
    """Step 8 for one claim, which lies at ``shift`` (mm) from the signed one.

    Where one anchor is bad, every subset that may be the good one has to say the same.
    """
    offsets = measured.agreement.offsets or (measured.whole,)
    found = [compare(policy, measured.reduced, offset, shift) for offset in offsets]
    first = found[0]
    error = nearest(first.error)
    reasons = Reasons()
    outcome = "inconclusive"
    if all(one.inside for one in found):
        if may_verify:
            outcome = "verified"
            reasons.add("within_buffer", error_mm=error, buffer_mm=policy.buffer_mm)
    elif all(one.outside for one in found):
        significance = milli(first.significance)
        reasons.add("outside_buffer", error_mm=error, buffer_mm=policy.buffer_mm, significance_milli=significance)
        if may_refute and measured.agreement.usable and measured.agreement.anchors >= REFUTING_ANCHORS:
            outcome = "refuted"
        else:
            reasons.add("cannot_refute")
    else:
        axes = offsets[0].covariance.ellipse()
        reasons.add("undecided", error_mm=error, sigma_mm=nearest(axes.s1))
    said = said_at(measured.reduced)
    claim = place(commissioning, said.east + shift[0], said.north + shift[1], said.up)
    return Judgement(
        outcome=outcome,
        claim=claim,
        error_mm=min(int(first.error + 0.5), 100_000_000),
        likelihood_ppm=first.likelihood_ppm,
        paper_rule=first.error <= policy.buffer_mm,
        reasons=tuple(reasons.items),
    )


def say_torn(seen: Residuals | None, reasons: Reasons) -> None:
    """Rounds that contradict what was claimed in the others, or do not know their place, if there are any."""
    if seen is not None and seen.torn:
        reasons.add("claims_torn", torn=seen.torn, rounds=len(seen.claimed.kept))
    if seen is not None and seen.vague:
        reasons.add("rounds_vague", rounds=seen.vague)


def say_contradictions(moments: Moments, measured: Measured, reasons: Reasons) -> None:
    """Claimed moments that contradict one another, said where they matter."""
    say_torn(measured.reduced.residuals, reasons)
    if moments.unseen_share > 0.0:
        reasons.add("claims_unseen", share_percent=nearest(moments.unseen_share * 100.0))


def hold_each_moment(
    signed: Judgement, policy: Policy, commissioning: Commissioning, measured: Measured, moments: Moments
) -> Judgement:
    """A mean that holds is verified only where no quarter of the claimed moments can be two buffers off."""
    reach = int(moments.reach_mm(float(policy.buffer_mm)))
    if signed.outcome != "verified" or reach >= policy.buffer_mm:
        return signed
    if reach > 0:
        narrow = replace(policy, buffer_mm=reach)
        again = judge(narrow, commissioning, measured, (0.0, 0.0), may_verify=True, may_refute=False)
        if again.outcome == "verified":
            return signed
    wavers = reason("claims_waver", waver_mm=nearest(moments.waver_mm))
    return replace(signed, outcome="inconclusive", reasons=(*signed.reasons, wavers))


def say_unjudged(request: Claim, measured: Measured, path: ClaimedPath, policy: Policy, reasons: Reasons) -> None:
    """The place that the request named is said to be unjudged where it is another than the one that was ranged."""
    first = path.points[0]
    reduced = measured.reduced
    away = distance(first.east - reduced.east, first.north - reduced.north, 0.0)
    climb = abs(first.up - reduced.up)
    if climb > max(policy.height_buffer_mm, STATED_ACCURACIES * path.height_accuracy_mm):
        away = distance(away, climb, 0.0)
    if away > policy.buffer_mm:
        before = nearest(max(reduced.t_ms - request.t_ms, 0.0))
        reasons.add("request_unjudged", away_mm=nearest(away), before_ms=before)


def say_outside(claims: Sequence[LocalClaim], measured: Measured, policy: Policy, reasons: Reasons) -> None:
    """Claims of other times than the rounds' and of other places are said to be unjudged."""
    seen = measured.reduced.residuals
    if seen is None:
        return
    track = seen.claimed
    first_ms, last_ms = seen.span_ms
    count, farthest = 0, 0.0
    for claim in claims:
        edge = 0 if claim.t_ms < first_ms else -1
        if first_ms - EDGE_MS <= claim.t_ms <= last_ms + EDGE_MS:
            continue
        away = distance(claim.east - track.east[edge], claim.north - track.north[edge], claim.up - track.up[edge])
        if away > policy.buffer_mm:
            count, farthest = count + 1, max(farthest, away)
    if count:
        reasons.add("claims_unjudged", claims=count, away_mm=nearest(farthest))


@dataclass(frozen=True, slots=True)
class Comparison:
    """One estimate against one claim."""

    inside: bool
    outside: bool
    likelihood_ppm: int
    significance: float
    error: float


def compare(policy: Policy, reduced: Reduced, offset: Offset, shift: tuple[float, float]) -> Comparison:
    """One estimate against the claim at ``shift`` (mm)."""
    radius = float(policy.buffer_mm)
    east, north = offset.east - shift[0], offset.north - shift[1]
    covariance = offset.covariance
    bent_east, bent_north = straightened(reduced, offset, covariance, shift)
    likelihood_ppm = ppm(inside_disc(bent_east, bent_north, covariance, radius))
    step = step_of(covariance, offset.covariance + offset.floor.scaled(-1.0), reduced.rounds)
    proved = sides(bent_east, bent_north, covariance, policy, step)
    outside = proved.outside and likelihood_ppm <= policy.refute_ppm
    significance = proved.significance
    if outside and (bent_east, bent_north) != (east, north):
        # A refutation has to hold on the flat map too: the arc is an approximation where the ellipse is huge.
        significance = min(significance, distance_to_disc(east, north, covariance, radius))
        outside = proved_outside(significance, covariance.ellipse().s1, policy, step)
    if outside:
        # Nor may it rest on the bell: ranges hardly change beside a drone above the anchors, or far along an arc.
        worse = least_chi2_within(reduced, shift[0], shift[1], radius) - offset.chi2
        significance = min(significance, sqrt(worse) if worse > 0.0 else 0.0)
        outside = proved_outside(significance, covariance.ellipse().s1, policy, step)
    return Comparison(
        inside=proved.inside and likelihood_ppm >= policy.verify_ppm,
        outside=outside,
        likelihood_ppm=likelihood_ppm,
        significance=significance,
        error=sqrt(east * east + north * north),
    )


def straightened(
    reduced: Reduced, offset: Offset, covariance: Matrix2, shift: tuple[float, float]
) -> tuple[float, float]:
    """Offset of the estimate from the claim, on the arc about the anchors that a long ellipse really is.

    Far from a small pad the bearing is vague and the distance is not: the places that fit the ranges lie on an arc, and
    a straight ellipse misses it by s1²/2D. Where that is more than half of the short axis, the offset is taken in
    polar coordinates (distance, arc) about the anchors' middle; elsewhere it stays as it is.
    """
    east, north = offset.east - shift[0], offset.north - shift[1]
    count = len(reduced.anchors)
    middle_east = middle_north = 0.0
    for anchor in reduced.anchors:
        middle_east += anchor.east
        middle_north += anchor.north
    x = reduced.east + offset.east - middle_east / count
    y = reduced.north + offset.north - middle_north / count
    away = distance(x, y, 0.0)
    axes = covariance.ellipse()
    if away <= 0.0 or axes.s1 * axes.s1 <= away * axes.s2:
        return east, north
    ux, uy = x / away, y / away
    claim_x, claim_y = x - east, y - north
    claim_away = distance(claim_x, claim_y, 0.0)
    along = claim_x * ux + claim_y * uy
    if along <= 0.5 * claim_away:  # more than 60° away: no arc is a straight line's correction
        return east, north
    sine = (claim_y * ux - claim_x * uy) / claim_away
    arc = -away * _arcsine(sine)
    radial = away - claim_away
    return radial * ux - arc * uy, radial * uy + arc * ux


def _arcsine(x: float) -> float:
    """Arc sine to 1e-4 for |x| ≤ 0.87, by halving the angle once and its series."""
    half = x / sqrt(2.0 * (1.0 + sqrt((1.0 - x) * (1.0 + x))))
    square = half * half
    series = 1.0 + square * (1 / 6 + square * (3 / 40 + square * (15 / 336 + square * (105 / 3456 + square * 0.0224))))
    return 2.0 * half * series


def place(commissioning: Commissioning, east: float, north: float, up: float) -> Position:
    """A point of the pad's frame as a record; beyond the frame's reach its globe position is the frame's edge."""
    limit = 19_999_999.0
    east, north, up = (max(-limit, min(limit, value)) for value in (east, north, up))
    e, n, u = (nearest(value) for value in (east, north, up))
    lat_e7, lon_e7, height_mm = to_wgs84(commissioning.frame, e, n, u)
    return Position(
        east_mm=e,
        north_mm=n,
        up_mm=u,
        lat_e7=max(-900_000_000, min(900_000_000, lat_e7)),
        lon_e7=lon_e7,
        height_mm=max(-1_000_000, min(50_000_000, height_mm)),
    )


def ppm(probability: float) -> int:
    """Rounded down: 0.99 must have been reached."""
    return max(0, min(1_000_000, int(probability * 1e6)))
