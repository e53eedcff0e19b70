"""The decision, in numbered steps; one function for each, limits as named constants with their reason.

 1. freshness       times of rounds and claims belong to this session
 2. confirmations   both codes matched; the drone's countersignature holds
 3. usable rounds   at least three anchors, plausible ranges, no obstruction
 4. bias            each range is corrected by its anchor's calibration
 5. consistency     the ranges agree with one another (χ² about the estimate)
 6. time differences  (assurance 3; no pad of this version brings them)
 7. claim           residuals against the claimed path, which may move
 8. estimate        offset from the claim, with its covariance
 9. likelihood      that the drone is within the buffer of its claim
10. outcome         verified, refuted or inconclusive, and permission

Steps 4, 7 and 8 are in ``estimate``, step 9 in ``likelihood``. Two claims are judged: the one that the drone signed
for this session and the one that it broadcast. Integers and exactly rounded operations only (``special``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.estimate import Offset, Reduced, reduce, solve
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.likelihood import Matrix2, distance_to_disc, inside_disc
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import Covariance, Judgement, Position, Reason, Verdict
from wonderland.proofs.rounds import UsableRounds, usable
from wonderland.proofs.special import CHI2_LIMITS

LOOKS: Final = (10, 20, 40, 80, 160)
"""Rounds after which a pad may look whether the session is settled."""
LOOK_Z: Final = 2.83
"""Standard deviations that hold 1 % error at each side under these five looks (simulated; ``docs/method.md``)."""
SINGLE_Z: Final = 2.3263478740408408
"""Standard deviations of 1 % in a single look."""
LOOK_INFLATION: Final = (LOOK_Z * LOOK_Z) / (SINGLE_Z * SINGLE_Z)
"""Looking five times costs this factor of variance."""
REFUTING_ANCHORS: Final = 4
"""Three anchors leave no redundancy: one bad range could refute an honest drone."""
NEAR_CLAIM_MS: Final = 3_000
"""How far a broadcast may lie from the signed claims in time and still be judged by them."""
SAME_TIME_MS: Final = 250
"""Within this the nearest signed claim stands for the moment of a broadcast."""
UNCLAIMED_SPEED_MM_MS: Final = 10
"""Between a broadcast and the signed claims a drone may have moved at this speed (10 m/s, one standard deviation)."""
BROADCAST_LATENCY_SIGMA_MS: Final = 300
"""Age of a position when it is heard: Remote ID sends once a second and stamps tenths."""
MAX_MORE_ROUNDS: Final = 10_000
_MILLI_LIMIT: Final = 1e12


@dataclass
class _Reasons:
    """Collects why, in the order of the steps."""

    items: list[Reason] = field(default_factory=list)

    def add(self, code: str, text: str) -> None:
        self.items.append(Reason(code=code, text=text[:300]))


@dataclass(frozen=True, slots=True)
class _Measured:
    """What the rounds say, before any claim is judged."""

    reduced: Reduced
    offset: Offset
    consistent: bool


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
) -> Verdict:
    """The verdict of a session.

    ``confirmed``: both session codes matched. ``signature_valid``: the drone's countersignature, None where it gave
    none. ``authorisation``: reasons why the drone may not do what it asks, none where it may.
    """
    policy = session.policy
    reasons = _Reasons()
    blocked = not _fresh(session, evidence, now_ms, reasons)  # 1
    blocked = not _confirmed(evidence, confirmed, signature_valid, reasons) or blocked  # 2
    assurance = _assurance(evidence)
    if assurance < policy.min_assurance:
        reasons.add("assurance_too_low", f"Assurance {assurance}; this policy demands {policy.min_assurance}.")
        blocked = True
    rounds = _usable(evidence, commissioning, policy.min_rounds, reasons)  # 3
    measured: _Measured | None = None
    path: ClaimedPath | None = None
    try:
        path = ClaimedPath(commissioning.frame, (session.claim, *evidence.claims))
    except GeometryError:
        reasons.add("claim_far_away", "The claimed position is nowhere near this pad.")
    if path is not None and rounds is not None:
        if path.accuracy_mm > policy.max_claim_accuracy_mm:
            reasons.add(
                "claim_vague", f"The claim is good to {_m(path.accuracy_mm)} only; a vague claim proves nothing."
            )
            blocked = True
        measured = _measure(rounds, commissioning, path, reasons)  # 4, 5, 7, 8
    enough = rounds is not None and len(rounds.t_ms) >= policy.min_rounds

    signed: Judgement | None = None
    broadcast: Judgement | None = None
    more = -1
    if measured is not None and path is not None:
        may_refute = measured.consistent and len(measured.reduced.anchors) >= REFUTING_ANCHORS and enough
        signed = _judge(
            session,
            commissioning,
            measured,
            Matrix2(0.0, 0.0, 0.0),
            (0.0, 0.0),
            may_verify=not blocked and measured.consistent and enough,
            may_refute=may_refute,
        )  # 9, 10
        broadcast = _judge_broadcast(session, commissioning, evidence, measured, path, may_refute=may_refute)
        more = _more_rounds(measured, float(policy.buffer_mm))
    outcome = _outcome(signed, broadcast, reasons)
    authorised = not authorisation
    reasons.items.extend(authorisation)
    granted = outcome == "verified" and authorised
    estimate = _position(commissioning, measured) if measured is not None else None
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
        broadcast=broadcast,
        estimate=estimate,
        covariance=_covariance(measured.offset.covariance) if measured is not None else None,
        chi2_milli=_milli(measured.offset.chi2) if measured is not None else None,
        chi2_claim_milli=_milli(measured.offset.chi2_claim) if measured is not None else None,
        within_mm=_within(measured, commissioning) if measured is not None else None,
    )


def preview(session: Session, commissioning: Commissioning, evidence: Evidence, now_ms: int) -> Verdict:
    """The pad's look while it ranges: the decision were the drone to countersign and to be authorised."""
    return decide(
        session,
        commissioning,
        evidence,
        confirmed=evidence.matched == "both",
        signature_valid=True,
        authorisation=(),
        now_ms=now_ms,
        evidence_sha256="0" * 64,
    )


