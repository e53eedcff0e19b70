"""The ten steps of the verdict, in the order of their numbers: each adds to the findings what it found.

A step is a function of the case, which nothing changes, and of what the steps before it found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Final

from wonderland.proofs.admission import (
    CHECKED_ANCHORS,
    clock_serves,
    confirmed_by_both,
    fresh,
    plausible,
    rounds_missing,
    usable_rounds,
)
from wonderland.proofs.agreement import agreement, excused
from wonderland.proofs.broadcast import Broadcast, judge_broadcast, outcome_with, unmeasured
from wonderland.proofs.calibrated import calibrated
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.differences import halved
from wonderland.proofs.drift import widened
from wonderland.proofs.drone_clock import Clock, drone_clock, on_the_pads_clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import solve
from wonderland.proofs.height_finding import hold_height, say_height
from wonderland.proofs.judgement import (
    STATED_ACCURACIES,
    Measured,
    hold_each_moment,
    judge,
    say_contradictions,
    say_outside,
    say_torn,
    say_unjudged,
)
from wonderland.proofs.leaving import judge_newest
from wonderland.proofs.moments import moments_of
from wonderland.proofs.one_claim import rests_on_one
from wonderland.proofs.reasons import Reasons, milli, reason
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim, Evidence, Session
from wonderland.proofs.records.verdicts import Judgement
from wonderland.proofs.reduction import loses_its_place, reduce, residuals_of
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.standing import standing_at
from wonderland.proofs.stopping import more_rounds
from wonderland.proofs.testimony import TimeFinding, WitnessBrought, judge_testimony, judge_time_stamps
from wonderland.proofs.travel import hope
from wonderland.proofs.vertical import Vertical, judge_vertical

BOUND_Z: Final = 2.83
"""Standard deviations with which ``within_mm`` holds."""
KEYED: Final = 2
"""Assurance of two-way ranges that the pad measured with a keyed time-stamp sequence."""
TIME_DIFFERENCES: Final = 3
"""From this assurance on a drone's own clock cannot make it appear farther away."""


@dataclass(frozen=True, slots=True)
class Case:
    """What is to be decided: nothing of it changes on the way."""

    session: Session
    commissioning: Commissioning
    """Of the pad, with the uncertainty that its drift added and the offset that the drone was calibrated to."""
    evidence: Evidence
    witness: WitnessBrought | None
    confirmed: bool
    signature_valid: bool | None
    now_ms: int
    clock: Clock
    """The drone's, against the pad's."""
    claims: tuple[Claim, ...]
    """The request's, then the session's, by the pad's clock."""
    excused: tuple[int, ...] | None = None
    """Ranges need not agree with one another (``uncorrected``): of which anchors each may be bad."""

    @property
    def policy(self) -> Policy:
        """That of the request."""
        return self.session.policy


@dataclass(slots=True)
class Findings:
    """What the steps have found; each fills in its own."""

    reasons: Reasons = field(default_factory=Reasons)
    blocked: bool = False
    """Nothing can be verified, whatever the ranges say."""
    rounds: UsableRounds | None = None
    whole: int = 0
    """Rounds in which every anchor measured."""
    told: ClaimedPath | None = None
    """What was claimed while it was ranged."""
    path: ClaimedPath | None = None
    """The same, with the flight from where it asked."""
    measured: Measured | None = None
    missing: int = 0
    """Whole rounds that lack, as many were attempted and did not come about; −1: more than the policy allows."""
    timed: TimeFinding | None = None
    seen: TimeFinding | None = None
    assurance: int = 0
    more_frames: int = 0
    signed: Judgement | None = None
    on_the_map: str = "inconclusive"
    """The outcome of the signed claim, its height left out."""
    height: Vertical | None = None
    public: Broadcast | None = None
    outcome: str = "inconclusive"
    more_rounds: int = -1

    def block(self, *, unless: bool) -> None:
        """Nothing can be verified, unless this holds."""
        self.blocked = self.blocked or not unless


