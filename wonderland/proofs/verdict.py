"""The decision, in numbered steps; one function for each, limits as named constants with their reason.

 1. freshness       times of rounds and claims belong to this session, and claims neither run backwards nor jump
 2. confirmations   both codes matched; the drone's countersignature holds
 3. usable rounds   at least three anchors, plausible ranges, no obstruction
 4. bias            each range is corrected by its anchor's calibration
 5. consistency     the ranges agree with one another (χ² about the estimate), all or without one bad anchor
 6. differences     of the time stamps of the drone's frames: agree with the ranges, alone prove the claim or refute it
 7. claim           residuals against the claimed path, which may move
 8. estimate        offset from the claim, with its covariance
 9. likelihood      that the drone is within the buffer of its claim
10. outcome         verified, refuted or inconclusive, and permission

Steps 1 to 3 are in ``admission``, 4 and 7 in ``reduction``, that 7 holds at every moment in ``moments``, 5 in
``agreement``, 6 in ``differences`` and ``testimony``, 8 in ``estimate``, 9 and 10 for one claim in ``judgement``, for
the newest rounds alone in ``leaving``, for what was heard on Remote ID in ``broadcast``, what holds under repeated
looks in ``stopping``, what can be reached at all in ``prospects``, the drone's clock in ``drone_clock``. The verdict is
about what the drone *signed*; what is broadcast under its serial number is a finding of its own. Integers and exactly
rounded operations only (``special``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
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
from wonderland.proofs.agreement import agreement
from wonderland.proofs.broadcast import Broadcast, judge_broadcast, outcome_with, unmeasured
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.differences import halved
from wonderland.proofs.drift import widened
from wonderland.proofs.drone_clock import Clock, drone_clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import solve
from wonderland.proofs.height_finding import estimate, height_record, hold_height, say_height
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
from wonderland.proofs.reasons import Reasons, milli, nearest
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim, Evidence, Session
from wonderland.proofs.records.verdicts import DroneClock, Judgement, Reason, Verdict
from wonderland.proofs.reduction import loses_its_place, reduce, residuals_of, said_at
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.stopping import more_rounds
from wonderland.proofs.testimony import WitnessBrought, judge_testimony, judge_time_stamps
from wonderland.proofs.travel import hope
from wonderland.proofs.vertical import Vertical, judge_vertical

BOUND_Z: Final = 2.83
"""Standard deviations with which ``within_mm`` holds."""
KEYED: Final = 2
"""Assurance of two-way ranges that the pad measured with a keyed time-stamp sequence."""
TIME_DIFFERENCES: Final = 3
"""From this assurance on a drone's own clock cannot make it appear farther away."""