def _fresh(session: Session, evidence: Evidence, now_ms: int, reasons: _Reasons) -> bool:
    """Step 1: rounds and claims lie between the request and now, give or take the tolerated skew."""
    skew = session.policy.max_clock_skew_ms
    earliest = session.requested_ms - skew
    latest = min(now_ms, session.expires_ms) + skew
    fresh = True
    if any(not earliest <= t_ms <= latest for t_ms in evidence.ranges.t_ms):
        reasons.add("rounds_not_fresh", "Rounds were ranged outside of the session's time.")
        fresh = False
    if any(not earliest <= claim.t_ms <= latest for claim in evidence.claims):
        reasons.add("claims_not_fresh", "Claims were made outside of the session's time.")
        fresh = False
    if any(after < before for before, after in zip(evidence.ranges.t_ms, evidence.ranges.t_ms[1:], strict=False)):
        reasons.add("time_goes_back", "The rounds' times go backwards.")
        fresh = False
    return fresh


def _confirmed(evidence: Evidence, confirmed: bool, signature_valid: bool | None, reasons: _Reasons) -> bool:
    """Step 2: without both codes and the drone's countersignature nothing can be verified."""
    if not confirmed:
        reasons.add("codes_not_matched", "The session codes did not match over UWB: another drone, or a replay.")
    if signature_valid is None:
        reasons.add("not_countersigned", "The drone did not countersign the ranges.")
    elif not signature_valid:
        reasons.add("countersignature_invalid", "The drone's countersignature does not fit these ranges and claims.")
    if evidence.failure is not None:
        reasons.add("session_stopped", f"The pad stopped early: {evidence.failure.replace('_', ' ')}.")
    return confirmed and signature_valid is True


def _assurance(evidence: Evidence) -> int:
    """What the way of ranging can bear; 3 and 4 need time differences and a second pad."""
    if evidence.radio.measured_by == "uav":
        return 0
    return 2 if evidence.radio.sts == "provisioned" else 1


