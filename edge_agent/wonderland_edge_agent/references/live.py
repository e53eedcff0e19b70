"""Where the drone truly is, while the pad proves: a live reference's last minutes, shown beside the estimates.

It is for people to watch. Nothing that the contract judges comes from here, and a reference that is away, late or
wrong keeps no drone from its proof.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from bisect import bisect_left
from collections import deque
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from wonderland_edge_agent.references import Point, SourceError
from wonderland_edge_agent.references.sources import Live, Source

if TYPE_CHECKING:
    from wonderland.clock import Clock

_log = logging.getLogger(__name__)

KEPT_S: Final = 120.0
MOST: Final = 60_000
"""Two minutes at 500 Hz."""
GAP_S: Final = 0.5
"""Nothing is said of what lies between two positions that are further apart than this."""
AGAIN_S: Final = 10.0
MAX_FILE_OCTETS: Final = 1 << 30
"""Three days at 100 Hz."""


class LiveTruth:
    """The last positions of a reference; `delay_ms`: so old they are when they come."""

    def __init__(self, delay_ms: int = 0, record: Path | None = None, uav_id: str | None = None) -> None:
        """``record``: a file to which positions are added; ``uav_id``: whose they are, None: whoever proves himself's.

        Raises OSError where the file cannot be written.
        """
        self._uav_id = uav_id
        self.last_s = -math.inf
        """Of the reference's last position."""
        self._delay_s = delay_ms / 1000
        self._times: deque[float] = deque(maxlen=MOST)
        self._points: deque[Point] = deque(maxlen=MOST)
        self._file: IO[str] | None = None
        if record is not None:
            self._file = record.open("a", encoding="utf-8", buffering=1)
            if self._file.tell() == 0:
                self._file.write("t,x,y,z\n")

    def reference(self, t_s: float, point: Point) -> None:
        """One position; one that is older than the last is left out."""
        t_s -= self._delay_s
        if t_s <= self.last_s:
            return
        self.last_s = t_s
        self._times.append(t_s)
        self._points.append(point)
        while self._times[0] < t_s - KEPT_S:
            self._times.popleft()
            self._points.popleft()
        self._write(t_s, point)

    def of(self, uav_id: str, t_ms: int) -> Point | None:
        """Where that drone was at a time (m); None where the reference is another one's, or says nothing."""
        return self.at(t_ms) if self._uav_id in {None, uav_id} else None

    def at(self, t_ms: int) -> Point | None:
        """The place at a time (m), between the two positions about it; None where they are far apart, or none."""
        t_s = t_ms / 1000
        after = bisect_left(self._times, t_s)
        if after >= len(self._times) or (after == 0 and self._times[0] != t_s):
            return None
        if self._times[after] == t_s:
            return self._points[after]
        begin_s, end_s = self._times[after - 1], self._times[after]
        if end_s - begin_s > GAP_S:
            return None
        share = (t_s - begin_s) / (end_s - begin_s)
        one, other = self._points[after - 1], self._points[after]
        x, y, z = (a + share * (b - a) for a, b in zip(one, other, strict=True))
        return (x, y, z)

    def close(self) -> None:
        """Nothing more is recorded."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, t_s: float, point: Point) -> None:
        if self._file is None:
            return
        try:
            self._file.write(f"{t_s:.4f},{','.join(f'{value:.4f}' for value in point)}\n")
            if self._file.tell() > MAX_FILE_OCTETS:
                raise OSError(f"larger than {MAX_FILE_OCTETS >> 30} GiB")  # noqa: TRY301 - as a full disk is
        except OSError as error:
            _log.error("the reference is recorded no longer: %s", error)
            with contextlib.suppress(OSError):
                self.close()


async def follow(source: Source, truth: LiveTruth, clock: Clock) -> None:
    """For ever: connects again where the reference went away."""
    while True:
        try:
            async with source.open(None, truth, clock) as live:
                await _watch(live, truth)
            _log.warning("reference: no position for %.0f s; connecting again", AGAIN_S)
        except SourceError as error:
            _log.warning("%s; again in %.0f s", error, AGAIN_S)
            await asyncio.sleep(AGAIN_S)


async def _watch(live: Live, truth: LiveTruth) -> None:
    """Until no position has come for a while."""
    said, last_s, silent_s = "", truth.last_s, 0.0
    while silent_s < AGAIN_S:
        await asyncio.sleep(1.0)
        silent_s = silent_s + 1.0 if truth.last_s == last_s else 0.0
        last_s = truth.last_s
        if live.problem and live.problem != said:
            _log.warning("reference: %s", live.problem)
        said = live.problem