def case_of(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    witness: WitnessBrought | None,
    *,
    confirmed: bool,
    signature_valid: bool | None,
    now_ms: int,
) -> Case:
    """The case, with the pad's drift and the drone's clock reckoned in."""
    commissioning = calibrated(commissioning, session.calibration)
    if evidence.drift_sigma_mm is not None:
        commissioning = widened(commissioning, evidence.drift_sigma_mm)
    clock = drone_clock(evidence.clock)
    claims = on_the_pads_clock((session.claim, *evidence.claims), clock)
    return Case(session, commissioning, evidence, witness, confirmed, signature_valid, now_ms, clock, claims)


def freshness(case: Case, found: Findings) -> None:
    """1. The times of rounds and claims belong to this session and do not run backwards."""
    if case.evidence.drift_sigma_mm is not None:
        found.reasons.add("pad_drifts", sigma_mm=case.evidence.drift_sigma_mm)
    drone = case.session.calibration
    if drone is not None:
        found.reasons.add("calibrated", offset_mm=drone.offset_mm, sigma_mm=drone.sigma_mm)
    found.block(unless=fresh(case.session, case.evidence, case.now_ms, found.reasons))


def confirmations(case: Case, found: Findings) -> None:
    """2. Both codes matched, and the drone's countersignature holds."""
    found.block(unless=confirmed_by_both(case.evidence, case.confirmed, case.signature_valid, found.reasons))


def rounds(case: Case, found: Findings) -> None:
    """3. The rounds that can be used: three anchors or more, plausible ranges, no obstruction."""
    found.rounds, found.whole = usable_rounds(case.evidence, case.commissioning, case.policy.min_rounds, found.reasons)


def claimed_path(case: Case, found: Findings) -> None:
    """4. The claims by themselves: near this pad, good enough, flown by something, on a clock that serves."""
    frame = case.commissioning.frame
    try:
        # The request's claim was made before any ranging: the flight from there is claimed, the place is not judged.
        found.told = ClaimedPath(frame, case.claims[1:]) if case.evidence.claims else None
        found.path = ClaimedPath(frame, case.claims[:1], found.told)
    except GeometryError:
        found.reasons.add("claim_far_away")
        return
    found.block(unless=plausible(found.path, case.policy, found.reasons))
    found.block(unless=clock_serves(case.clock, found.path, case.policy, found.reasons))


def measurement(case: Case, found: Findings) -> None:
    """5. Ranges, corrected by their anchors' bias, against the claimed path: the offset, and whether they agree."""
    if found.path is not None and found.rounds is not None:
        found.measured = _measure(case, found.rounds, found.path, found.reasons)


def _measure(case: Case, rounds: UsableRounds, path: ClaimedPath, reasons: Reasons) -> Measured | None:
    """Estimate, covariance, and whether the ranges agree with one another."""
    commissioning = case.commissioning
    reduced = reduce(rounds, commissioning, path, case.clock.sigma_ms)
    if reduced is None:
        say_torn(residuals_of(rounds, commissioning, path), reasons)
        reasons.add("no_estimate", lacking="anchors")
        return None
    offset = solve(reduced)
    if offset is None:
        reasons.add("no_estimate", lacking="geometry")
        return None
    standing = standing_at(reduced, path.points)
    if standing is not None:
        reduced = replace(reduced, moment=standing.claim, moment_spread=standing.spread)
    agreed = agreement(reduced, offset) if case.excused is None else excused(reduced, offset, case.excused)
    seen = reduced.residuals
    if seen is not None and any(loses_its_place(seen, suspect, commissioning) for suspect in agreed.suspects):
        agreed = replace(agreed, offsets=(), suspects=())  # nobody knows what the others would say
    measured = Measured(reduced, agreed, offset)
    if not agreed.consistent:
        reasons.add("ranges_inconsistent", chi2_milli=milli(agreed.chi2), limit_milli=milli(agreed.limit))
        if agreed.usable:
            names = [commissioning.anchors[index].anchor_id for index in agreed.suspects]
            reasons.add("anchor_suspected", anchor_ids=", ".join(names), anchors=len(names))
    if measured.offset.mirror is not None:
        reasons.add("mirror_ambiguity")
    if reduced.bursts:
        reasons.add("bursts", ranges=reduced.bursts)
    return measured