def _usable(
    evidence: Evidence, commissioning: Commissioning, min_rounds: int, reasons: _Reasons
) -> UsableRounds | None:
    """Step 3."""
    anchor_ids = [anchor.anchor_id for anchor in commissioning.anchors]
    rounds = usable(evidence.ranges, anchor_ids, commissioning.max_range_mm)
    count = len(rounds.t_ms)
    if count < min_rounds:
        reasons.add("too_few_rounds", f"{count} usable rounds; at least {min_rounds} are needed.")
    if rounds.obstructed:
        reasons.add("obstructed", f"{rounds.obstructed} ranges left out: their anchors saw an obstruction.")
    silent = len(anchor_ids) - sum(1 for column in rounds.range_mm if any(value >= 0 for value in column))
    if silent and count:
        reasons.add("anchor_silent", f"{silent} of {len(anchor_ids)} anchors measured nothing usable.")
    return rounds if count else None


def _measure(
    rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath, reasons: _Reasons
) -> _Measured | None:
    """Steps 4 to 8: estimate, covariance, and whether the ranges agree with one another."""
    reduced = reduce(rounds, commissioning, path)
    if reduced is None:
        reasons.add("no_estimate", "Too few anchors with ranges at the times of the claims.")
        return None
    offset = solve(reduced)
    if offset is None:
        reasons.add("no_estimate", "The anchors' geometry gives no position for these ranges.")
        return None
    limit = CHI2_LIMITS[min(max(offset.freedom, 1), len(CHI2_LIMITS)) - 1]
    consistent = offset.chi2 <= limit
    if not consistent:
        reasons.add(
            "ranges_inconsistent",
            f"The ranges contradict one another: χ² {_decimal(offset.chi2)}, limit {_decimal(limit)}.",
        )
    if reduced.bursts:
        reasons.add("bursts", f"{reduced.bursts} ranges left out as bursts of error.")
    return _Measured(reduced, offset, consistent)


