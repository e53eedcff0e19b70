"""What was heard on Remote ID under the drone's serial number, against what was measured: a finding of its own.

Anybody can broadcast any serial number. So a message convicts the drone only where the drone signed for it
(``attestation``), and then it is judged at the time that it says itself: whoever repeats it later convicts nobody.
Every message that the drone attested has to hold. What others may have sent cannot refute; where it contradicts the
measurement, a permission needs a message that the measurement supports (the policy's ``broadcast_required``).

A broadcast says less than a signed claim: its position is as good as it states (95 %), some tenths of a second old when
it is heard, and of a drone that may have moved since. Asked is therefore not whether the drone is within the buffer of
it, which for an accuracy of 10 m nobody could prove, but whether it is where that message *can mean*. An honest one
leaves more room than the signed claim does; so it costs an honest drone no rounds.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.attestation import digest_of
from wonderland.proofs.claims import MAX_GAP_MS, ClaimedPath, LocalClaim
from wonderland.proofs.drone_clock import Clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import Offset, solve
from wonderland.proofs.frame import to_local
from wonderland.proofs.judgement import Measured, judge
from wonderland.proofs.reasons import Reasons, nearest
from wonderland.proofs.records.pads import Commissioning, Frame
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import BroadcastClaim, Evidence, Session
from wonderland.proofs.records.verdicts import BroadcastFinding, Judgement
from wonderland.proofs.reduction import distance, reduce
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.stopping import more_rounds

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
NEXT_MESSAGE_ROUNDS: Final = 20
"""Rounds until the next message of a drone may be heard: Remote ID sends once a second, pads range every 50 ms."""
CLEAR_SIGMAS: Final = 8.0
CLEAR_SHARE: Final = 0.1
"""An estimate known to a tenth of what a message can mean, and inside it by eight standard deviations, needs no
judgement beside that of the farthest message."""
ABOUT_MS: Final = 300
"""Rounds so near to a message's moment tell where the drone was then, whatever it claimed."""
_HALF_SECOND_MS: Final = 500
_FARTHEST_MM: Final = 50_000_000.0


@dataclass(frozen=True, slots=True)
class Said:
    """One message against the signed claim of its moment."""

    east: float
    north: float
    """Broadcast minus signed claim, mm."""
    tolerance: float
    """How far (mm) from it the drone can be if the message is honest."""
    gap_ms: int
    """How far its moment is from the signed claims."""
    t_ms: int
    """Its moment: when it was heard, or the drone's own when it says that it was."""

    @property
    def beside_claims(self) -> bool:
        """Whether it belongs to a signed claim; else the drone may have flown, and nearly any place supports it."""
        return self.gap_ms <= SAME_TIME_MS

    def beyond(self, east: float = 0.0, north: float = 0.0) -> float:
        """How much farther than it can mean a place is from it; ``east``, ``north``: that place from the claim, mm."""
        return distance(self.east - east, self.north - north, 0.0) - self.tolerance


@dataclass(frozen=True, slots=True)
class Broadcast:
    """What the messages come to."""

    finding: BroadcastFinding
    more: int
    """Rounds after which it may have changed."""
    own_open: bool
    """What the drone signed for is not settled: it has to hold, whatever else was heard."""


