"""Is the drone leaving its claim while it is ranged: steps 5 and 8 once more, for the newest rounds by themselves.

The estimate of a session is a mean over its rounds. A receiver that is dragged away at 1 m/s is two buffers off when
that mean is only one off. So where the newest rounds differ from all of them by more than noise explains, they are
judged alone: they can refute, with a tenth of the policy's error, and they can keep a claim from being verified.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs.agreement import agreement
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.estimate import solve
from wonderland.proofs.judgement import Measured, judge
from wonderland.proofs.moments import JUMP_BUFFERS
from wonderland.proofs.reasons import reason
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.verdicts import Judgement
from wonderland.proofs.reduction import Reduced, Residuals, newest_of, reduce, residuals_of
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.special import CHI2_LIMITS

NEWEST: Final = 7
"""A third of a second: enough to refute on near the pad, short enough that a drag of 1 m/s makes no bursts of it."""
CLEAR_BUFFERS: Final = 0.2
"""Only where the newest rounds alone know the place to a fifth of the buffer (1σ): elsewhere correlated noise may pass
for a drift, and a third of a second is no reason to refute anybody."""
JUMP_ROUNDS: Final = 10
"""Half a second."""
ERROR_SHARE: Final = 10
"""The newest rounds refute with one part in so many of the policy's error, so that the whole keeps its limit."""


def judge_newest(
    signed: Judgement,
    policy: Policy,
    commissioning: Commissioning,
    rounds: UsableRounds,
    path: ClaimedPath,
    whole: Reduced,
    clock_sigma_ms: float,
    *,
    may_refute: bool,
) -> Judgement:
    """The judgement of the signed claim, unless the newest rounds tell that the drone is leaving it."""
    if len(rounds.t_ms) <= NEWEST or signed.outcome == "refuted":
        return signed
    if whole.residuals is not None and whole.residuals.whole:
        seen: Residuals | None = newest_of(whole.residuals, NEWEST, commissioning)
    else:
        seen = residuals_of(_newest(rounds), commissioning, path)
    if seen is None or not _drifts(whole, seen, commissioning):
        return signed
    last = reduce(_newest(rounds), commissioning, path, clock_sigma_ms)
    if last is None:
        return signed
    last = _white(last, commissioning)
    offset = solve(last)
    if offset is None or offset.covariance.ellipse().s1 > CLEAR_BUFFERS * policy.buffer_mm:
        return signed
    strict = replace(policy, refute_ppm=max(1, policy.refute_ppm // ERROR_SHARE))
    now = judge(
        strict,
        commissioning,
        Measured(last, agreement(last, offset), offset),
        (0.0, 0.0),
        may_verify=False,
        may_refute=may_refute,
    )
    if now.outcome == "refuted" and not _just_jumped(path, rounds, policy):
        leaves = reason("leaving", rounds=NEWEST, away_mm=now.error_mm)
        return replace(signed, outcome="refuted", reasons=(*signed.reasons, leaves))
    if signed.outcome == "verified" and now.error_mm > policy.buffer_mm:
        drifts = reason("drifting", rounds=NEWEST, away_mm=now.error_mm)
        return replace(signed, outcome="inconclusive", reasons=(*signed.reasons, drifts))
    return signed


def _just_jumped(path: ClaimedPath, rounds: UsableRounds, policy: Policy) -> bool:
    """Whether the claim jumped within the last half second: a receiver's glitch may be over with the next claim.

    A drag moves by centimetres from round to round; what jumped and stays is refuted when the jump is past.
    """
    return path.along(rounds.t_ms[-JUMP_ROUNDS:]).jumps(JUMP_BUFFERS * policy.buffer_mm)


def _white(last: Reduced, commissioning: Commissioning) -> Reduced:
    """The noise as commissioned: within a drift each round resembles the one before, whatever the noise does."""
    variance = _variance(commissioning)
    return replace(last, anchors=tuple(replace(anchor, white=variance / anchor.count) for anchor in last.anchors))


def _variance(commissioning: Commissioning) -> float:
    """Of one range, mm², counted for how much its neighbours resemble it."""
    correlation = (commissioning.correlation_ppm or 0) / 1_000_000.0
    variance = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)
    return variance * (1.0 + correlation) / (1.0 - correlation)


def _newest(rounds: UsableRounds) -> UsableRounds:
    return replace(
        rounds,
        t_ms=rounds.t_ms[-NEWEST:],
        range_mm=tuple(column[-NEWEST:] for column in rounds.range_mm),
    )


def _drifts(whole: Reduced, newest: Residuals, commissioning: Commissioning) -> bool:
    """Whether the newest residuals differ from all of them by more than one in a thousand honest sessions."""
    variance = _variance(commissioning)
    means = {anchor.index: anchor for anchor in whole.anchors}
    chi2 = 0.0
    shared = 0
    for column, mean in newest.series:
        anchor = means.get(column.anchor)
        count = len(column.values)
        # The newest are part of all, so that their means differ by σ²(1/k − 1/n).
        if anchor is None or anchor.count <= count:
            continue
        difference = mean - anchor.residual_mm
        chi2 += difference * difference / (variance * (1.0 / count - 1.0 / anchor.count))
        shared += 1
    return shared > 0 and chi2 > CHI2_LIMITS[min(shared, len(CHI2_LIMITS)) - 1]