def decide(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    *,
    confirmed: bool,
    signature_valid: bool | None,
    authorisation: Sequence[Reason],
    now_ms: int,
    evidence_sha256: str,
    witness: WitnessBrought | None = None,
) -> Verdict:
    """The verdict of a session.

    ``witness``: what the second pad brought, where the session names one and it did. ``confirmed``: both session codes
    matched. ``signature_valid``: the drone's countersignature, None where it gave
    none. ``authorisation``: reasons why the drone may not do what it asks, none where it may.
    """
    policy = session.policy
    reasons = Reasons()
    if evidence.drift_sigma_mm is not None:
        commissioning = widened(commissioning, evidence.drift_sigma_mm)
        reasons.add("pad_drifts", sigma_mm=evidence.drift_sigma_mm)
    clock = drone_clock(evidence.clock)
    claims = on_the_pads_clock((session.claim, *evidence.claims), clock)
    blocked = not fresh(session, evidence, now_ms, reasons)  # 1
    blocked = not confirmed_by_both(evidence, confirmed, signature_valid, reasons) or blocked  # 2
    rounds, whole = usable_rounds(evidence, commissioning, policy.min_rounds, reasons)  # 3
    measured: Measured | None = None
    path: ClaimedPath | None = None
    told: ClaimedPath | None = None
    try:
        # The request's claim was made before any ranging: the flight from there is claimed, the place is not judged.
        told = ClaimedPath(commissioning.frame, claims[1:]) if evidence.claims else None
        path = ClaimedPath(commissioning.frame, claims[:1], told)
    except GeometryError:
        reasons.add("claim_far_away")
    if path is not None:
        blocked = not plausible(path, policy, reasons) or blocked
        blocked = not clock_serves(clock, path, policy, reasons) or blocked
    if path is not None and rounds is not None:
        measured = _measure(rounds, commissioning, path, clock, reasons)  # 4, 5, 7, 8
    missing = rounds_missing(evidence, whole, policy, reasons)  # 3
    enough = rounds is not None and len(rounds.t_ms) >= policy.min_rounds
    shared = halved(policy)
    timed = judge_time_stamps(session.pad_id, evidence.time_stamps, commissioning, path, shared, measured, clock)  # 6
    seen = judge_testimony(witness, session, claims, clock)
    assurance = _assurance(evidence)
    if assurance == KEYED:
        assurance += timed.earned
        if timed.proved_inside:
            assurance += int(seen.proved_inside)
    blocked = timed.say(policy.min_assurance, reasons) or seen.say(policy.min_assurance, reasons) or blocked
    more_frames = max(timed.wanted, seen.wanted) if assurance < policy.min_assurance and not blocked else 0
    if assurance < policy.min_assurance:
        reasons.add("assurance_too_low", assurance=assurance, min_assurance=policy.min_assurance)
        blocked = True

    signed: Judgement | None = None
    public: Broadcast | None = None
    height: Vertical | None = None
    on_the_map = "inconclusive"
    more = -1
    if measured is not None and path is not None:
        checked = _checked(commissioning, measured, reasons)
        moments = moments_of(
            measured.reduced,
            measured.offset,
            (told or path).points,
            float(policy.buffer_mm),
            max(float(policy.height_buffer_mm), STATED_ACCURACIES * path.height_accuracy_mm),
        )
        say_contradictions(moments, measured, reasons)
        say_unjudged(session.claim, measured, path, policy, reasons)
        say_outside(told.points if told is not None else (), measured, policy, reasons)
        may_refute = enough and moments.have_a_mean(float(policy.buffer_mm))
        judged = shared if timed.may_refute else policy
        signed = judge(
            judged,
            commissioning,
            measured,
            (0.0, 0.0),
            may_verify=not blocked and missing == 0 and measured.agreement.usable and enough and checked,
            may_refute=may_refute,
        )  # 9, 10
        signed = hold_each_moment(signed, judged, commissioning, measured, moments)
        if rounds is not None:
            signed = judge_newest(
                signed,
                judged,
                commissioning,
                rounds,
                path,
                measured.reduced,
                clock.sigma_ms,
                may_refute=enough and not moments.leaping,
            )
        signed = timed.overrule(signed, may_refute=may_refute)
        height = judge_vertical(
            policy, measured, (told or path).points, path.height_accuracy_mm, timed.means if timed.bound else None
        )
        on_the_map = signed.outcome
        signed = hold_height(signed, height, policy, may_refute=may_refute)
        public = judge_broadcast(
            session,
            commissioning,
            evidence,
            measured,
            path,
            rounds=rounds,
            clock=clock,
            attested=evidence.attested if signature_valid else (),
            may_refute=enough,
        )
        if timed.excludes:
            public = unmeasured(public)
    outcome = _outcome(signed, public, policy, reasons)
    if outcome == "inconclusive" and measured is not None and signed is not None:
        only_public = public is not None and signed.outcome == "verified"
        more = public.more if public and only_public else _more(measured, commissioning, policy)
        if on_the_map == "verified" != signed.outcome:  # the height alone is open
            more = height.more if height is not None else -1
    if measured is not None:
        if outcome == "verified":
            say_height(height, policy, reasons)
        _limits(outcome, assurance, commissioning, measured, more, reasons)
    if more_frames > 0 and more >= 0:
        more, blocked = max(more, more_frames), False
    if missing != 0 and more >= 0:
        more = max(more, missing) if missing > 0 else -1
    authorised = not authorisation
    reasons.items.extend(authorisation)
    granted = outcome == "verified" and authorised
    where, covariance, chi2_milli = estimate(commissioning, measured, height) if measured is not None else (None,) * 3
    return Verdict(
        session_id=session.session_id,
        pad_id=session.pad_id,
        uav_id=session.uav_id,
        action=session.action,
        outcome=outcome,
        permission="granted" if granted else "refused",
        authorised=authorised,
        assurance=assurance,
        rounds=len(rounds.t_ms) if rounds is not None else 0,
        buffer_mm=policy.buffer_mm,
        decided_ms=now_ms,
        evidence_sha256=evidence_sha256,
        reasons=tuple(reasons.items),
        more_rounds=-1 if outcome != "inconclusive" or blocked else more,
        signed=signed,
        broadcast=public.finding if public is not None else None,
        estimate=where,
        estimate_ms=said_at(measured.reduced).t_ms if measured is not None else None,
        covariance=covariance,
        height=height_record(height, measured),
        chi2_milli=chi2_milli,
        chi2_claim_milli=milli(measured.offset.chi2_claim) if measured is not None else None,
        within_mm=_within(measured, commissioning) if measured is not None else None,
        time_differences=timed.record,
        witness=seen.record,
        clock=_clock_record(clock),
    )