def judge_broadcast(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    measured: Measured,
    path: ClaimedPath,
    *,
    rounds: UsableRounds | None,
    clock: Clock,
    attested: Sequence[str] = (),
    may_refute: bool,
) -> Broadcast:
    """The finding. ``attested``: the list in the evidence, where the drone's countersignature holds."""

    def place_then(t_ms: int) -> Offset | None:
        return None if rounds is None else _measured_then(rounds, commissioning, path, clock, t_ms)

    bench = _Bench(session, commissioning, measured, place_then, may_refute=may_refute)
    own, others = messages(session, commissioning, evidence.broadcast, path, attested, nearest(clock.offset_ms))
    mine = _own(bench, own)
    theirs = _others(bench, others)
    supported = mine.supported if own else theirs.supported
    decides = _decides(mine, theirs)
    messages_near = len(own) + len(others)
    more = max(
        NEXT_MESSAGE_ROUNDS if not supported else 0,
        bench.more(decides.said) if decides.outcome == "undecided" and decides.said is not None else 0,
    )
    finding = BroadcastFinding(
        outcome=decides.outcome, messages=messages_near, attributed=len(own), supported=supported
    )
    if decides.said is not None and decides.judgement is not None:
        finding = replace(
            finding,
            claim=decides.judgement.claim,
            error_mm=decides.judgement.error_mm,
            likelihood_ppm=decides.judgement.likelihood_ppm,
            tolerance_mm=int(decides.said.tolerance),
        )
    return Broadcast(finding, more, own_open=mine.outcome == "undecided")


def unmeasured(broadcast: Broadcast) -> Broadcast:
    """The finding where the measurement itself is refuted: what was heard neither holds nor fails by it."""
    heard = broadcast.finding
    outcome = "undecided" if heard.messages else heard.outcome
    finding = BroadcastFinding(outcome=outcome, messages=heard.messages, attributed=heard.attributed, supported=False)
    return replace(broadcast, finding=finding)


def outcome_with(outcome: str, broadcast: Broadcast, policy: Policy, reasons: Reasons) -> str:
    """The verdict's outcome, given that of the signed claim: what the public was told bears on it (decision 0003)."""
    finding = broadcast.finding
    off = finding.error_mm or 0
    if finding.outcome == "own_contradicted":
        reasons.add("broadcast_own_contradicts", error_mm=off)
        return "refuted"
    if finding.outcome == "contradicted":
        reasons.add("broadcast_contradicts", error_mm=off)
    if outcome != "verified" or not (broadcast.own_open or _lacking(finding, policy)):
        return outcome
    if finding.outcome == "undecided":
        reasons.add("broadcast_undecided", error_mm=off, tolerance_mm=finding.tolerance_mm or 0)
    elif finding.outcome == "not_heard":
        reasons.add("broadcast_not_heard")
    else:
        reasons.add("broadcast_unsupported")
    return "inconclusive"


def _lacking(finding: BroadcastFinding, policy: Policy) -> bool:
    """Whether a permission lacks the broadcast that its policy demands."""
    if finding.supported:
        return False
    if finding.outcome in {"not_heard", "supported"}:
        return policy.broadcast_required == "always"
    return policy.broadcast_required != "never"


def tolerance_mm(policy: Policy, accuracy_mm: int | None, speed_mm_ms: float, gap_ms: int) -> float:
    """How far from its broadcast an honest drone can be.

    One that states no accuracy is held to the buffer, and one that states a very poor one gains no more than the
    policy lets a signed claim state.
    """
    accuracy = float(min(accuracy_mm or 0, policy.max_claim_accuracy_mm))
    aged = speed_mm_ms * AGE_MS
    moved = UNCLAIMED_SPEED_MM_MS * gap_ms if gap_ms > SAME_TIME_MS else 0.0
    return max(float(policy.buffer_mm), STATED_TIMES * sqrt(accuracy * accuracy + aged * aged + moved * moved))


def messages(
    session: Session,
    commissioning: Commissioning,
    heard: Iterable[BroadcastClaim],
    path: ClaimedPath,
    attested: Sequence[str] = (),
    clock_offset_ms: int = 0,
) -> tuple[list[Said], list[Said]]:
    """The drone's own, at the moments that they say, and all others, at the moments when they were heard.

    Of each those that belong to the signed claims; where there are none, the nearest in time. What the drone attested
    and dated away from its claims is as good as anybody's.
    """
    signed = frozenset(attested)
    own: list[Said] = []
    others: list[Said] = []
    for message in heard:
        if signed and digest_of(message) in signed:
            said = place_said(session, commissioning.frame, message, path, (message.said_ms or 0) - clock_offset_ms)
            if said.gap_ms <= NEAR_CLAIM_MS:
                own.append(said)
                continue
        said = place_said(session, commissioning.frame, message, path, message.t_ms)
        if said.gap_ms <= NEAR_CLAIM_MS:
            others.append(said)
    return _nearest(own), _nearest(others)


