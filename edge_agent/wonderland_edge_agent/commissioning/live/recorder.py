"""A calibration run as it happens: rounds of the pad's nodes to the tag, the reference beside them, both into files."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, Self

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland_edge_agent.commissioning.errors import RadioError
from wonderland_edge_agent.commissioning.recording import Point
from wonderland_edge_agent.session.gather import Round, RoundGatherer

BIN_M: Final = 2.0
SECTORS: Final = 12
FULL_S: Final = 6.0
"""So many seconds in a bin of distance, or in a sector, are enough."""


@dataclass
class Coverage:
    """What the run has seen so far. Seconds, by bin of distance and by sector about the anchors' middle."""

    rounds: int = 0
    ranges: dict[str, int] = field(default_factory=dict)
    distances_s: dict[int, float] = field(default_factory=dict)
    sectors_s: list[float] = field(default_factory=lambda: [0.0] * SECTORS)
    last_s: float | None = None
    unplaced: int = 0
    """Rounds at whose time no reference was known yet."""

    def add(self, t_s: float, distance_m: float, angle: float) -> None:
        """One round at a place."""
        worth = 0.0 if self.last_s is None else min(t_s - self.last_s, 0.5)
        self.last_s = t_s
        number = int(distance_m // BIN_M)
        self.distances_s[number] = self.distances_s.get(number, 0.0) + worth
        self.sectors_s[int(angle % (2 * math.pi) / (2 * math.pi) * SECTORS) % SECTORS] += worth

    def missing(self, reach_m: float) -> str:
        """What to do next, for the person who carries the drone; empty when nothing is missing."""
        bins = range(1, max(int(reach_m // BIN_M), 2))
        thin = [number for number in bins if self.distances_s.get(number, 0.0) < FULL_S]
        if thin:
            return f"go to about {thin[0] * BIN_M + BIN_M / 2:.0f} m from the pad"
        compass = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
        empty = [index for index, seconds in enumerate(self.sectors_s) if seconds < FULL_S]
        if empty:
            angle = (empty[0] + 0.5) * 360 / SECTORS
            return f"go round to the {compass[round(angle / 45) % 8]} of the pad"
        return ""

    def bars(self, reach_m: float) -> str:
        """Distances so far, one character for each bin."""
        marks = " ▁▂▃▄▅▆▇█"
        bins = range(max(int(reach_m // BIN_M), 2))
        return "".join(
            marks[min(int(self.distances_s.get(n, 0.0) / FULL_S * (len(marks) - 1)), len(marks) - 1)] for n in bins
        )


class RunRecorder:
    """Takes reports of nodes and positions of the reference; writes both at once, so that a power cut costs seconds.

    ``middle_m``: of the anchors. Use as a context manager. Raises RadioError when the disk does not take it.
    """

    def __init__(
        self,
        ranges: Path,
        reference: Path,
        time_stamps: Path,
        anchor_ids: Sequence[str],
        middle_m: Point,
        interval_ms: int,
        measured_ago_ms: int = 0,
    ) -> None:
        self.coverage = Coverage(ranges=dict.fromkeys(anchor_ids, 0))
        self.position: Point | None = None
        self.positions = 0
        self.stamps = 0
        """Time stamps of blinks."""
        self.no_stamps = ""
        """Why there are none, where a node said so."""
        self._names = tuple(anchor_ids)
        self._middle = middle_m
        self._gatherer = RoundGatherer(anchor_ids, interval_ms)
        self._paths = (ranges, reference, time_stamps)
        self._files: list[IO[str]] = []
        self._writers: list[Any] = []
        self._reference_s = -math.inf
        self._measured_ago_ms = measured_ago_ms
        self._round_ms = 0
        self._stamp_ms = 0

    def __enter__(self) -> Self:
        headers = (("t", "anchor", "range", "nlos"), ("t", "x", "y", "z"), ("t", "anchor", "blink", "ticks"))
        try:
            for path, header in zip(self._paths, headers, strict=True):
                file = path.open("w", newline="", encoding="utf-8", buffering=1)
                self._files.append(file)
                self._writers.append(csv.writer(file))
                self._writers[-1].writerow(header)
        except OSError as error:
            raise RadioError(
                f"{self._paths[0].parent}: the run cannot be written ({error.strerror or error})"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._write(self._gatherer.expire(1 << 62))
        for file in self._files:
            file.close()

    def range(self, anchor_id: str, t_ms: int, range_mm: int | None, *, nlos: bool) -> None:
        """One report of one node."""
        self._write(self._gatherer.add(anchor_id, t_ms, range_mm, nlos=nlos))

    def reference(self, t_s: float, point: Point) -> None:
        """One position of the reference; one that is older than the last is left out."""
        if t_s <= self._reference_s:
            return
        self._reference_s, self.position = t_s, point
        self.positions += 1
        self._row(1, (f"{t_s:.4f}", *(f"{value:.4f}" for value in point)))

    def stamp(self, anchor_id: str, t_ms: int, blink: int, ticks: int) -> None:
        """One node's time stamp of one blink; nodes are read one after the other, a recording's times rise."""
        self._stamp_ms = max(t_ms, self._stamp_ms)
        self.stamps += 1
        self._row(2, (f"{self._stamp_ms / 1000:.3f}", anchor_id, blink, ticks))

    def _write(self, rounds: Sequence[Round]) -> None:
        for item in rounds:
            self.coverage.rounds += 1
            # Reports that a busy computer read late fall into rounds of one time; a recording's times differ.
            self._round_ms = max(item.t_ms - self._measured_ago_ms, self._round_ms + 1)
            for name, range_mm, nlos in zip(self._names, item.range_mm, item.nlos, strict=True):
                if range_mm != NO_RANGE:
                    self.coverage.ranges[name] += 1
                    self._row(0, (f"{self._round_ms / 1000:.3f}", name, f"{range_mm / 1000:.3f}", int(nlos)))
            if self.position is None:
                self.coverage.unplaced += 1
                continue
            offset = [self.position[axis] - self._middle[axis] for axis in range(3)]
            self.coverage.add(item.t_ms / 1000, math.hypot(*offset), math.atan2(offset[1], offset[0]))

    def _row(self, which: int, row: Sequence[object]) -> None:
        try:
            self._writers[which].writerow(row)
        except OSError as error:
            raise RadioError(f"{self._paths[which]}: the run cannot be written ({error.strerror or error})") from error


def middle_of(places_m: Mapping[str, Point]) -> Point:
    """Of the anchors (m)."""
    count = len(places_m)
    x, y, z = (sum(place[axis] for place in places_m.values()) / count for axis in range(3))
    return (x, y, z)
