"""Step 7 in words and consequences: what the pad's time stamps, and those of a witness, add to a verdict.

The pad's own (``judge_time_stamps``) are held against its ranges; the witness is a second pad, of which nothing but
its own survey, clocks and time stamps is believed (``judge_testimony``). Each has to prove the claim by itself: so
neither pad alone can bring about assurance 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.differences import MIN_FRAMES, Stamped, Timed, halved, judge_times, stamped
from wonderland.proofs.drone_clock import Clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.judgement import Measured, ppm
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reasons import Reasons, milli, nearest, reason
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim, Session, Testimony, TimeStamps
from wonderland.proofs.records.verdicts import Covariance, Judgement, TimeDifferences

TIMED_LEVEL: Final = 3
WITNESSED_LEVEL: Final = 4
_LARGEST_COVARIANCE: Final = float(2**52)


@dataclass(frozen=True, slots=True)
class WitnessBrought:
    """A witness's testimony, with the survey of its pad that it rests on."""

    testimony: Testimony
    commissioning: Commissioning


@dataclass(frozen=True, slots=True)
class TimeFinding:
    """What one pad's time stamps add."""

    record: TimeDifferences | None
    timed: Timed | None
    bound: bool
    """Whether the frames are tied to the session."""
    possible: bool
    """Whether the pad has a common clock at all, so that more frames may help."""
    level: int
    who: str
    suspects: tuple[str, ...] = ()
    """Names of the anchors whose clock may be off."""
    means: Stamped | None = None
    """What the time stamps come to, about the mean claimed place."""

    @property
    def proved_inside(self) -> bool:
        """The time stamps alone prove the drone within the buffer of its claim."""
        timed = self.timed
        return timed is not None and timed.finding == "inside" and timed.agrees and self.bound

    @property
    def earned(self) -> int:
        """1 where they earn the level: a proof either way, from frames of this session."""
        decided = self.timed is not None and self.timed.finding == "outside" and self.bound
        return int(self.proved_inside or decided)

    @property
    def may_refute(self) -> bool:
        """Whether they could refute, and so share the error for refuting with the ranges."""
        return self.timed is not None and self.bound and self.timed.finding != "inconsistent"

    @property
    def wanted(self) -> int:
        """Further frames that may earn the level; 0 where none would, or it is earned."""
        if self.earned or not self.possible:
            return 0
        if self.timed is None:
            return MIN_FRAMES
        return max(self.timed.more_frames, 0) if self.timed.finding == "vague" and self.bound else 0

    def say(self, demanded: int, reasons: Reasons) -> bool:
        """Give the reasons; True where they keep the claim from being verified at any level."""
        timed = self.timed
        if timed is None or self.record is None:
            if demanded >= self.level:
                reasons.add("no_time_stamps" if self.level == TIMED_LEVEL else "no_witness")
            return False
        prefix = "time_differences" if self.level == TIMED_LEVEL else "witness"
        if not self.bound:
            reasons.add(f"{prefix}_unbound")
            return False
        if timed.finding == "inconsistent":
            reasons.add(f"{prefix}_inconsistent", chi2_milli=milli(timed.chi2), limit_milli=milli(timed.limit))
            if self.suspects:
                whose = "pad" if self.level == TIMED_LEVEL else "witness"
                names = ", ".join(self.suspects)
                reasons.add("clock_suspected", stamps_of=whose, anchor_ids=names, anchors=len(self.suspects))
            return False
        if not timed.agrees:
            reasons.add(f"{prefix}_disagree")
            return True
        if timed.finding == "vague" and timed.covariance is not None:
            sigma = nearest(timed.covariance.ellipse().s1)
            reasons.add(f"{prefix}_vague", frames=timed.frames, sigma_mm=sigma, more_frames=timed.more_frames)
        elif timed.finding == "inside":
            reasons.add(f"{prefix}_prove", frames=timed.frames)
        elif timed.finding == "outside" and self.level == WITNESSED_LEVEL:
            significance = milli(timed.significance)
            reasons.add("witness_contradicts", frames=timed.frames, significance_milli=significance)
        return timed.finding == "outside"

    @property
    def excludes(self) -> bool:
        """Whether they exclude every place in the buffer, whatever the two-way ranges say."""
        return self.timed is not None and self.bound and self.timed.finding == "outside"

    def overrule(self, signed: Judgement, *, may_refute: bool) -> Judgement:
        """The judgement of the signed claim, with what the time stamps prove against the drone or for it."""
        timed = self.timed
        if timed is None or not self.bound:
            return signed
        if self.excludes and may_refute:
            excluded = reason("time_differences_contradict", significance_milli=milli(timed.significance))
            return replace(signed, outcome="refuted", reasons=(*signed.reasons, excluded))
        if timed.finding == "inside" and signed.outcome == "refuted":
            contradiction = reason("measurements_contradict")
            return replace(signed, outcome="inconclusive", reasons=(*signed.reasons, contradiction))
        return signed


