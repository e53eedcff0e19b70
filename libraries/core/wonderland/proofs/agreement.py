"""Do the ranges agree with one another, and if not, is one anchor to blame: step 5 of the verdict.

The general form of the rectangle's parity r1² + r3² = r2² + r4², for 3 to 16 anchors anywhere: the χ² of the ranges
about the position that fits them best. It needs no claim. If it is too large, each anchor in turn is left out. Four
anchors can seldom say *which* one is bad; so an outcome then needs every subset that could be the good one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.estimate import Offset, solve, without
from wonderland.proofs.reduction import Reduced
from wonderland.proofs.special import CHI2_LIMITS, CHI2_MILLIONTH

REFUTING_ANCHORS: Final = 4
"""Three anchors leave no redundancy: one bad range could refute an honest drone."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What the ranges say together: the estimates that an outcome needs, all of them, the best first."""

    offsets: tuple[Offset, ...]
    """One where all anchors agree; else one for each subset that may be the good one; none where no subset agrees."""
    suspects: tuple[int, ...]
    """Anchors (positions in the commissioning) left out in ``offsets``, in the same order; none where all agree."""
    anchors: int
    """How many anchors each of the offsets rests on."""
    chi2: float
    limit: float

    @property
    def consistent(self) -> bool:
        """Whether all anchors agree."""
        return bool(self.offsets) and not self.suspects

    @property
    def usable(self) -> bool:
        """Whether an outcome can rest on it."""
        return bool(self.offsets)


def agreement(reduced: Reduced, whole: Offset) -> Agreement:
    """Judge the fit of all anchors, ``whole``, and where it fails each fit without one anchor.

    A subset that one in a million honest ones would exceed is no candidate; one candidate must do better than one in
    a thousand.
    """
    count = len(reduced.anchors)
    limit = _limit(CHI2_LIMITS, whole)
    if whole.chi2 <= limit:
        return Agreement((whole,), (), count, whole.chi2, limit)
    candidates: list[tuple[float, int, Offset]] = []
    passes = False
    if count > 3:
        for position, anchor in enumerate(reduced.anchors):
            part = solve(without(reduced, position))
            if part is None:
                # Nobody knows what these would say; so nothing may be decided.
                return Agreement((), (), count - 1, whole.chi2, limit)
            if part.chi2 <= _limit(CHI2_MILLIONTH, part):
                candidates.append((part.chi2, anchor.index, part))
                passes = passes or part.chi2 <= _limit(CHI2_LIMITS, part)
    if not passes:
        return Agreement((), (), count - 1, whole.chi2, limit)
    candidates.sort(key=lambda candidate: candidate[:2])
    return Agreement(
        tuple(offset for _, _, offset in candidates),
        tuple(index for _, index, _ in candidates),
        count - 1,
        whole.chi2,
        limit,
    )


def excused(reduced: Reduced, whole: Offset, suspects: Sequence[int]) -> Agreement:
    """The same without asking whether ranges agree: all anchors, or each set without one of ``suspects``."""
    parts = {
        anchor.index: solve(without(reduced, position))
        for position, anchor in enumerate(reduced.anchors)
        if anchor.index in suspects
    }
    offsets = tuple(part for part in map(parts.get, suspects) if part is not None)
    if len(offsets) < len(suspects):
        return Agreement((), (), len(reduced.anchors) - 1, whole.chi2, _limit(CHI2_LIMITS, whole))
    count = len(reduced.anchors) - (1 if suspects else 0)
    return Agreement(offsets or (whole,), tuple(suspects), count, whole.chi2, _limit(CHI2_LIMITS, whole))


def _limit(limits: tuple[float, ...], offset: Offset) -> float:
    return limits[min(max(offset.freedom, 1), len(limits)) - 1]
