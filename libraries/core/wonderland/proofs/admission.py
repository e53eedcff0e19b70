"""What is asked of evidence before any position is solved: steps 1 to 4 and 6 of the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.drone_clock import EXCUSED_SHARE, Clock
from wonderland.proofs.reasons import Reasons, nearest
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import NO_RANGE, Evidence, Session
from wonderland.proofs.rounds import UsableRounds, usable

MAX_HEIGHT_ACCURACY_MM: Final = 20_000
"""A claimed height vaguer than this proves nothing either."""
CHECKED_ANCHORS: Final = 4
"""Three anchors agree with some place whatever they measure."""
MOST_ATTEMPTS: Final = 2
"""Rounds attempted for each whole one. A drone that lets only those through whose noise suits its claim needs many: the
better one of two moves the mean by half a standard deviation, which wins nothing on a lie of 1.5 buffers or more even
at the paper's pad (``dropped-rounds-half`` of the attack lab), the best of forty by more than two. An honest channel
that loses a third of its rounds passes; one that loses half is not fit to prove anything on."""


def fresh(session: Session, evidence: Evidence, now_ms: int, reasons: Reasons) -> bool:
    """Step 1: rounds and claims lie between the request and now, give or take the tolerated skew."""
    skew = session.policy.max_clock_skew_ms
    earliest = session.requested_ms - skew
    latest = min(now_ms, session.expires_ms) + skew
    fresh = True
    times = evidence.ranges.t_ms
    ordered = sorted(times)
    if ordered and not earliest <= ordered[0] <= ordered[-1] <= latest:
        reasons.add("rounds_not_fresh")
        fresh = False
    stamps = evidence.time_stamps
    if stamps is not None and not (earliest <= stamps.start_ms and stamps.end_ms <= latest):
        reasons.add("frames_not_fresh")
        fresh = False
    claimed = [claim.t_ms for claim in evidence.claims]
    in_order = sorted(claimed)
    if in_order and not earliest <= in_order[0] <= in_order[-1] <= latest:
        reasons.add("claims_not_fresh")
        fresh = False
    if claimed != in_order:
        reasons.add("claims_go_back")
        fresh = False
    if list(times) != ordered:
        reasons.add("time_goes_back")
        fresh = False
    return fresh


def plausible(path: ClaimedPath, policy: Policy, reasons: Reasons) -> bool:
    """Step 4, the claims by themselves: a vague claim buys nothing, and a drone flies from one to the next."""
    plausible = True
    if path.accuracy_mm > policy.max_claim_accuracy_mm:
        reasons.add("claim_vague", accuracy_mm=nearest(path.accuracy_mm))
        plausible = False
    if path.height_accuracy_mm > MAX_HEIGHT_ACCURACY_MM:
        reasons.add("claim_height_vague", accuracy_mm=nearest(path.height_accuracy_mm))
        plausible = False
    jump = path.jump_mm()
    if jump > 0.0:
        reasons.add("claims_jump", jump_mm=nearest(jump))
        plausible = False
    return plausible


def confirmed_by_both(evidence: Evidence, confirmed: bool, signature_valid: bool | None, reasons: Reasons) -> bool:
    """Step 2: without both codes and the drone's countersignature nothing can be verified."""
    if not confirmed:
        reasons.add("codes_not_matched")
    if signature_valid is None:
        reasons.add("not_countersigned")
    elif not signature_valid:
        reasons.add("countersignature_invalid")
    if evidence.failure is not None:
        reasons.add("session_stopped", failure=evidence.failure)
    return confirmed and signature_valid is True


def clock_serves(clock: Clock, path: ClaimedPath, policy: Policy, reasons: Reasons) -> bool:
    """Step 4: the drone's clock may be wrong only as far as that hardly moves its claim."""
    if clock.contradictory:
        reasons.add("clock_contradicts")
        return False
    if clock.beyond_ms <= 0.0:
        return True
    off = path.mean_speed() * clock.beyond_ms
    if off > EXCUSED_SHARE * policy.buffer_mm:
        reasons.add("clock_off", off_ms=nearest(clock.beyond_ms), away_mm=nearest(off))
        return False
    return True


