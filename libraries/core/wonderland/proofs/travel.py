"""How much of each anchor's bias is left in a session's mean of a drone that moved: part of step 5 of the verdict.

What commissioning leaves of an anchor's bias has two parts. One stays wherever the drone is (antenna delay, mounting).
The other belongs to a place: reflections and antenna patterns change along the way, with correlation exp(−d/L) between
places d apart. In a mean over several places only the first part stays whole; the variance of the mean is σ²·left,

    left = c + (1 − c)·g,   g = mean of exp(−d/L) over all pairs of moments,

with c (``bias_fixed_ppm``) and L (``bias_length_mm``) as commissioned; without them left is 1, and nothing shrinks.

**How far the drone went is taken from the ranges alone**, never from a claim, and as a lower bound. The difference of
two ranges of one anchor is at most the way between their places (triangle inequality). The session is cut into a few
blocks; two blocks are as far apart as *all anchors but one* say, by the medians of their ranges, less an allowance for
noise, reflections and obstructions that drift. So a drone that hovers has left = 1 exactly, one bad anchor or a burst
changes nothing, flying to and fro counts for no more than the places it visits, and flying around the pad for little.
A lower bound of distances is an upper bound of ``left``: the verdict can only be vaguer than it might be. Whoever
falsifies time stamps makes ranges say anything, a way as well; what that wins, and where it ends, is as it was.

Ranges and their medians are integers here; floats begin with ``exp_negative``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.special import exp_negative

BLOCKS: Final = 6
"""The most; g is never below one in so many. Pairs, and the time that this takes, grow with the square."""
BLOCK_ROUNDS: Final = 5
"""The least for a median; two blocks are the least for a way."""
AGREEING: Final = 3
"""So many anchors at least have to say that the drone moved; of four or more, all but one."""
ALLOWANCE_MM: Final = 300
"""Hovering, what an obstruction or a reflection that comes and goes adds to ranges; never taken for a way."""
ALLOWANCE_SIGMAS: Final = 6
PATIENCE_ROUNDS: Final = 40
"""At 20 Hz two seconds, in which a drone at 0.5 m/s has gone more than the allowance."""
_PARTS: Final = 1_000_000.0


def bias_left(columns: Sequence[Sequence[int]], commissioning: Commissioning) -> tuple[float, ...]:
    """For each anchor's raw ranges, by round: the share of its bias's variance that is left in its mean.

    The rounds are those that the means are taken of, in order of time, and a range that is in no mean is NO_RANGE; or a
    drone would be believed to have been where nothing was judged. An anchor without ranges in more than half of a block
    has no mean over the whole way: all of its bias is left.
    """
    length, fixed = commissioning.bias_length_mm, commissioning.bias_fixed_ppm
    whole = (1.0,) * len(columns)
    rounds = len(columns[0]) if columns else 0
    blocks = min(BLOCKS, rounds // BLOCK_ROUNDS)
    if length is None or fixed is None or blocks < 2:
        return whole
    bounds = [rounds * block // blocks for block in range(blocks + 1)]
    medians = [_medians(column, bounds) for column in columns]
    heard = [values for values in medians if values]
    if len(heard) < AGREEING:
        return whole
    allowance = max(ALLOWANCE_MM, ALLOWANCE_SIGMAS * commissioning.range_sigma_mm)
    left = fixed / _PARTS
    left += (1.0 - left) * _alike(heard, allowance, float(length))
    return tuple([left if values else 1.0 for values in medians])


def hope(left: float, rounds: int, commissioning: Commissioning) -> float:
    """The least share of the floor that may be left in the end: for the advice how many more rounds would help.

    1 where ``rounds`` are enough to show that a drone moves, and nothing shows it.
    """
    fixed = commissioning.bias_fixed_ppm
    if fixed is None or (left >= 1.0 and rounds >= PATIENCE_ROUNDS):
        return 1.0
    return fixed / _PARTS / left


def _medians(column: Sequence[int], bounds: Sequence[int]) -> list[int]:
    """One median range for each block; none at all where one of them has too few."""
    found = []
    for begin, end in pairwise(bounds):
        block = sorted(column[begin:end])
        silent = block.count(NO_RANGE)  # the least value: first in order
        if 2 * silent > len(block):
            return []
        found.append(block[(silent + len(block)) // 2])
    return found


def _alike(heard: Sequence[Sequence[int]], allowance: int, length: float) -> float:
    """g: mean correlation of all pairs of blocks, each with itself among them, at distances no longer than they are."""
    blocks = len(heard[0])
    least = 1 if len(heard) > AGREEING else 0
    total = 0.0
    moved = False
    for later in range(1, blocks):
        for earlier in range(later):
            way = sorted([abs(values[later] - values[earlier]) for values in heard])[least] - allowance
            if way > 0:
                moved = True
                total += exp_negative(-way / length)
            else:
                total += 1.0
    if not moved:
        return 1.0
    return (blocks + 2.0 * total) / (blocks * blocks)
