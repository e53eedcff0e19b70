"""Rounds out of the reports of several nodes, which nothing but time aligns.

Every node numbers its own reports and runs its own timer, so that sequence numbers say nothing about each other. All
nodes hear the same frames of the drone, though, and report within a few milliseconds. A round is what arrives within
less than one ranging interval of its first report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.records.sessions import NO_RANGE

WINDOW_PERCENT: Final = 70
"""Share of the interval in which reports belong together: more than any serial line delays, less than a whole one."""
RESOLUTION_MM: Final = 10
"""UCI reports whole centimetres and the compact form of the ranges carries no more."""


@dataclass(frozen=True, slots=True)
class Round:
    """One round: ``range_mm`` and ``nlos`` by position of the anchor; NO_RANGE where it measured nothing."""

    t_ms: int
    range_mm: tuple[int, ...]
    nlos: tuple[bool, ...]

    @property
    def count(self) -> int:
        """How many anchors measured a range."""
        return len(self.range_mm) - self.range_mm.count(NO_RANGE)


class RoundGatherer:
    """Groups reports by their time of arrival. Rounds come out in order of time."""

    def __init__(self, anchor_ids: Sequence[str], interval_ms: int) -> None:
        self._index = {anchor_id: index for index, anchor_id in enumerate(anchor_ids)}
        self._window_ms = max(1, interval_ms * WINDOW_PERCENT // 100)
        self._start_ms: int | None = None
        self._ranges: list[int] = []
        self._nlos: list[bool] = []
        self._seen: set[int] = set()
        self._last_ms = 0

    @property
    def closes_ms(self) -> int | None:
        """When the round under way closes without the reports that are still missing."""
        return None if self._start_ms is None else self._start_ms + self._window_ms

    def add(self, anchor_id: str, t_ms: int, range_mm: int | None, *, nlos: bool = False) -> list[Round]:
        """Take a report; returns the rounds that it closes. Anchors that the pad does not have are left out."""
        index = self._index.get(anchor_id)
        if index is None:
            return []
        done: list[Round] = []
        if self._start_ms is not None and (
            index in self._seen or not self._start_ms <= t_ms < self._start_ms + self._window_ms
        ):
            done.extend(self._close())
        if self._start_ms is None:
            # Times of rounds never go back, even where two ports were read in another order than they spoke.
            self._start_ms = max(t_ms, self._last_ms)
            self._ranges = [NO_RANGE] * len(self._index)
            self._nlos = [False] * len(self._index)
        self._seen.add(index)
        if range_mm is not None:
            self._ranges[index] = (range_mm + RESOLUTION_MM // 2) // RESOLUTION_MM * RESOLUTION_MM
            self._nlos[index] = nlos
        if len(self._seen) == len(self._index):
            done.extend(self._close())
        return done

    def expire(self, now_ms: int) -> list[Round]:
        """The round under way, if its time is up."""
        closes_ms = self.closes_ms
        return self._close() if closes_ms is not None and now_ms >= closes_ms else []

    def _close(self) -> list[Round]:
        if self._start_ms is None:
            return []
        done = Round(self._start_ms, tuple(self._ranges), tuple(self._nlos))
        self._last_ms, self._start_ms = self._start_ms, None
        self._seen.clear()
        return [done] if done.count else []
