"""Which share of honest drones a pad verifies, and within how many rounds: from its commissioning alone.

An honest drone's estimate is not its claim: bias, survey, installation and noise are drawn anew for each. It is
verified by the look at which it lies so deep within the buffer that its side is proved (``stopping.proved``); the mass
of the estimate's distribution within that depth is the share by then, or a little less, as earlier looks verify some
whom this one would not. Against the contract's own decision: ``tests/proofs/test_honest.py``.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import sqrt
from typing import Final

from wonderland.proofs.likelihood import LARGE_DISTANCE, Matrix2, about_the_middle
from wonderland.proofs.prospects import Prospect
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.stopping import LOOKS, proved_inside, settled_variance, step_of

SHARE_PPM: Final = 900_000
"""Of honest drones: with fewer, a pad is no go."""
_HALVINGS: Final = 12


def rounds_for(found: Prospect, policy: Policy, share_ppm: int = SHARE_PPM) -> int:
    """Rounds by which this share of honest drones is verified; −1 where the policy's most are too few."""
    looks = looks_of(policy)
    if found.rounds < 0 or share_by(found, policy, looks[-1]) * 1_000_000 < share_ppm:
        return -1
    low, high = 0, len(looks) - 1
    while low < high:
        middle = (low + high) // 2
        if share_by(found, policy, looks[middle]) * 1_000_000 >= share_ppm:
            high = middle
        else:
            low = middle + 1
    return looks[high]


def looks_of(policy: Policy) -> tuple[int, ...]:
    """Rounds after which a pad with this policy looks; the last is its most."""
    most = min(policy.max_rounds, LOOKS[-1])
    return (*(look for look in LOOKS if policy.min_rounds <= look < most), most)


def share_by(found: Prospect, policy: Policy, rounds: int) -> float:
    """Share of honest drones that are verified by this many rounds."""
    shrinking = (found.one_round + found.floor.scaled(-1.0)).scaled(1.0 / rounds)
    return share_verified(found.floor + shrinking, policy, step_of(found.floor + shrinking, shrinking, rounds))


def share_verified(covariance: Matrix2, policy: Policy, step: float = 0.0) -> float:
    """Share of honest drones whose estimates, of this covariance (mm²), prove them within the buffer."""
    s1 = covariance.ellipse().s1
    radius = float(policy.buffer_mm)
    if not proved_inside(_depth(radius, s1), s1, radius, policy, step):
        return 0.0
    low, high = 0.0, radius
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if proved_inside(_depth(radius - middle, s1), s1, radius, policy, step):
            low = middle
        else:
            high = middle
    return about_the_middle(covariance, low) if low > 0.0 else 0.0


def _depth(margin: float, s1: float) -> float:
    """Standard deviations to the edge from an estimate on the major axis: no other way out is as near by them."""
    return margin / s1 if s1 > 0.0 else LARGE_DISTANCE


def narrowed(policy: Policy) -> Policy:
    """The policy by which an exact claim is as hard to verify as that of ``SHARE_PPM`` of honest drones by this one."""
    return replace(policy, buffer_mm=round(policy.buffer_mm * narrower(policy)))


@lru_cache(maxsize=64)
def narrower(policy: Policy, share_ppm: int = SHARE_PPM) -> float:
    """By how much narrower a buffer has to be to verify an exact claim as hard as this one does this share of drones.

    For ellipses that are long and thin, as those of time differences are.
    """
    most = sqrt(settled_variance(policy))
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        thin = Matrix2(middle * middle, 0.0, 1e-6 * middle * middle)
        if share_verified(thin, policy) * 1_000_000 >= share_ppm:
            low = middle
        else:
            high = middle
    return low / most