def selection(case: Case, found: Findings) -> None:
    """6. Of the rounds that were attempted enough came about whole: nobody chose among them."""
    found.missing = rounds_missing(case.evidence, found.whole, case.policy, found.reasons)


def time_stamps(case: Case, found: Findings) -> None:
    """7. Time stamps of the drone's frames, of this pad and of a witness: what they prove by themselves, and earn."""
    evidence, demanded = case.evidence, case.policy.min_assurance
    timed = judge_time_stamps(
        case.session.pad_id,
        evidence.time_stamps,
        case.commissioning,
        found.path,
        halved(case.policy),
        found.measured,
        case.clock,
    )
    seen = judge_testimony(case.witness, case.session, case.claims, case.clock)
    assurance = _assurance(evidence)
    if assurance == KEYED:
        assurance += timed.earned
        if timed.proved_inside:
            assurance += int(seen.proved_inside)
    found.block(unless=not (timed.say(demanded, found.reasons) or seen.say(demanded, found.reasons)))
    if assurance == 0:
        found.reasons.add("ranges_unbound", measured_by=evidence.radio.measured_by)
    if assurance < demanded:
        found.more_frames = 0 if found.blocked else max(timed.wanted, seen.wanted)
        found.reasons.add("assurance_too_low", assurance=assurance, min_assurance=demanded)
        found.blocked = True
    found.timed, found.seen, found.assurance = timed, seen, assurance


def _assurance(evidence: Evidence) -> int:
    """What the way of ranging can bear; 3 and 4 are earned by time differences and a second pad."""
    if evidence.radio.measured_by == "uav" or evidence.radio.sts == "unbound":
        return 0
    return KEYED if evidence.radio.sts == "provisioned" else 1


def signed_claim(case: Case, found: Findings) -> None:
    """8. The likelihood that the drone is within the buffer of what it signed: at every moment, lately, its height."""
    measured, path, timed, policy = found.measured, found.path, found.timed, case.policy
    if measured is None or path is None or timed is None:
        return
    told = found.told or path
    enough = _enough(case, found)
    checked = _checked(case.commissioning, measured, found.reasons)
    moments = moments_of(
        measured.reduced,
        measured.offset,
        told.points,
        float(policy.buffer_mm),
        max(float(policy.height_buffer_mm), STATED_ACCURACIES * path.height_accuracy_mm),
    )
    say_contradictions(moments, measured, found.reasons)
    say_unjudged(case.session.claim, measured, path, policy, found.reasons)
    say_outside(found.told.points if found.told is not None else (), measured, policy, found.reasons)
    may_refute = enough and moments.have_a_mean(float(policy.buffer_mm))
    judged = halved(policy) if timed.may_refute else policy
    agree = measured.agreement.usable and checked and found.missing == 0
    signed = judge(
        judged,
        case.commissioning,
        measured,
        (0.0, 0.0),
        may_verify=not found.blocked and agree and enough,
        may_refute=may_refute,
    )
    signed = hold_each_moment(signed, judged, case.commissioning, measured, moments)
    if found.rounds is not None:
        signed = judge_newest(
            signed,
            judged,
            case.commissioning,
            found.rounds,
            path,
            measured.reduced,
            case.clock.sigma_ms,
            may_refute=enough and not moments.leaping,
        )
    if signed.outcome == "refuted" and rests_on_one(
        case.claims, found.rounds, judged, case.commissioning, case.clock.sigma_ms
    ):
        signed = replace(signed, outcome="inconclusive", reasons=(*signed.reasons, reason("one_claim")))
    signed = timed.overrule(signed, may_refute=may_refute)
    stamps = timed.means if timed.bound else None
    found.height = judge_vertical(policy, measured, told.points, path.height_accuracy_mm, stamps)
    found.on_the_map = signed.outcome
    found.signed = hold_height(signed, found.height, policy, may_refute=may_refute)


def _enough(case: Case, found: Findings) -> bool:
    return found.rounds is not None and len(found.rounds.t_ms) >= case.policy.min_rounds