def _judge(
    session: Session,
    commissioning: Commissioning,
    measured: _Measured,
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
    likelihood_ppm = _ppm(inside_disc(east, north, covariance, radius))
    guarded_ppm = _ppm(inside_disc(east, north, guarded, radius))
    significance = distance_to_disc(east, north, covariance, radius)
    error = sqrt(east * east + north * north)
    reasons = _Reasons()
    if guarded_ppm >= policy.verify_ppm:
        outcome = "verified" if may_verify else "inconclusive"
        if may_verify:
            reasons.add("within_buffer", f"Measured {_m(error)} from the claim, within {_m(radius)}.")
    elif guarded_ppm <= policy.refute_ppm and significance >= LOOK_Z:
        outcome = "refuted" if may_refute else "inconclusive"
        reasons.add(
            "outside_buffer",
            f"Measured {_m(error)} from the claim, outside {_m(radius)} by {_decimal(significance)} σ.",
        )
        if not may_refute:
            reasons.add("cannot_refute", "Too few anchors, or too inconsistent ranges, to refute on.")
    else:
        outcome = "inconclusive"
        axes = covariance.ellipse()
        reasons.add(
            "undecided",
            f"Measured {_m(error)} from the claim, known to {_m(axes.s1)} at one standard deviation: not settled yet.",
        )
    reduced = measured.reduced
    claim = _at(commissioning, reduced.east + shift[0], reduced.north + shift[1], reduced.up)
    return Judgement(
        outcome=outcome,
        claim=claim,
        error_mm=min(int(error + 0.5), 100_000_000),
        likelihood_ppm=likelihood_ppm,
        paper_rule=error <= radius,
        reasons=tuple(reasons.items),
    )


def _judge_broadcast(
    session: Session,
    commissioning: Commissioning,
    evidence: Evidence,
    measured: _Measured,
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
    return _judge(session, commissioning, measured, extra, shift, may_verify=measured.consistent, may_refute=may_refute)


def _outcome(signed: Judgement | None, broadcast: Judgement | None, reasons: _Reasons) -> str:
    """Step 10: the signed claim decides, unless the public was told something that is refuted."""
    if signed is None:
        return "inconclusive"
    reasons.items.extend(signed.reasons)
    if broadcast is not None and broadcast.outcome == "refuted":
        reasons.add(
            "broadcast_contradicts", f"Its broadcast puts it {_m(broadcast.error_mm)} from where it was measured."
        )
        return "refuted"
    return signed.outcome


def _more_rounds(measured: _Measured, radius: float) -> int:
    """Further rounds expected to settle it; −1 where the part that does not shrink is already too large."""
    offset = measured.offset
    distance = sqrt(offset.east * offset.east + offset.north * offset.north)
    if distance > 1.0:
        east, north = offset.east / distance, offset.north / distance
    else:
        axes = offset.covariance.ellipse()
        east, north = axes.east, axes.north
    floor = offset.floor.along(east, north)
    white = (offset.covariance.along(east, north) - floor) * measured.reduced.rounds
    margin = (radius - distance) / LOOK_Z
    room = margin * margin - floor
    if room <= 0.0:
        return -1
    needed = white / room
    if needed > MAX_MORE_ROUNDS:
        return -1
    return max(int(needed) + 1 - measured.reduced.rounds, 0)


def _within(measured: _Measured, commissioning: Commissioning) -> int:
    """A bound that holds whatever the drone does with its clock: within this distance of the pad's origin."""
    best = -1.0
    for mean in measured.reduced.anchors:
        anchor = commissioning.anchors[mean.index]
        away = sqrt(float(anchor.east_mm**2 + anchor.north_mm**2 + anchor.up_mm**2))
        bound = mean.range_mm + away + LOOK_Z * sqrt(mean.white + mean.floor)
        if best < 0.0 or bound < best:
            best = bound
    return int(max(best, 0.0)) + 1


def _position(commissioning: Commissioning, measured: _Measured) -> Position | None:
    reduced, offset = measured.reduced, measured.offset
    return _at(commissioning, reduced.east + offset.east, reduced.north + offset.north, reduced.up)


def _at(commissioning: Commissioning, east: float, north: float, up: float) -> Position:
    """A point of the pad's frame as a record; beyond the frame's reach its globe position is the frame's edge."""
    limit = 19_999_999.0
    east, north, up = (max(-limit, min(limit, value)) for value in (east, north, up))
    e, n, u = (_rounded(value) for value in (east, north, up))
    lat_e7, lon_e7, height_mm = to_wgs84(commissioning.frame, e, n, u)
    return Position(
        east_mm=e,
        north_mm=n,
        up_mm=u,
        lat_e7=max(-900_000_000, min(900_000_000, lat_e7)),
        lon_e7=lon_e7,
        height_mm=max(-1_000_000, min(50_000_000, height_mm)),
    )


def _covariance(matrix: Matrix2) -> Covariance:
    limit = float(2**52)
    ee, en, nn = (_rounded(max(-limit, min(limit, value))) for value in (matrix.ee, matrix.en, matrix.nn))
    return Covariance(ee_mm2=ee, en_mm2=en, nn_mm2=nn)


def _rounded(value: float) -> int:
    return int(value + 0.5) if value >= 0.0 else -int(0.5 - value)


def _ppm(probability: float) -> int:
    """Rounded down: 0.99 must have been reached."""
    return max(0, min(1_000_000, int(probability * 1e6)))


def _milli(value: float) -> int:
    return int(min(value, _MILLI_LIMIT) * 1000.0 + 0.5)


def _decimal(value: float) -> str:
    """One decimal, by integers: formatting of floats stays out of what endorsers compare."""
    tenths = int(min(value, _MILLI_LIMIT) * 10.0 + 0.5)
    return f"{tenths // 10}.{tenths % 10}"


def _m(millimetres: float) -> str:
    """Metres with two decimals."""
    centimetres = int(millimetres / 10.0 + 0.5)
    return f"{centimetres // 100}.{centimetres % 100:02d} m"
