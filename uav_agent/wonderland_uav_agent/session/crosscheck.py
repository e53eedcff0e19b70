"""Does the pad tell the ranges that the drone measured itself? The drone signs no others.

Both ends of a two-way exchange compute the same range, so they agree to a few centimetres. What they do not share is
a clock: the pad's times are shifted against the drone's by an unknown amount, which the arrival of the pad's words
bounds. The comparison takes the shift within these bounds under which the two agree best; a moving drone's ranges
can differ by what it flew in that time at most.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.records.sessions import NO_RANGE, RangeTable

MAX_MEDIAN_MM: Final = 500
"""Larger disagreements are no noise: one of the two lies or is broken."""
MAX_AGE_MS: Final = 60
"""A range is compared with one of at most this distance in time: the same round, or the next."""
LATENCIES_MS: Final = range(0, 2_001, 50)
"""How much later than the pad's last round its words may have reached the drone."""
MIN_SHARE_PERCENT: Final = 25
"""At least this share of the pad's ranges must have a counterpart, or the comparison is worth nothing."""
KEPT: Final = 1_024
"""Own ranges kept for each pad node: 50 s at 20 Hz."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Outcome: ``median_mm`` of the absolute differences, from ``pairs`` of ``told`` ranges."""

    told: int
    pairs: int
    median_mm: int

    @property
    def refusal(self) -> str:
        """Why the drone does not sign; empty where it may."""
        if not self.told:
            return "no_ranges_told"
        if self.pairs * 100 < self.told * MIN_SHARE_PERCENT:
            return "no_own_ranges"
        return "ranges_disagree" if self.median_mm > MAX_MEDIAN_MM else ""


class OwnRanges:
    """What the drone's node measured, by pad node."""

    def __init__(self) -> None:
        self._by_mac: dict[int, deque[tuple[int, int]]] = {}

    def add(self, mac: int, t_ms: int, range_mm: int) -> None:
        """One range, in order of time."""
        self._by_mac.setdefault(mac, deque(maxlen=KEPT)).append((t_ms, range_mm))

    def compare(self, table: RangeTable, macs: Mapping[str, int], heard_ms: int) -> Comparison:
        """Compare the pad's table, whose last part was heard at ``heard_ms`` on the drone's clock.

        ``macs``: short address of each anchor.
        """
        told = sum(value != NO_RANGE for anchor in table.anchors for value in anchor.range_mm)
        if not told:
            return Comparison(0, 0, 0)
        columns = [
            _Column(
                [(t_ms, value) for t_ms, value in zip(table.t_ms, anchor.range_mm, strict=True) if value != NO_RANGE],
                *_unzip(self._by_mac.get(macs.get(anchor.anchor_id, -1), ())),
            )
            for anchor in table.anchors
        ]
        best = Comparison(told, 0, 0)
        for latency_ms in LATENCIES_MS:
            shift_ms = heard_ms - table.t_ms[-1] - latency_ms
            differences = sorted(difference for column in columns for difference in column.differences(shift_ms))
            if len(differences) * 100 < told * MIN_SHARE_PERCENT:
                continue
            found = Comparison(told, len(differences), differences[len(differences) // 2])
            if not best.pairs or found.median_mm < best.median_mm:
                best = found
        return best


@dataclass(frozen=True, slots=True)
class _Column:
    """One anchor: what the pad told and what the drone measured, both by time."""

    told: list[tuple[int, int]]
    times: list[int]
    ranges: list[int]

    def differences(self, shift_ms: int) -> list[int]:
        """Absolute differences between told ranges and the nearest own ones, under a shift of the clocks."""
        out: list[int] = []
        times, ranges, last = self.times, self.ranges, len(self.times) - 1
        for t_ms, range_mm in self.told:
            at = t_ms + shift_ms
            position = bisect_left(times, at)
            if position > last or (position and at - times[position - 1] < times[position] - at):
                position -= 1
            if position >= 0 and abs(times[position] - at) <= MAX_AGE_MS:
                out.append(abs(range_mm - ranges[position]))
        return out


def _unzip(pairs: Iterable[tuple[int, int]]) -> tuple[list[int], list[int]]:
    listed = list(pairs)
    return [t_ms for t_ms, _ in listed], [range_mm for _, range_mm in listed]