def preview(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    now_ms: int,
    witness: WitnessBrought | None = None,
) -> Verdict:
    """The pad's look while it ranges: the decision were the drone to countersign and to be authorised.

    A witness that the session names and that has not testified yet is counted on.
    """
    policy = session.policy
    if witness is None and session.witness is not None and policy.min_assurance > TIME_DIFFERENCES:
        session = replace(session, policy=replace(policy, min_assurance=TIME_DIFFERENCES))
    return decide(
        session,
        commissioning,
        evidence,
        confirmed=evidence.matched == "both",
        signature_valid=True,
        authorisation=(),
        now_ms=now_ms,
        evidence_sha256="0" * 64,
        witness=witness,
    )


def on_the_pads_clock(claims: Sequence[Claim], clock: Clock) -> tuple[Claim, ...]:
    """The claims with the times that they have by the pad's clock."""
    offset_ms = nearest(clock.offset_ms)
    if offset_ms == 0:
        return tuple(claims)
    return tuple(replace(claim, t_ms=max(claim.t_ms - offset_ms, 0)) for claim in claims)


def _clock_record(clock: Clock) -> DroneClock | None:
    if clock.readings == 0:
        return None
    limit = 2**40
    offset_ms = max(-limit, min(limit, nearest(clock.offset_ms)))
    return DroneClock(offset_ms=offset_ms, sigma_ms=min(nearest(clock.sigma_ms), 2**31), readings=clock.readings)


def _assurance(evidence: Evidence) -> int:
    """What the way of ranging can bear; 3 and 4 are earned by time differences and a second pad."""
    if evidence.radio.measured_by == "uav":
        return 0
    return KEYED if evidence.radio.sts == "provisioned" else 1


def _measure(
    rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath, clock: Clock, reasons: Reasons
) -> Measured | None:
    """Steps 4 to 8: estimate, covariance, and whether the ranges agree with one another."""
    reduced = reduce(rounds, commissioning, path, clock.sigma_ms)
    if reduced is None:
        say_torn(residuals_of(rounds, commissioning, path), reasons)
        reasons.add("no_estimate", lacking="anchors")
        return None
    offset = solve(reduced)
    if offset is None:
        reasons.add("no_estimate", lacking="geometry")
        return None
    agreed = agreement(reduced, offset)
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


def _checked(commissioning: Commissioning, measured: Measured, reasons: Reasons) -> bool:
    """Whether nothing about the geometry forbids to verify."""
    if measured.offset.mirror is not None:
        return False
    anchors = measured.reduced.anchors
    if len(anchors) < CHECKED_ANCHORS <= len(commissioning.anchors):
        reasons.add("unchecked")
        return False
    return True


def _more(measured: Measured, commissioning: Commissioning, policy: Policy) -> int:
    """Rounds after which it may be settled, if the drone flies on as it does."""
    known = measured.reduced
    return more_rounds(measured.offset, known.rounds, policy, hope(known.bias_left, known.rounds, commissioning))


def _limits(
    outcome: str, assurance: int, commissioning: Commissioning, measured: Measured, more: int, reasons: Reasons
) -> None:
    """What an outcome does not mean: said with it, so that nobody reads more into it."""
    if outcome == "inconclusive" and measured.agreement.usable and more < 0:
        reasons.add("cannot_settle")
    if outcome != "verified":
        return
    if assurance < TIME_DIFFERENCES:
        # Nor do anchors all around it help: with another height, one delay of all answers fits another place.
        reasons.add("upper_bound", within_mm=_within(measured, commissioning))


def _outcome(signed: Judgement | None, public: Broadcast | None, policy: Policy, reasons: Reasons) -> str:
    """Step 10: the signed claim decides; what was heard on Remote ID bears on it as the policy says."""
    if signed is None:
        return "inconclusive"
    reasons.items.extend(signed.reasons)
    return signed.outcome if public is None else outcome_with(signed.outcome, public, policy, reasons)


def _within(measured: Measured, commissioning: Commissioning) -> int:
    """A bound that holds however much a drone delays its answers: within this distance of the pad's origin.

    A drone that falsifies its time stamps can shorten ranges as well; against that there are time differences.

    The least of the anchors' bounds; the second least where one anchor may be bad.
    """
    bounds = []
    installation = measured.reduced.installation_sigma_mm
    for mean in measured.reduced.anchors:
        anchor = commissioning.anchors[mean.index]
        away = sqrt(float(anchor.east_mm**2 + anchor.north_mm**2 + anchor.up_mm**2))
        deviation = sqrt(mean.white + mean.floor + installation * installation)
        bounds.append(mean.range_mm + away + BOUND_Z * deviation)
    bounds.sort()
    return int(max(bounds[0 if measured.agreement.consistent else 1], 0.0)) + 1