def usable_rounds(
    evidence: Evidence, commissioning: Commissioning, min_rounds: int, reasons: Reasons
) -> tuple[UsableRounds | None, int]:
    """Step 3: the rounds that the verdict may rest on, and how many of them are whole."""
    anchor_ids = [anchor.anchor_id for anchor in commissioning.anchors]
    rounds = usable(evidence.ranges, anchor_ids, commissioning.max_range_mm)
    count = len(rounds.t_ms)
    if count < min_rounds:
        reasons.add("too_few_rounds", rounds=count, min_rounds=min_rounds)
    if rounds.obstructed:
        reasons.add("obstructed", ranges=rounds.obstructed)
    strangers = sum(1 for column in evidence.ranges.anchors if column.anchor_id not in anchor_ids)
    if strangers:
        reasons.add("anchors_unknown", anchors=strangers)
    silent = len(anchor_ids) - sum(1 for column in rounds.range_mm if any(value >= 0 for value in column))
    if silent and count:
        reasons.add("anchor_silent", silent=silent, anchors=len(anchor_ids))
    if not count:
        return None, 0
    rounds, whole, rarely = wholly_heard(rounds, evidence.radio.attempted_rounds)
    for index in rarely:
        reasons.add("anchor_rarely", anchor_id=anchor_ids[index])
    return rounds, whole


def wholly_heard(rounds: UsableRounds, attempted: int | None) -> tuple[UsableRounds, int, tuple[int, ...]]:
    """The rounds without the anchors that are rarely heard, how many are whole then, and the anchors left out.

    A round is whole where all anchors measured that measured at all: whoever can silence single anchors round by round
    chooses each anchor's mean by itself. An anchor that is silent throughout chooses nothing. So anchors are left out,
    the rarest first, until enough of the attempted rounds are whole, or only ``CHECKED_ANCHORS`` remain.
    """
    columns = [
        (index, column)
        for index, column in zip(rounds.anchor_indices, rounds.range_mm, strict=True)
        if max(column) >= 0
    ]
    rarely: list[int] = []
    whole = _whole([column for _, column in columns], len(rounds.t_ms))
    if attempted is None:
        return rounds, whole, ()
    while attempted > MOST_ATTEMPTS * whole and len(columns) > CHECKED_ANCHORS:
        rarest = max(columns, key=lambda each: (each[1].count(NO_RANGE), each[0]))
        if rarest[1].count(NO_RANGE) == 0:
            break  # whole rounds are missing, not single anchors
        columns.remove(rarest)
        rarely.append(rarest[0])
        whole = _whole([column for _, column in columns], len(rounds.t_ms))
    if not rarely or attempted > MOST_ATTEMPTS * whole:
        return rounds, whole, ()
    kept = replace(
        rounds,
        anchor_indices=tuple(index for index, _ in columns),
        range_mm=tuple(column for _, column in columns),
    )
    return kept, whole, tuple(sorted(rarely))


def _whole(columns: Sequence[Sequence[int]], count: int) -> int:
    """Rounds in which all of these measured."""
    if not any(NO_RANGE in column for column in columns):
        return count
    return sum(1 for row in zip(*columns, strict=True) if NO_RANGE not in row)


def rounds_missing(evidence: Evidence, whole: int, policy: Policy, reasons: Reasons) -> int:
    """Step 6: how many whole rounds in a row make it none too few of those attempted; 0 where they are enough.

    −1 where the policy's rounds do not suffice for that. A pad that does not say what it attempted is not asked.
    """
    attempted = evidence.radio.attempted_rounds
    if attempted is None or attempted <= MOST_ATTEMPTS * whole:
        return 0
    reasons.add("rounds_missing", attempted=attempted, whole=whole)
    wanted = attempted - MOST_ATTEMPTS * whole
    return wanted if len(evidence.ranges.t_ms) + wanted <= policy.max_rounds else -1
