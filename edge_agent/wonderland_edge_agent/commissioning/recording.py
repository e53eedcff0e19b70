"""Recorded UWB ranges with truth, as files.

Format (``docs/formats.md``): ``RANGES.csv`` has a row for each range with ``t`` (s), ``anchor``, ``range`` (m), and
the true position ``gt_x``, ``gt_y``, ``gt_z`` (m) in the anchors' frame; ``ANCHORS.csv`` has ``anchor``, ``x``, ``y``,
``z`` (m). Other columns are left alone.
"""

from __future__ import annotations

import bisect
import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from wonderland_edge_agent.commissioning.errors import RecordingError

ROUND_GAP_S: Final = 0.03
"""Ranges of one round come within milliseconds, rounds apart by tens."""
FLAGGED_DB: Final = 10.0
"""Where a node only says that it is obstructed: the first path of a DW1000 that is so is 6 to 12 dB weaker."""
MAX_ROWS: Final = 5_000_000
MIN_ANCHORS: Final = 3
TRUTH_COLUMNS: Final = "gt_x gt_y gt_z"

Point = tuple[float, float, float]
"""x (east), y (north), z (up) in metres, in the anchors' frame."""


@dataclass(frozen=True)
class RecordedRound:
    """Ranges of one round by anchor (m), and the truth at its time."""

    t_s: float
    ranges_m: dict[str, float]
    truth_m: Point
    first_path_db: dict[str, float] = field(default_factory=dict)
    """By how much each anchor's first path is weaker than all that it received, where the radio tells."""


@dataclass(frozen=True)
class Track:
    """Where the drone truly was, by time: as recorded, neither shifted nor raised."""

    t_s: tuple[float, ...]
    points_m: tuple[Point, ...]

    def at(self, t_s: float) -> Point:
        """Linear between samples, constant before the first and after the last."""
        return _at(self.t_s, self.points_m, t_s)


@dataclass(frozen=True)
class Recording:
    """All rounds in order of time, and the anchors by name."""

    rounds: tuple[RecordedRound, ...]
    anchors: dict[str, Point]
    track: Track = field(default=Track((), ()), repr=False)
    """The truth of every row, for those who look for its delay."""
    truth_shift_s: float = 0.0
    truth_raise_m: float = 0.0

    @classmethod
    def load(
        cls,
        ranges: Path,
        anchors: Path,
        *,
        truth_shift_s: float = 0.0,
        truth_raise_m: float = 0.0,
        truthless: bool = False,
        reference: Track | None = None,
    ) -> Self:
        """Read both files. The truth that belongs to a range at t is the one at t + ``truth_shift_s``.

        ``truthless``: it may be missing, and is NaN then (``has_truth``). ``reference``: the truth, where it is
        elsewhere. Raises RecordingError.
        """
        nowhere = Track((0.0,), ((math.nan, math.nan, math.nan),))
        without = reference is None and truthless and not _has_columns(ranges, TRUTH_COLUMNS)
        return cls.of_rows(
            ranges,
            read_anchors(anchors),
            anchors.name,
            truth_shift_s=truth_shift_s,
            truth_raise_m=truth_raise_m,
            reference=nowhere if without else reference,
        )

    @property
    def has_truth(self) -> bool:
        """Whether anybody knew where the drone was."""
        return any(math.isfinite(value) for value in self.track.points_m[0]) if self.track.points_m else True

    @classmethod
    def of_rows(
        cls,
        ranges: Path,
        places: dict[str, Point],
        where: str,
        *,
        truth_shift_s: float,
        truth_raise_m: float,
        reference: Track | None = None,
    ) -> Self:
        """As ``load``, with anchors (m) that were read already, from ``where``; ``reference``: the truth, elsewhere.

        Raises RecordingError.
        """
        times: list[float] = []
        truths: list[Point] = []
        rows: list[tuple[float, str, float]] = []
        weaker: dict[tuple[float, str], float] = {}
        latest: dict[str, float] = {}
        columns = f"t anchor range {TRUTH_COLUMNS}" if reference is None else "t anchor range"
        for line, row in csv_rows(ranges, columns):
            t_s = number(row, "t", ranges, line)
            name = row["anchor"]
            if times and t_s < times[-1]:
                raise RecordingError(f"{ranges}, line {line}: time goes backwards ({t_s} after {times[-1]})")
            if name not in places:
                raise RecordingError(f"{ranges}, line {line}: anchor {name!r} is not in {where}")
            if latest.get(name) == t_s:
                raise RecordingError(
                    f"{ranges}, line {line}: anchor {name} has a second range at {t_s} s; remove one of them"
                )
            latest[name] = t_s
            rows.append((t_s, name, number(row, "range", ranges, line)))
            if (decibels := _first_path_db(row, ranges, line)) is not None:
                weaker[t_s, name] = decibels
            times.append(t_s)
            if reference is None:
                truths.append(vector(row, ("gt_x", "gt_y", "gt_z"), ranges, line))
        if not rows:
            raise RecordingError(f"{ranges}: no ranges in it")
        track = reference or Track(tuple(times), tuple(truths))
        grouped = tuple(
            RecordedRound(
                t_s,
                {name: range_m for _, name, range_m in of_round},
                raised(track.at(t_s + truth_shift_s), truth_raise_m),
                {name: weaker[at_s, name] for at_s, name, _ in of_round if (at_s, name) in weaker},
            )
            for t_s, of_round in gathered(rows)
        )
        return cls(grouped, dict(places), track, truth_shift_s, truth_raise_m)


