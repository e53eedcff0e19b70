"""`judge`: ranges that are in memory already, judged by the contract's own function.

Arrays or data frames in, verdicts out; no file, radio or ledger takes part. What a frame is, is taken from what it can
do (``columns``, and a column by its name): pandas' can (tested), and pandas is not needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commissioning.recording import MIN_ANCHORS, Point, Row, gathered
from wonderland_research.evaluate import Claimed, Window, commissioning_of, policy_of, windows_of
from wonderland_research.evaluate import judge as judge_window
from wonderland_simulator.recording import RecordedRound, Recording, RecordingError

__all__ = ["InputError", "Window", "judge"]

NOWHERE: Final = (math.nan, math.nan, math.nan)


class InputError(ValueError):
    """What was given cannot be judged; the text says which argument, what is wrong with it, and what would do."""


def judge(
    ranges: Any,
    anchors: Any,
    claims: Any,
    commissioning: Commissioning | Mapping[str, Any] | str | Path | None = None,
    *,
    t_s: ArrayLike | None = None,
    truth: Any = None,
    rounds: int = 20,
    buffer_m: float = 1.0,
) -> list[Window]:
    """The contract's verdict on every whole window of `rounds` rounds, were the drone to countersign them.

    ranges: metres. An array (rounds x anchors, NaN where an anchor has none) with `t_s`; a frame with columns t,
        anchor, range (a row for each range, in order of time), or with t and one column for each anchor.
    anchors: metres, east, north, up. A mapping from name to place, a frame with columns anchor, x, y, z, or an array
        (anchors x 3), whose names are "0", "1", …
    claims: metres, where the drone says that it is. An array (rounds x 3), or a frame with t, x, y, z, between whose
        rows is interpolated.
    commissioning: what is known of these anchors: a record, its JSON, or a file; None: an uncalibrated DW1000's.
    t_s: seconds, of each round of an array.
    truth: like `claims`, where known; each window then has its `truth_error_m`.

    Raises InputError.
    """
    try:
        places = _places(anchors)
        recorded = _rounds(ranges, list(places), t_s)
        times = [item.t_s for item in recorded]
        if truth is not None:
            true = _path("truth", truth, times)
            recorded = [RecordedRound(item.t_s, item.ranges_m, true(item.t_s, NOWHERE)) for item in recorded]
        said = _path("claims", claims, times)
        _whole("rounds", rounds, 1, 500)
        if not 0.1 <= buffer_m <= 100.0:
            raise InputError(f"buffer_m: {buffer_m} m; between 0.1 and 100 are judged")
        known = _known(commissioning, Recording(tuple(recorded), places))
        policy = policy_of(buffer_m, rounds)
        return [judge_window(window, known, policy, said) for window in windows_of(recorded, rounds)]
    except (RecordingError, ProofError) as error:
        raise InputError(str(error)) from error


def _is_frame(value: Any) -> bool:
    return hasattr(value, "columns") and hasattr(value, "__getitem__")


def _column(name: str, frame: Any, column: str) -> NDArray[Any]:
    if column not in frame.columns:
        has = ", ".join(map(str, frame.columns))
        raise InputError(f"{name}: a frame without a column {column!r}; it has {has}")
    return np.asarray(frame[column])


def _numbers(name: str, values: Any, *, finite: bool = True) -> NDArray[np.float64]:
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: no numbers ({error})") from None
    if finite and not np.isfinite(found).all():
        raise InputError(f"{name}: has values that are not finite")
    return found


def _whole(name: str, value: int, least: int, most: int) -> None:
    if not least <= value <= most:
        raise InputError(f"{name}: {value}; between {least} and {most}")


def _table(name: str, values: Any, columns: int, *, finite: bool = True) -> NDArray[np.float64]:
    found = _numbers(name, values, finite=finite)
    if found.ndim != 2 or found.shape[1] != columns:
        raise InputError(f"{name}: an array of shape {found.shape}; (n, {columns}) is needed")
    return found


def _rising(name: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
    if times.ndim != 1 or len(times) == 0:
        raise InputError(f"{name}: an array of shape {times.shape}; one time (s) for each row is needed")
    if (np.diff(times) < 0).any():
        raise InputError(f"{name}: time goes backwards; sort by it")
    return times


def _places(anchors: Any) -> dict[str, Point]:
    if _is_frame(anchors):
        names = [str(name) for name in _column("anchors", anchors, "anchor")]
        table = np.stack([_numbers("anchors", _column("anchors", anchors, axis)) for axis in "xyz"], axis=1)
    elif isinstance(anchors, Mapping):
        names = [str(name) for name in anchors]
        table = _table("anchors", list(anchors.values()), 3)
    else:
        table = _table("anchors", anchors, 3)
        names = [str(index) for index in range(len(table))]
    if len(set(names)) < len(names):
        raise InputError("anchors: one name is there twice")
    if len(names) < MIN_ANCHORS:
        raise InputError(f"anchors: {len(names)}; at least {MIN_ANCHORS} are needed")
    return {name: (float(x), float(y), float(z)) for name, (x, y, z) in zip(names, table, strict=True)}


def _rounds(ranges: Any, names: Sequence[str], t_s: ArrayLike | None) -> list[RecordedRound]:
    if _is_frame(ranges):
        if t_s is not None:
            raise InputError("t_s: is for arrays; a frame has its times in column t")
        times = _rising("ranges", _numbers("ranges: t", _column("ranges", ranges, "t")))
        if "anchor" in ranges.columns:
            return _of_rows(times, ranges, names)
        table = np.stack([_numbers("ranges", _column("ranges", ranges, name), finite=False) for name in names], axis=1)
    else:
        if t_s is None:
            raise InputError("t_s: say when each round was (seconds); an array does not")
        times = _rising("t_s", _numbers("t_s", t_s))
        table = _table("ranges", ranges, len(names), finite=False)
    if len(times) != len(table):
        raise InputError(f"t_s: {len(times)} times for {len(table)} rounds")
    return [
        RecordedRound(
            float(at_s),
            {name: float(value) for name, value in zip(names, row, strict=True) if math.isfinite(value)},
            NOWHERE,
        )
        for at_s, row in zip(times, table, strict=True)
    ]


def _of_rows(times: NDArray[np.float64], ranges: Any, names: Sequence[str]) -> list[RecordedRound]:
    measured = _numbers("ranges: range", _column("ranges", ranges, "range"))
    who = [str(name) for name in _column("ranges", ranges, "anchor")]
    if unknown := sorted(set(who) - set(names)):
        raise InputError(f"ranges: of {', '.join(unknown[:8])}, which anchors does not have")
    rows: list[Row] = [(float(t), name, float(value)) for t, name, value in zip(times, who, measured, strict=True)]
    return [RecordedRound(t, {name: value for _, name, value in of_round}, NOWHERE) for t, of_round in gathered(rows)]


def _path(name: str, path: Any, times: Sequence[float]) -> Claimed:
    """Where it is at a time: of an array, at the rounds' times; of a frame, between its rows."""
    if _is_frame(path):
        at_s = _rising(name, _numbers(f"{name}: t", _column(name, path, "t")))
        table = np.stack([_numbers(name, _column(name, path, axis)) for axis in "xyz"], axis=1)
        if at_s[-1] < times[0] or at_s[0] > times[-1]:
            raise InputError(
                f"{name}: from {at_s[0]:g} to {at_s[-1]:g} s, the ranges from {times[0]:g} to {times[-1]:g} s"
            )
    else:
        at_s, table = np.asarray(times), _table(name, path, 3)
        if len(table) != len(times):
            raise InputError(f"{name}: {len(table)} places for {len(times)} rounds")
    axes = [table[:, axis] for axis in range(3)]

    def at(t_s: float, _: Point) -> Point:
        east, north, up = (float(np.interp(t_s, at_s, axis)) for axis in axes)
        return (east, north, up)

    return at


def _known(given: Commissioning | Mapping[str, Any] | str | Path | None, recording: Recording) -> Commissioning:
    if isinstance(given, str):
        given = Path(given)
    elif isinstance(given, Mapping):
        try:
            given = Commissioning.parse(dict(given))
        except ProofError as error:
            raise InputError(f"commissioning: no record of one ({error})") from error
    return commissioning_of(given, recording)
