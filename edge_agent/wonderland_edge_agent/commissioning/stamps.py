"""Time stamps of a tag's blinks as files: what each node's clock showed when it heard one.

Format (``docs/formats.md``): a row for each stamp with ``t`` (s, when the report came, on the ranges' clock),
``anchor``, ``blink`` (the tag's count of its frames) and ``ticks`` (15.65 ps each, of a counter of 40 bits). Where the
tag was is told by the recording of ranges beside it. Other columns are left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from wonderland.proofs.differences import MM_PER_TICK
from wonderland_edge_agent.commissioning.errors import RecordingError
from wonderland_edge_agent.commissioning.recording import Track, csv_rows, number, raised
from wonderland_edge_agent.commissioning.run import Floats, distances, truth_known
from wonderland_fira_uci.uci.ranging import CLOCK_BITS

M_PER_TICK: Final = MM_PER_TICK / 1000
WINDOW_S: Final = 1.0
"""Reports of one blink come within this; a count that is heard again later is another blink."""
_CLOCK: Final = 1 << CLOCK_BITS


@dataclass(frozen=True)
class StampedRun:
    """Blinks of one run: n frames, a anchors."""

    name: str
    anchor_ids: tuple[str, ...]
    t_s: Floats
    """(n,)"""
    late_m: Floats
    """(n, a) time stamp minus true distance, less what is common to the frame's anchors; NaN where one was deaf."""
    truthless: int
    """Frames left out: the truth has a gap there."""

    @classmethod
    def load(
        cls,
        path: Path,
        anchors_m: dict[str, tuple[float, float, float]],
        track: Track,
        *,
        shift_s: float,
        raise_m: float,
    ) -> StampedRun:
        """Read a file, with the truth of the run that it belongs to. Raises RecordingError."""
        frames = _frames(path, tuple(anchors_m))
        names = tuple(anchors_m)
        times = np.array([frame.t_s for frame in frames])
        known = truth_known(times, np.array(track.t_s) - shift_s)
        if not known.any():
            raise RecordingError(f"{path}: no truth at the time of its blinks; is it of another run, or another clock?")
        ticks = np.array([[frame.ticks.get(name, np.nan) for name in names] for frame in frames], dtype=float)[known]
        truth = np.array([raised(track.at(t_s + shift_s), raise_m) for t_s in times[known]])
        late = ticks * M_PER_TICK - distances(truth, np.array([anchors_m[name] for name in names]))
        return cls(path.name, names, times[known], late, int((~known).sum()))


@dataclass
class _Frame:
    t_s: float
    first: int
    ticks: dict[str, int]
    """Since the first stamp of the frame that was read."""


def _frames(path: Path, names: Sequence[str]) -> list[_Frame]:
    frames: list[_Frame] = []
    latest: dict[int, _Frame] = {}
    before_s = -np.inf
    for line, row in csv_rows(path, "t anchor blink ticks"):
        t_s, anchor = number(row, "t", path, line), row["anchor"]
        if t_s < before_s:
            raise RecordingError(f"{path}, line {line}: time goes backwards ({t_s} after {before_s})")
        before_s = t_s
        if anchor not in names:
            raise RecordingError(f"{path}, line {line}: anchor {anchor!r} is not in the survey")
        blink, ticks = (_count(row, name, path, line) for name in ("blink", "ticks"))
        frame = latest.get(blink)
        if frame is None or t_s - frame.t_s > WINDOW_S:
            frame = latest[blink] = _Frame(t_s, ticks, {})
            frames.append(frame)
        if anchor in frame.ticks:
            raise RecordingError(
                f"{path}, line {line}: anchor {anchor} stamped blink {blink} twice; remove one of them"
            )
        # The counter begins anew every 17 s: differences are taken the short way round.
        frame.ticks[anchor] = (ticks - frame.first + _CLOCK // 2) % _CLOCK - _CLOCK // 2
    if not frames:
        raise RecordingError(f"{path}: no time stamps in it")
    return frames


def _count(row: dict[str, str], name: str, path: Path, line: int) -> int:
    text = row[name]
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise RecordingError(f"{path}, line {line}: {name} is no whole number: {text[:40]!r}")
    return int(text)