def read_anchors(path: Path) -> dict[str, Point]:
    """Places of anchors (m) by name. Raises RecordingError."""
    places: dict[str, Point] = {}
    for line, row in csv_rows(path, "anchor x y z"):
        if row["anchor"] in places:
            raise RecordingError(f"{path}, line {line}: anchor {row['anchor']!r} is there twice; remove one of them")
        places[row["anchor"]] = vector(row, ("x", "y", "z"), path, line)
    if len(places) < MIN_ANCHORS:
        raise RecordingError(f"{path}: {len(places)} anchors; at least {MIN_ANCHORS} are needed")
    return places


def csv_rows(path: Path, columns: str) -> Iterator[tuple[int, dict[str, str]]]:
    """(line, row) of a CSV file with a header that has at least these columns. Raises RecordingError."""
    wanted = columns.split()
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            missing = [name for name in wanted if name not in (reader.fieldnames or ())]
            if not reader.fieldnames:
                raise RecordingError(f"{path}: the file is empty; it needs {', '.join(wanted)}")
            if missing:
                raise RecordingError(
                    f"{path}: no column {', '.join(missing)}; it needs {', '.join(wanted)}{_instead(reader.fieldnames)}"
                )
            for index, row in enumerate(reader):
                if index >= MAX_ROWS:
                    raise RecordingError(f"{path}: more than {MAX_ROWS} rows")
                if any(row[name] is None for name in wanted):
                    raise RecordingError(f"{path}, line {reader.line_num}: too few columns")
                yield reader.line_num, row
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: is no text; it needs the columns {', '.join(wanted)}, in UTF-8") from error
    except (OSError, csv.Error) as error:
        raise RecordingError(f"{path}: cannot be read ({error})") from error


def _instead(names: Sequence[str]) -> str:
    """What a file without the columns has, and what that looks like."""
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        return "; separate them by commas"
    return f"; it has {', '.join(name[:20] for name in names[:8])}"


def _has_columns(path: Path, columns: str) -> bool:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return set(columns.split()) <= set(csv.DictReader(file).fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error):
        return True  # reading it says what is wrong


def number(row: dict[str, str], name: str, path: Path, line: int) -> float:
    """A finite number of a row. Raises RecordingError."""
    try:
        value = float(row[name])
    except ValueError:
        raise RecordingError(f"{path}, line {line}: {name} is no number: {row[name][:40]!r}") from None
    if not math.isfinite(value):
        raise RecordingError(f"{path}, line {line}: {name} is {row[name]}")
    return value


def vector(row: dict[str, str], names: tuple[str, str, str], path: Path, line: int) -> Point:
    """Three finite numbers of a row. Raises RecordingError."""
    x, y, z = (number(row, name, path, line) for name in names)
    return (x, y, z)


def raised(point: Point, metres: float) -> Point:
    """The point, that much higher."""
    return (point[0], point[1], point[2] + metres)


def _first_path_db(row: dict[str, str], path: Path, line: int) -> float | None:
    """From ``rssi`` and ``rssi_fp`` (dBm), or the node's own flag ``nlos``; None where there is neither."""
    if row.get("rssi") and row.get("rssi_fp"):
        return number(row, "rssi", path, line) - number(row, "rssi_fp", path, line)
    if row.get("nlos"):
        return FLAGGED_DB if number(row, "nlos", path, line) else 0.0
    return None


Row = tuple[float, str, float]
"""t (s), anchor, range (m)."""


def gathered(rows: Sequence[Row]) -> Iterator[tuple[float, list[Row]]]:
    """(time, rows) of each round, from rows in order: a new one begins after a gap, or when an anchor speaks again."""
    values: list[Row] = []
    anchors: set[str] = set()
    for row in rows:
        if values and (row[0] - values[0][0] > ROUND_GAP_S or row[1] in anchors):
            yield values[0][0], values
            values, anchors = [], set()
        values.append(row)
        anchors.add(row[1])
    if values:
        yield values[0][0], values


def _at(times: Sequence[float], points: Sequence[Point], t_s: float) -> Point:
    index = bisect.bisect_left(times, t_s)
    if index == 0:
        return points[0]
    if index == len(times):
        return points[-1]
    before, after = times[index - 1], times[index]
    share = (t_s - before) / (after - before) if after > before else 0.0
    x, y, z = (a + (b - a) * share for a, b in zip(points[index - 1], points[index], strict=True))
    return (x, y, z)
