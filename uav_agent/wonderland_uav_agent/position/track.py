"""A recorded track as a position source: CSV with t_ms, lat_e7, lon_e7, height_mm, accuracy_mm, height_accuracy_mm.

Times count from the track's first row, which is replayed at the moment the source is started; between rows the
position moves on a straight line, after the last it stays.
"""

from __future__ import annotations

import csv
import itertools
from bisect import bisect_right
from pathlib import Path
from typing import Final

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.source import PositionError

MAX_FILE_BYTES: Final = 64 << 20
COLUMNS: Final = ("t_ms", "lat_e7", "lon_e7", "height_mm", "accuracy_mm", "height_accuracy_mm")


class TrackPosition:
    """Replays rows (claims with rising times) from ``start_ms`` on."""

    def __init__(self, rows: list[Claim], start_ms: int) -> None:
        if not rows:
            raise PositionError("the track has no rows")
        if any(after.t_ms <= before.t_ms for before, after in itertools.pairwise(rows)):
            raise PositionError("the track's times do not rise")
        self._rows = rows
        self._times = [row.t_ms - rows[0].t_ms for row in rows]
        self._start_ms = start_ms

    @property
    def duration_ms(self) -> int:
        """How long the track moves."""
        return self._times[-1]

    @classmethod
    def load(cls, path: Path, start_ms: int) -> TrackPosition:
        """Read a file. Raises PositionError, which names the line."""
        try:
            if path.stat().st_size > MAX_FILE_BYTES:
                raise PositionError(f"{path}: larger than {MAX_FILE_BYTES} bytes; is it the right file?")
            with path.open(newline="", encoding="utf-8") as file:
                return cls([_row(path, number, row) for number, row in enumerate(csv.DictReader(file), 2)], start_ms)
        except OSError as cause:
            raise PositionError(f"{path}: cannot be read ({cause.strerror or cause})") from cause
        except (UnicodeDecodeError, csv.Error) as cause:
            raise PositionError(f"{path}: no CSV: {cause}") from cause

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        return "" if self.claim(now_ms) is not None else "the recorded track has not begun"

    def claim(self, now_ms: int) -> Claim | None:
        """The position at this moment; None before the start."""
        at = now_ms - self._start_ms
        if at < 0:
            return None
        index = bisect_right(self._times, at) - 1
        before = self._rows[index]
        if index + 1 == len(self._rows):
            return _moved(before, before, 0, 1, now_ms)
        span = self._times[index + 1] - self._times[index]
        return _moved(before, self._rows[index + 1], at - self._times[index], span, now_ms)


def _row(path: Path, number: int, row: dict[str | None, str]) -> Claim:
    try:
        return Claim.parse({name: int(row[name]) for name in COLUMNS})
    except KeyError as cause:
        raise PositionError(f"{path}: column {cause} is missing; a track has {', '.join(COLUMNS)}") from None
    except (ValueError, TypeError, ProofError) as cause:
        raise PositionError(f"{path}, line {number}: {cause}") from None


def _moved(before: Claim, after: Claim, part: int, whole: int, now_ms: int) -> Claim:
    def between(name: str) -> int:
        start, end = getattr(before, name), getattr(after, name)
        return int(start + (end - start) * part // whole)

    return Claim(
        lat_e7=between("lat_e7"),
        lon_e7=between("lon_e7"),
        height_mm=between("height_mm"),
        accuracy_mm=between("accuracy_mm"),
        height_accuracy_mm=between("height_accuracy_mm"),
        t_ms=now_ms,
    )
