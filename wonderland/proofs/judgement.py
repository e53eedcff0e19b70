"""One claim, judged by what was measured: steps 9 and 10 of the verdict for the signed and for the broadcast claim."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import Offset, Reduced
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.likelihood import Matrix2, distance_to_disc, inside_disc
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import Judgement, Position, Reason
from wonderland.proofs.stopping import LOOK_INFLATION, LOOK_Z

NEAR_CLAIM_MS: Final = 3_000
"""How far a broadcast may lie from the signed claims in time and still be judged by them."""
SAME_TIME_MS: Final = 250
"""Within this the nearest signed claim stands for the moment of a broadcast."""
UNCLAIMED_SPEED_MM_MS: Final = 10
"""Between a broadcast and the signed claims a drone may have moved at this speed (10 m/s, one standard deviation)."""
BROADCAST_LATENCY_SIGMA_MS: Final = 300
"""Age of a position when it is heard: Remote ID sends once a second and stamps tenths."""
LARGEST: Final = 1e12
"""Figures beyond this are said as this: a text has to end somewhere."""


@dataclass
class Reasons:
    """Collects why, in the order of the steps."""

    items: list[Reason] = field(default_factory=list)

    def add(self, code: str, text: str) -> None:
        """One more reason; its text is cut to what a record holds."""
        self.items.append(Reason(code=code, text=text[:300]))


@dataclass(frozen=True, slots=True)
class Measured:
    """What the rounds say, before any claim is judged."""

    reduced: Reduced
    offset: Offset
    consistent: bool


def judge(
    session: Session,
    commissioning: Commissioning,
    measured: Measured,
    extra: Matrix2,
    shift: tuple[float, float],
    *,
    may_verify: bool,
    may_refute: bool,
) -> Judgement:
    """Steps 9 and 10 for one claim, which lies at ``shift`` from the signed one and adds ``extra`` uncertainty."""
    policy = session.policy
    radius = float(policy.buffer_mm)
    east, north = measured.offset.east - shift[0], measured.offset.north - shift[1]
    covariance = measured.offset.covariance + extra
    guarded = covariance.scaled(LOOK_INFLATION)
    likelihood_ppm = ppm(inside_disc(east, north, covariance, radius))
    guarded_ppm = ppm(inside_disc(east, north, guarded, radius))
    significance = distance_to_disc(east, north, covariance, radius)
    error = sqrt(east * east + north * north)
    reasons = Reasons()
    if guarded_ppm >= policy.verify_ppm:
        outcome = "verified" if may_verify else "inconclusive"
        if may_verify:
            reasons.add("within_buffer", f"Measured {metres(error)} from the claim, within {metres(radius)}.")
    elif guarded_ppm <= policy.refute_ppm and significance >= LOOK_Z:
        outcome = "refuted" if may_refute else "inconclusive"
        reasons.add(
            "outside_buffer",
            f"Measured {metres(error)} from the claim, outside {metres(radius)} by {decimal(significance)} σ.",
        )
        if not may_refute:
            reasons.add("cannot_refute", "Too few anchors, or too inconsistent ranges, to refute on.")
    else:
        outcome = "inconclusive"
        axes = covariance.ellipse()
        reasons.add(
            "undecided",
            f"Measured {metres(error)} from the claim, known to {metres(axes.s1)} (1σ): not settled yet.",
        )
    reduced = measured.reduced
    claim = place(commissioning, reduced.east + shift[0], reduced.north + shift[1], reduced.up)
    return Judgement(
        outcome=outcome,
        claim=claim,
        error_mm=min(int(error + 0.5), 100_000_000),
        likelihood_ppm=likelihood_ppm,
        paper_rule=error <= radius,
        reasons=tuple(reasons.items),
    )


def judge_broadcast(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    measured: Measured,
    path: ClaimedPath,
    *,
    may_refute: bool,
) -> Judgement | None:
    """The public claim: mean of (broadcast − signed claim) when it was heard; None where nothing was heard."""
    first_ms, last_ms = path.points[0].t_ms, path.points[-1].t_ms
    gaps = [max(first_ms - heard.t_ms, heard.t_ms - last_ms, 0) for heard in evidence.broadcast]
    nearest_ms = min(gaps, default=NEAR_CLAIM_MS + 1)
    if nearest_ms > NEAR_CLAIM_MS:
        return None
    # Those heard while claims were signed; where there are none, the nearest alone, and it may have moved since.
    reach_ms = max(nearest_ms, SAME_TIME_MS)
    moved_mm = float(nearest_ms * UNCLAIMED_SPEED_MM_MS) if nearest_ms > SAME_TIME_MS else 0.0
    east = north = speed = 0.0
    count = 0
    for heard, gap_ms in zip(evidence.broadcast, gaps, strict=True):
        claimed = path.at(heard.t_ms) or path.points[0 if heard.t_ms < first_ms else -1]
        if gap_ms > reach_ms:
            continue
        height = heard.height_mm if heard.height_mm is not None else session.claim.height_mm
        try:
            x, y, _ = to_local(commissioning.frame, heard.lat_e7, heard.lon_e7, height)
        except GeometryError:
            x, y = 100_000_000, 0  # broadcast from elsewhere: as far off as the records can say
        east += x - claimed.east
        north += y - claimed.north
        later = path.at(heard.t_ms + 500)
        if later is not None:
            dx, dy = later.east - claimed.east, later.north - claimed.north
            speed += sqrt(dx * dx + dy * dy) / 500
        count += 1
    latency = BROADCAST_LATENCY_SIGMA_MS * speed / count
    limit = 50_000_000.0
    shift = (max(-limit, min(limit, east / count)), max(-limit, min(limit, north / count)))
    variance = latency * latency + moved_mm * moved_mm
    extra = Matrix2(variance, 0.0, variance)
    return judge(session, commissioning, measured, extra, shift, may_verify=measured.consistent, may_refute=may_refute)


def place(commissioning: Commissioning, east: float, north: float, up: float) -> Position:
    """A point of the pad's frame as a record; beyond the frame's reach its globe position is the frame's edge."""
    limit = 19_999_999.0
    east, north, up = (max(-limit, min(limit, value)) for value in (east, north, up))
    e, n, u = (rounded(value) for value in (east, north, up))
    lat_e7, lon_e7, height_mm = to_wgs84(commissioning.frame, e, n, u)
    return Position(
        east_mm=e,
        north_mm=n,
        up_mm=u,
        lat_e7=max(-900_000_000, min(900_000_000, lat_e7)),
        lon_e7=lon_e7,
        height_mm=max(-1_000_000, min(50_000_000, height_mm)),
    )


def rounded(value: float) -> int:
    """The nearest integer, halves away from zero."""
    return int(value + 0.5) if value >= 0.0 else -int(0.5 - value)


def ppm(probability: float) -> int:
    """Rounded down: 0.99 must have been reached."""
    return max(0, min(1_000_000, int(probability * 1e6)))


def decimal(value: float) -> str:
    """One decimal, by integers: formatting of floats stays out of what endorsers compare."""
    tenths = int(min(value, LARGEST) * 10.0 + 0.5)
    return f"{tenths // 10}.{tenths % 10}"


def metres(millimetres: float) -> str:
    """Metres with two decimals."""
    centimetres = int(millimetres / 10.0 + 0.5)
    return f"{centimetres // 100}.{centimetres % 100:02d} m"