def place_said(session: Session, frame: Frame, message: BroadcastClaim, path: ClaimedPath, t_ms: int) -> Said:
    """A message against the claim signed for a moment of the pad's clock.

    Its height takes no part: a claimed place's is as good for the map, and an impostor would not have to keep to it.
    """
    claimed, gap_ms = _claimed(path, t_ms)
    try:
        east, north, _ = to_local(frame, message.lat_e7, message.lon_e7, session.claim.height_mm)
    except GeometryError:
        east, north = 100_000_000, 0  # broadcast from elsewhere: as far off as the records can say
    speed = 0.0
    for moment in (t_ms - _HALF_SECOND_MS, t_ms + _HALF_SECOND_MS):
        other = path.at(moment)
        if other is not None:
            speed = max(speed, distance(other.east - claimed.east, other.north - claimed.north, 0.0) / _HALF_SECOND_MS)
    return Said(
        max(-_FARTHEST_MM, min(_FARTHEST_MM, east - claimed.east)),
        max(-_FARTHEST_MM, min(_FARTHEST_MM, north - claimed.north)),
        tolerance_mm(session.policy, message.accuracy_mm, speed, gap_ms),
        gap_ms,
        t_ms,
    )


def _claimed(path: ClaimedPath, t_ms: int) -> tuple[LocalClaim, int]:
    """The claim that stands for a moment, and how far in time it is; between two claims that is no distance."""
    points = path.points
    after = bisect_right(points, t_ms, key=lambda point: point.t_ms)
    near = points[max(after - 1, 0) : after + 1]
    if len(near) > 1 and near[1].t_ms - near[0].t_ms <= MAX_GAP_MS:
        return path.at(t_ms) or near[0], 0
    nearest = min(near, key=lambda point: abs(point.t_ms - t_ms))
    return nearest, abs(nearest.t_ms - t_ms)


def _nearest(said: list[Said]) -> list[Said]:
    nearest_ms = min((each.gap_ms for each in said), default=0)
    reach_ms = max(nearest_ms, SAME_TIME_MS)
    return [each for each in said if each.gap_ms <= reach_ms]


def _measured_then(
    rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath, clock: Clock, t_ms: int
) -> Offset | None:
    """The estimate of the rounds about a moment alone, minus the claims of that moment; None where they give none."""
    first = bisect_left(rounds.t_ms, t_ms - ABOUT_MS)
    last = bisect_right(rounds.t_ms, t_ms + ABOUT_MS)
    near = replace(
        rounds, t_ms=rounds.t_ms[first:last], range_mm=tuple(column[first:last] for column in rounds.range_mm)
    )
    reduced = reduce(near, commissioning, path, clock.sigma_ms) if near.t_ms else None
    return None if reduced is None else solve(reduced)


