"""Recorded UWB ranges with truth: reading them, and what a pad would know about the radios that made them.

Format (``docs/formats.md``): ``RANGES.csv`` has a row for each range with ``t`` (s), ``anchor``, ``range`` (m), and
the true position ``gt_x``, ``gt_y``, ``gt_z`` (m) in the anchors' frame; ``ANCHORS.csv`` has ``anchor``, ``x``, ``y``,
``z`` (m). Other columns are left alone.
"""

from __future__ import annotations

import bisect
import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from edge_agent.geodesy import frame_at
from simulator.flight import Vector
from simulator.scenario import DAY_MS, AnchorSite, PadSite
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning

ROUND_GAP_S: Final = 0.03
"""Ranges of one round come within milliseconds, rounds apart by tens."""
MAX_ROWS: Final = 5_000_000
DW1000_SIGMA_MM: Final = 40
DW1000_BIAS_M: Final = ((0.0, 0.0), (8.0, 0.0), (16.0, 0.08), (30.0, 0.14), (100.0, 0.16))
"""Typical mean error by distance. Installations differ from it by several centimetres, hence the next two."""
DW1000_BIAS_SIGMA_MM: Final = 45
DW1000_INSTALLATION_MM: Final = 60


class RecordingError(Exception):
    """A file that is no recording; the text names file, line and column."""


@dataclass(frozen=True)
class RecordedRound:
    """Ranges of one round by anchor (m), and the truth at its time."""

    t_s: float
    ranges_m: dict[str, float]
    truth_m: Vector


@dataclass(frozen=True)
class Recording:
    """All rounds in order of time, and the anchors by name."""

    rounds: tuple[RecordedRound, ...]
    anchors: dict[str, Vector]

    @classmethod
    def load(cls, ranges: Path, anchors: Path, *, truth_shift_s: float = 0.0, truth_raise_m: float = 0.0) -> Recording:
        """Read both files. The truth that belongs to a range at t is the one at t + ``truth_shift_s``.

        Raises RecordingError.
        """
        places = {
            row["anchor"]: _vector(row, ("x", "y", "z"), anchors, line) for line, row in _rows(anchors, "anchor x y z")
        }
        if len(places) < 3:
            raise RecordingError(f"{anchors}: {len(places)} anchors; at least 3 are needed")
        times: list[float] = []
        truths: list[Vector] = []
        rows: list[tuple[float, str, float]] = []
        for line, row in _rows(ranges, "t anchor range gt_x gt_y gt_z"):
            t_s = _number(row, "t", ranges, line)
            if times and t_s < times[-1]:
                raise RecordingError(f"{ranges}, line {line}: time goes backwards ({t_s} after {times[-1]})")
            if row["anchor"] not in places:
                raise RecordingError(f"{ranges}, line {line}: anchor {row['anchor']!r} is not in {anchors.name}")
            rows.append((t_s, row["anchor"], _number(row, "range", ranges, line)))
            x, y, z = _vector(row, ("gt_x", "gt_y", "gt_z"), ranges, line)
            times.append(t_s)
            truths.append((x, y, z + truth_raise_m))
        if not rows:
            raise RecordingError(f"{ranges}: no ranges in it")
        grouped = tuple(
            RecordedRound(t_s, values, _at(times, truths, t_s + truth_shift_s)) for t_s, values in _rounds(rows)
        )
        return cls(grouped, places)

    def pad(self, pad_id: str = "recording") -> PadSite:
        """A pad with these anchors, standing in Turku: the recording has no place on the globe."""
        sites = tuple(
            AnchorSite(name, 0xA000 + index, x, y, z, 0.0)
            for index, (name, (x, y, z)) in enumerate(self.anchors.items())
        )
        return PadSite(pad_id, "Recording", 604_503_100, 222_712_400, 31_000, sites)


def dw1000_commissioning(pad: PadSite, now_ms: int) -> Commissioning:
    """What is known of DW1000 anchors that nobody calibrated: the chip's bias curve and how far units differ."""
    return Commissioning(
        frame=frame_at(pad.lat_e7, pad.lon_e7, pad.height_mm),
        anchors=tuple(
            Anchor(
                anchor_id=site.anchor_id,
                mac=site.mac,
                east_mm=round(site.east_m * 1000),
                north_mm=round(site.north_m * 1000),
                up_mm=round(site.up_m * 1000),
                survey_sigma_mm=10,
                bias=tuple(
                    BiasPoint(
                        range_mm=round(distance * 1000), bias_mm=round(bias * 1000), sigma_mm=DW1000_BIAS_SIGMA_MM
                    )
                    for distance, bias in DW1000_BIAS_M
                ),
            )
            for site in pad.anchors
        ),
        range_sigma_mm=DW1000_SIGMA_MM,
        installation_sigma_mm=DW1000_INSTALLATION_MM,
        max_range_mm=100_000,
        valid_from_ms=now_ms - DAY_MS,
        valid_until_ms=now_ms + DAY_MS,
        method="DW1000 bias curve from published measurements; not calibrated",
    )


def _rows(path: Path, columns: str) -> Iterator[tuple[int, dict[str, str]]]:
    wanted = columns.split()
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in wanted if name not in (reader.fieldnames or ())]
            if missing:
                raise RecordingError(f"{path}: no column {', '.join(missing)}; it needs {', '.join(wanted)}")
            for index, row in enumerate(reader):
                if index >= MAX_ROWS:
                    raise RecordingError(f"{path}: more than {MAX_ROWS} rows")
                if any(row[name] is None for name in wanted):
                    raise RecordingError(f"{path}, line {reader.line_num}: too few columns")
                yield reader.line_num, row
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: cannot be read ({error})") from error


def _number(row: dict[str, str], name: str, path: Path, line: int) -> float:
    try:
        value = float(row[name])
    except ValueError:
        raise RecordingError(f"{path}, line {line}: {name} is no number: {row[name][:40]!r}") from None
    if not math.isfinite(value):
        raise RecordingError(f"{path}, line {line}: {name} is {row[name]}")
    return value


def _vector(row: dict[str, str], names: tuple[str, str, str], path: Path, line: int) -> Vector:
    x, y, z = (_number(row, name, path, line) for name in names)
    return (x, y, z)


def _rounds(rows: Sequence[tuple[float, str, float]]) -> Iterator[tuple[float, dict[str, float]]]:
    """Rows gathered into rounds: a new one begins after a gap, or when an anchor speaks again."""
    start, values = rows[0][0], dict[str, float]()
    for t_s, anchor, range_m in rows:
        if values and (t_s - start > ROUND_GAP_S or anchor in values):
            yield start, values
            start, values = t_s, {}
        elif not values:
            start = t_s
        values[anchor] = range_m
    if values:
        yield start, values


def _at(times: Sequence[float], truths: Sequence[Vector], t_s: float) -> Vector:
    """The truth at a time, linear between its samples."""
    index = bisect.bisect_left(times, t_s)
    if index == 0:
        return truths[0]
    if index == len(times):
        return truths[-1]
    before, after = times[index - 1], times[index]
    share = (t_s - before) / (after - before) if after > before else 0.0
    x, y, z = (a + (b - a) * share for a, b in zip(truths[index - 1], truths[index], strict=True))
    return (x, y, z)
