"""The decision: ten steps, one function for each (``steps``), limits as named constants with their reason.

 1. freshness       times of rounds and claims belong to this session and do not run backwards
 2. confirmations   both codes matched; the drone's countersignature holds
 3. rounds          at least three anchors, plausible ranges, no obstruction
 4. claimed path    claims by themselves: near the pad, good enough, flown by something, on a clock that serves
 5. measurement     ranges, corrected for bias, against the claimed path: offset, covariance, whether they agree (χ²)
 6. selection       of the rounds that were attempted enough came about whole
 7. time stamps     of the drone's frames: agree with the ranges, alone prove the claim or refute it; the assurance
 8. signed claim    likelihood that the drone is within the buffer of it: at every moment, lately, and its height
 9. broadcast       what was heard under its serial number is a finding of its own
10. outcome         verified, refuted or inconclusive, and permission

Steps 1 to 4 and 6 rest on ``admission`` and ``claims``, 5 on ``reduction``, ``estimate`` and ``agreement``, 7 on
``differences`` and ``testimony``, 8 on ``judgement``, ``moments`` (every moment), ``leaving`` (the newest rounds alone)
and ``vertical``, 9 on ``broadcast``; what holds under repeated looks is in ``stopping``, what can be reached at all in
``prospects``, the drone's clock in ``drone_clock``, a drone that was calibrated in ``uncorrected``.
The verdict is about what the drone *signed*. Integers and exactly rounded operations only (``special``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from wonderland.proofs.drone_clock import Clock
from wonderland.proofs.height_finding import estimate, height_record
from wonderland.proofs.reasons import milli, nearest
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import DroneClock, Reason, Verdict
from wonderland.proofs.reduction import said_at
from wonderland.proofs.steps import STEPS, TIME_DIFFERENCES, Case, Findings, bound_mm, case_of
from wonderland.proofs.testimony import WitnessBrought
from wonderland.proofs.uncorrected import as_measured, hold_both


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
    case_with = partial(
        case_of,
        commissioning=commissioning,
        evidence=evidence,
        witness=witness,
        confirmed=confirmed,
        signature_valid=signature_valid,
        now_ms=now_ms,
    )
    case = case_with(session)
    found = _found(case)
    if session.calibration is not None:
        plain = as_measured(case, found, case_with(replace(session, calibration=None)))
        hold_both(found, _found(plain), case, session.calibration.offset_mm)
    measured, public = found.measured, found.public
    at, covariance, chi2_milli = (
        estimate(case.commissioning, measured, found.height) if measured is not None else (None,) * 3
    )
    return Verdict(
        session_id=session.session_id,
        pad_id=session.pad_id,
        uav_id=session.uav_id,
        action=session.action,
        outcome=found.outcome,
        permission="granted" if found.outcome == "verified" and not authorisation else "refused",
        authorised=not authorisation,
        assurance=found.assurance,
        rounds=len(found.rounds.t_ms) if found.rounds is not None else 0,
        buffer_mm=session.policy.buffer_mm,
        decided_ms=now_ms,
        evidence_sha256=evidence_sha256,
        reasons=(*found.reasons.items, *authorisation),
        more_rounds=found.more_rounds,
        signed=found.signed,
        broadcast=public.finding if public is not None else None,
        estimate=at,
        estimate_ms=said_at(measured.reduced).t_ms if measured is not None else None,
        covariance=covariance,
        height=height_record(found.height, measured),
        chi2_milli=chi2_milli,
        chi2_claim_milli=milli(measured.offset.chi2_claim) if measured is not None else None,
        within_mm=bound_mm(case, measured) if measured is not None and found.assurance else None,
        time_differences=found.timed.record if found.timed is not None else None,
        witness=found.seen.record if found.seen is not None else None,
        clock=_clock_record(case.clock),
    )


def _found(case: Case) -> Findings:
    """What the ten steps find."""
    found = Findings()
    for step in STEPS:
        step(case, found)
    return found


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


def _clock_record(clock: Clock) -> DroneClock | None:
    if clock.readings == 0:
        return None
    limit = 2**40
    offset_ms = max(-limit, min(limit, nearest(clock.offset_ms)))
    return DroneClock(offset_ms=offset_ms, sigma_ms=min(nearest(clock.sigma_ms), 2**31), readings=clock.readings)
