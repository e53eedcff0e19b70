"""No single claim convicts: part of step 8.

Between claims a drone is taken to fly straight. Where claims come once a second, one wrong fix of an honest receiver
bends the path of two seconds, and no jump shows, since in a second a drone can fly anywhere. So a refutation that rests
on few claims has to hold without each of them.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Final

from wonderland.proofs.agreement import agreement
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.estimate import solve
from wonderland.proofs.judgement import Measured, judge
from wonderland.proofs.leaving import judge_newest
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim
from wonderland.proofs.reduction import reduce
from wonderland.proofs.rounds import UsableRounds

FEW_CLAIMS: Final = 12
"""One of more than these moves no mean by enough."""


def rests_on_one(
    claims: Sequence[Claim],
    rounds: UsableRounds | None,
    policy: Policy,
    commissioning: Commissioning,
    clock_sigma_ms: float,
) -> bool:
    """Whether a refutation falls with a single one of the claims (the request's and the session's) about the rounds."""
    if rounds is None:
        return False
    order = sorted(claims, key=_moment)
    first = max(bisect_left(order, rounds.span_ms[0], key=_moment) - 1, 0)
    last = min(bisect_right(order, rounds.span_ms[1], key=_moment) + 1, len(order))
    if last - first > FEW_CLAIMS:
        return False
    return any(
        not _refuted([*order[:index], *order[index + 1 :]], rounds, policy, commissioning, clock_sigma_ms)
        for index in range(first, last)
    )


def _refuted(
    claims: Sequence[Claim],
    rounds: UsableRounds,
    policy: Policy,
    commissioning: Commissioning,
    clock_sigma_ms: float,
) -> bool:
    if not claims:
        return False
    path = ClaimedPath(commissioning.frame, claims)
    reduced = reduce(rounds, commissioning, path, clock_sigma_ms)
    offset = solve(reduced) if reduced is not None else None
    if reduced is None or offset is None:
        return False
    measured = Measured(reduced, agreement(reduced, offset), offset)
    said = judge(policy, commissioning, measured, (0.0, 0.0), may_verify=False, may_refute=True)
    last = judge_newest(said, policy, commissioning, rounds, path, reduced, clock_sigma_ms, may_refute=True)
    return last.outcome == "refuted"


def _moment(claim: Claim) -> int:
    return claim.t_ms
