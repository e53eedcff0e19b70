"""The reference of a calibration run: where the drone truly was, from whatever knew it.

Four kinds of CSV are told apart by their header: ``t, x, y, z`` (s and m, in the pad's frame), ``t, lat, lon, height``
(RTK), a pose as ROS tools write it (``header.stamp…``, ``pose.position.x`` …; also with the prefix ``field.``), and an
export of Motive (NatNet's server), whose header has several rows.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from wonderland.proofs.records.pads import Frame
from wonderland_edge_agent.commissioning.errors import SurveyError, TruthError
from wonderland_edge_agent.commissioning.recording import MAX_ROWS, Point, Track
from wonderland_edge_agent.commissioning.survey_files import local_of

_NS_PER_S: Final = 1e9
_NANOSECONDS: Final = 1e14
"""A time stamp above this is nanoseconds, whatever its column says."""
_MILLISECONDS: Final = 1e11
_HEADER_ROWS: Final = 12

Reader = Callable[[Sequence[str]], tuple[float, Point]]


def load_track(path: Path, frame: Frame | None = None) -> Track:
    """Read a reference file. Times in s as the file has them. Raises TruthError."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            reader = _reader_of(path, rows, frame)
            times: list[float] = []
            points: list[Point] = []
            for row in rows:
                if not row or (len(row) == 1 and not row[0].strip()):
                    continue
                where = f"{path}, line {rows.line_num}"
                try:
                    t_s, point = reader(row)
                except (ValueError, IndexError):
                    if all(not cell.strip() for cell in row[2:]):
                        continue  # Motive leaves cells empty where it lost the body
                    raise TruthError(f"{where}: time and position are missing or no numbers") from None
                except SurveyError as error:
                    raise TruthError(f"{where}: {error}") from error
                if not all(math.isfinite(value) for value in (t_s, *point)):
                    continue  # a reference that knows nothing at this moment
                if times and t_s < times[-1]:
                    raise TruthError(f"{where}: time goes backwards ({t_s} after {times[-1]})")
                if times and t_s == times[-1]:
                    continue
                times.append(t_s)
                points.append(point)
                if len(times) > MAX_ROWS:
                    raise TruthError(f"{path}: more than {MAX_ROWS} positions")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TruthError(f"{path}: cannot be read ({error})") from error
    if len(times) < 2:
        raise TruthError(f"{path}: {len(times)} positions; a track needs more")
    return Track(tuple(times), tuple(points))


def _reader_of(path: Path, rows: Any, frame: Frame | None) -> Reader:
    header: list[list[str]] = []
    for row in rows:
        names = [cell.strip().lower() for cell in row]
        header.append(names)
        if _motive(names):
            return _motive_reader(path, header)
        plain = _plain(path, names, frame)
        if plain is not None:
            return plain
        if len(header) >= _HEADER_ROWS:
            break
    raise TruthError(
        f"{path}: no reference; it needs the columns t, x, y, z (s, m in the pad's frame) or t, lat, lon, height, a "
        "ROS pose, or an export of Motive"
    )


def _plain(path: Path, names: list[str], frame: Frame | None) -> Reader | None:
    clean = [name.removeprefix("field.").removeprefix("%") for name in names]
    when = _first(clean, ("header.stamp", "stamp", "t", "time", "timestamp"))
    seconds = _first(clean, ("header.stamp.sec", "header.stamp.secs", "sec", "secs"))
    fraction = _first(clean, ("header.stamp.nanosec", "header.stamp.nsecs", "nanosec", "nsecs"))

    def at(row: Sequence[str]) -> float:
        if when is None:
            return float(row[seconds or 0]) + float(row[fraction or 0]) / _NS_PER_S
        value = float(row[when])
        return value / _NS_PER_S if value > _NANOSECONDS else value / 1e3 if value > _MILLISECONDS else value

    if when is None and (seconds is None or fraction is None):
        return None
    for prefix in ("", "pose.position.", "pose.pose.position.", "position."):
        axes = [_first(clean, (f"{prefix}{axis}",)) for axis in "xyz"]
        if None not in axes:
            x, y, z = (axis for axis in axes if axis is not None)
            return lambda row: (at(row), (float(row[x]), float(row[y]), float(row[z])))
    lat = _first(clean, ("lat", "latitude"))
    lon = _first(clean, ("lon", "lng", "longitude"))
    height = _first(clean, ("height", "altitude", "alt", "h"))
    if lat is None or lon is None or height is None:
        return None
    if frame is None:
        raise TruthError(f"{path}: positions on the globe, but the survey has no origin there (--origin)")
    stands = frame

    def globe(row: Sequence[str]) -> tuple[float, Point]:
        place = (float(row[lat]), float(row[lon]), float(row[height]))
        if not all(math.isfinite(value) for value in place):
            return at(row), (math.nan, math.nan, math.nan)
        return at(row), local_of(stands, place, str(path))

    return globe


def _motive(names: list[str]) -> bool:
    return len(names) > 4 and names[0] == "frame" and names[1].startswith("time")


def _motive_reader(path: Path, header: list[list[str]]) -> Reader:
    """Columns Frame, Time (Seconds), then for each body rotation and position; Motive's y points up by default."""
    kinds = next((row for row in header if "position" in row), None)
    if kinds is None:
        raise TruthError(f"{path}: an export of Motive without positions; export the rigid body's position")
    first = kinds.index("position")
    if kinds[first : first + 3] != ["position"] * 3:
        raise TruthError(f"{path}: an export of Motive with incomplete positions")
    flat = " ".join(cell for row in header for cell in row)
    scale = 0.001 if "millimeters" in flat else 0.01 if "centimeters" in flat else 1.0

    def read(row: Sequence[str]) -> tuple[float, Point]:
        x, y, z = (float(row[first + axis]) * scale for axis in range(3))
        return float(row[1]), (x, -z, y)  # y up, right-handed: north is -z

    return read


def _first(names: list[str], wanted: Sequence[str]) -> int | None:
    return next((names.index(name) for name in wanted if name in names), None)