def _checked(commissioning: Commissioning, measured: Measured, reasons: Reasons) -> bool:
    """Whether nothing about the geometry forbids to verify."""
    if measured.offset.mirror is not None:
        return False
    anchors = measured.reduced.anchors
    if len(anchors) < CHECKED_ANCHORS <= len(commissioning.anchors):
        reasons.add("unchecked")
        return False
    return True


def broadcast(case: Case, found: Findings) -> None:
    """9. What was heard on Remote ID under the drone's serial number, by whomever it was sent."""
    if found.measured is None or found.path is None or found.timed is None:
        return
    public = judge_broadcast(
        case.session,
        case.commissioning,
        case.evidence,
        found.measured,
        found.path,
        rounds=found.rounds,
        clock=case.clock,
        attested=case.evidence.attested if case.signature_valid else (),
        may_refute=_enough(case, found),
    )
    found.public = unmeasured(public) if found.timed.excludes else public


def outcome(case: Case, found: Findings) -> None:
    """10. Verified, refuted or inconclusive; what would settle it, and what it does not mean."""
    policy, measured, signed, public = case.policy, found.measured, found.signed, found.public
    if signed is not None:
        found.reasons.items.extend(signed.reasons)
        found.outcome = (
            signed.outcome if public is None else outcome_with(signed.outcome, public, policy, found.reasons)
        )
    more = -1
    if found.outcome == "inconclusive" and measured is not None and signed is not None:
        only_public = public is not None and signed.outcome == "verified"
        more = public.more if public and only_public else _more(measured, case.commissioning, policy)
        if found.on_the_map == "verified" != signed.outcome:  # the height alone is open
            more = found.height.more if found.height is not None else -1
    if measured is not None:
        if found.outcome == "verified":
            say_height(found.height, policy, found.reasons)
        _limits(case, found.outcome, found.assurance, measured, more, found.reasons)
    if found.more_frames > 0 and more >= 0:
        more, found.blocked = max(more, found.more_frames), False
    if found.missing != 0 and more >= 0:
        more = max(more, found.missing) if found.missing > 0 else -1
    found.more_rounds = -1 if found.outcome != "inconclusive" or found.blocked else more


def _more(measured: Measured, commissioning: Commissioning, policy: Policy) -> int:
    """Rounds after which it may be settled, if the drone flies on as it does."""
    known = measured.reduced
    return more_rounds(measured.offset, known.rounds, policy, hope(known.bias_left, known.rounds, commissioning))


def _limits(case: Case, outcome: str, assurance: int, measured: Measured, more: int, reasons: Reasons) -> None:
    """What an outcome does not mean: said with it, so that nobody reads more into it."""
    if outcome == "inconclusive" and measured.agreement.usable and more < 0:
        reasons.add("cannot_settle")
    if outcome != "verified":
        return
    if 0 < assurance < TIME_DIFFERENCES:  # what nothing binds to the drone bounds nothing
        # Nor do anchors all around it help: with another height, one delay of all answers fits another place.
        reasons.add("upper_bound", within_mm=bound_mm(case, measured))


def bound_mm(case: Case, measured: Measured) -> int:
    """A bound that holds however much a drone delays its answers: within this distance of the pad's origin.

    A drone that falsifies its time stamps can shorten ranges as well; against that there are time differences.

    The least of the anchors' bounds; the second least where one anchor may be bad.
    """
    bounds = []
    # No calibration makes a bound smaller: it may be false.
    drone = case.session.calibration
    longer = float(max(drone.offset_mm, 0)) if drone is not None else 0.0
    installation = measured.reduced.installation_sigma_mm
    for mean in measured.reduced.anchors:
        anchor = case.commissioning.anchors[mean.index]
        away = sqrt(float(anchor.east_mm**2 + anchor.north_mm**2 + anchor.up_mm**2))
        deviation = sqrt(mean.white + mean.floor + installation * installation)
        bounds.append(mean.range_mm + longer + away + BOUND_Z * deviation)
    bounds.sort()
    return int(max(bounds[0 if measured.agreement.consistent else 1], 0.0)) + 1


STEPS: Final = (
    freshness,
    confirmations,
    rounds,
    claimed_path,
    measurement,
    selection,
    time_stamps,
    signed_claim,
    broadcast,
    outcome,
)
"""In the order of their numbers."""