def judge_time_stamps(
    pad_id: str,
    stamps: TimeStamps | None,
    commissioning: Commissioning,
    path: ClaimedPath | None,
    policy: Policy,
    measured: Measured | None,
    clock: Clock,
) -> TimeFinding:
    """The pad's own time stamps against the claim and against its ranges.

    ``policy``: with the part of the error for refuting that these have (``halved``).
    """
    ranged = None
    if measured is not None and measured.agreement.usable:
        offset, reduced = measured.offset, measured.reduced
        ranged = (reduced.east + offset.east, reduced.north + offset.north, offset.covariance)
    bound = stamps is not None and stamps.bound_by == "challenge"
    return _finding(pad_id, stamps, commissioning, path, policy, ranged, clock, TIMED_LEVEL, "The pad", bound=bound)


def judge_testimony(
    witness: WitnessBrought | None, session: Session, claims: Sequence[Claim], clock: Clock
) -> TimeFinding:
    """The witness's time stamps against the claim, in its own frame. Only frames of the session's time count."""
    if witness is None:
        return TimeFinding(None, None, bound=False, possible=False, level=WITNESSED_LEVEL, who="The witness")
    try:
        path = ClaimedPath(witness.commissioning.frame, claims)
    except GeometryError:
        path = None
    stamps, radio = witness.testimony.time_stamps, witness.testimony.radio
    policy, skew_ms = halved(session.policy), session.policy.max_clock_skew_ms
    fresh = session.requested_ms - skew_ms <= stamps.start_ms and stamps.end_ms <= session.expires_ms + skew_ms
    bound = (
        fresh and stamps.bound_by in {"challenge", "key"} and radio.sts == "provisioned" and radio.measured_by == "pad"
    )
    return _finding(
        witness.testimony.pad_id,
        stamps,
        witness.commissioning,
        path,
        policy,
        None,
        clock,
        WITNESSED_LEVEL,
        "The witness",
        bound=bound,
    )


def _finding(
    pad_id: str,
    stamps: TimeStamps | None,
    commissioning: Commissioning,
    path: ClaimedPath | None,
    policy: Policy,
    ranged: tuple[float, float, Matrix2] | None,
    clock: Clock,
    level: int,
    who: str,
    *,
    bound: bool,
) -> TimeFinding:
    possible = commissioning.timestamp_sigma_mm is not None
    means = stamped(stamps, commissioning, path) if stamps is not None and path is not None else None
    if means is None:
        return TimeFinding(None, None, bound=bound, possible=possible, level=level, who=who)
    timed = judge_times(means, policy, ranged, clock.sigma_ms)
    record = TimeDifferences(
        pad_id=pad_id,
        frames=timed.frames,
        finding=timed.finding,
        agrees=timed.agrees,
        more_frames=timed.more_frames,
        error_mm=min(int(timed.error + 0.5), 100_000_000),
        likelihood_ppm=ppm(timed.likelihood),
        covariance=_covariance(timed.covariance) if timed.covariance is not None else None,
        chi2_milli=milli(timed.chi2),
    )
    suspects = tuple(commissioning.anchors[index].anchor_id for index in timed.suspects)
    return TimeFinding(
        record, timed, bound=bound, possible=possible, level=level, who=who, suspects=suspects, means=means
    )


def _covariance(matrix: Matrix2) -> Covariance:
    limit = _LARGEST_COVARIANCE
    ee, en, nn = (nearest(max(-limit, min(limit, value))) for value in (matrix.ee, matrix.en, matrix.nn))
    return Covariance(ee_mm2=ee, en_mm2=en, nn_mm2=nn)