class _Bench:
    """Judges single messages by one measurement.

    ``place_then``: what the rounds about a moment say alone. The judgement takes the claim of a message's moment to be
    as far off as all of them are; where claims are off for a while, the message would be blamed for it.
    """

    def __init__(
        self,
        session: Session,
        commissioning: Commissioning,
        measured: Measured,
        place_then: Callable[[int], Offset | None],
        *,
        may_refute: bool,
    ) -> None:
        self._policy = session.policy
        self._commissioning = commissioning
        self._measured = measured
        self._place_then = place_then
        self._may_refute = may_refute
        self._judged: dict[Said, Judgement] = {}

    def judge(self, said: Said) -> Judgement:
        """Whether the drone is where the message can mean."""
        if said not in self._judged:
            self._judged[said] = self._judge(said)
        return self._judged[said]

    def clearly_holds(self, said: Said) -> bool:
        """Whether no judgement is needed to see that the estimate is well within what the message can mean."""
        for offset in self._measured.agreement.offsets or (self._measured.whole,):
            s1 = offset.covariance.ellipse().s1
            if s1 > CLEAR_SHARE * said.tolerance or said.beyond(offset.east, offset.north) > -CLEAR_SIGMAS * s1:
                return False
        return True

    def _judge(self, said: Said) -> Judgement:
        judgement = judge(
            self._held_to(said),
            self._commissioning,
            self._measured,
            (said.east, said.north),
            may_verify=self._measured.agreement.usable,
            may_refute=self._may_refute,
        )
        if judgement.outcome != "refuted":
            return judgement
        then = self._place_then(said.t_ms)
        if then is None or said.beyond(then.east, then.north) > 0.0:
            return judgement
        return replace(judgement, outcome="inconclusive")

    def beyond(self, said: Said) -> float:
        """How far beyond what it can mean the estimate is (mm); where it is not, nothing can contradict it."""
        offset = self._measured.offset
        return said.beyond(offset.east, offset.north)

    def more(self, said: Said) -> int:
        """Further rounds expected to settle it; −1: none would."""
        offset = self._measured.offset
        offset = replace(offset, east=offset.east - said.east, north=offset.north - said.north)
        return more_rounds(offset, self._measured.reduced.rounds, self._held_to(said))

    def _held_to(self, said: Said) -> Policy:
        return replace(self._policy, buffer_mm=int(said.tolerance))


@dataclass(frozen=True, slots=True)
class _Group:
    """What some of the messages come to, and the one that decides."""

    outcome: str
    supported: bool
    said: Said | None = None
    judgement: Judgement | None = None


_NOTHING: Final = _Group("not_heard", supported=False)
_IN_ORDER: Final = ("own_contradicted", "contradicted", "undecided", "supported", "not_heard")


def _own(bench: _Bench, said: list[Said]) -> _Group:
    """All have to hold: the farthest beyond what it can mean decides among those that do not."""
    found = _NOTHING
    for each in sorted(said, key=bench.beyond, reverse=True):
        if found.said is not None and bench.clearly_holds(each):
            continue
        judgement = bench.judge(each)
        if judgement.outcome == "refuted":
            return _Group("own_contradicted", supported=False, said=each, judgement=judgement)
        outcome = "supported" if judgement.outcome == "verified" else "undecided"
        if found.said is None or (outcome == "undecided" and found.outcome != "undecided"):
            found = _Group(outcome, outcome == "supported" and each.beside_claims, each, judgement)
    return found


def _others(bench: _Bench, said: list[Said]) -> _Group:
    """One that holds supports the drone whatever else is sent; one that does not is told, and of no known origin."""
    nearest_first = sorted(said, key=bench.beyond)
    support = _first(bench, [each for each in nearest_first if bench.beyond(each) <= each.tolerance], "verified")
    # An estimate that is within what a message can mean cannot contradict it.
    contradiction = _first(bench, [each for each in reversed(nearest_first) if bench.beyond(each) > 0.0], "refuted")
    if contradiction is not None:
        return _Group("contradicted", support is not None and support[0].beside_claims, *contradiction)
    if support is not None:
        return _Group("supported", support[0].beside_claims, *support)
    if nearest_first:
        return _Group("undecided", supported=False, said=nearest_first[0], judgement=bench.judge(nearest_first[0]))
    return _NOTHING


def _first(bench: _Bench, said: Sequence[Said], outcome: str) -> tuple[Said, Judgement] | None:
    for each in said:
        judgement = bench.judge(each)
        if judgement.outcome == outcome:
            return each, judgement
    return None


def _decides(own: _Group, others: _Group) -> _Group:
    """The graver finding; an undecided message of unknown origin is none beside the drone's own."""
    if own.said is not None and others.outcome in {"undecided", "supported"}:
        return own
    return min(own, others, key=lambda group: _IN_ORDER.index(group.outcome))
