"""The ranges of a session: their compact form for the radio, and which of them are usable.

Compact form (little-endian), so that forty rounds of four anchors are 408 bytes on the air: version u8, anchors u8,
first time u48 ms, then for each round: time since the one before u16 ms, and for each anchor its range u16 in cm
(0xFFFF where there is none). UCI reports whole centimetres, so nothing is lost.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import MAX_ROUNDS, NO_RANGE, AnchorRanges, RangeTable

_VERSION: Final = 1
_NONE_CM: Final = 0xFFFF
_MAX_GAP_MS: Final = 0xFFFF
MIN_ANCHORS: Final = 3
"""A horizontal position needs three ranges; with fewer a round decides nothing."""


class RoundsError(ProofError):
    """Ranges that the compact form can not hold, or bytes that are not one."""


@dataclass(frozen=True, slots=True)
class UsableRounds:
    """The rounds that a verdict may rest on, by column."""

    t_ms: tuple[int, ...]
    anchor_indices: tuple[int, ...]
    """Positions in the commissioning's list of anchors."""
    range_mm: tuple[tuple[int, ...], ...]
    """For each anchor: a range or NO_RANGE for each of the rounds."""
    discarded: int
    """Rounds with too few ranges."""
    obstructed: int
    """Ranges left out because their anchor saw an obstruction."""
    span_ms: tuple[int, int]
    """First and last moment of all rounds that were brought, usable or not; zeros where there is none."""


def usable(table: RangeTable, anchor_ids: Sequence[str], max_range_mm: int) -> UsableRounds:
    """Rounds in which at least three known anchors have a plausible, unobstructed range; in order of time."""
    known = {anchor_id: index for index, anchor_id in enumerate(anchor_ids)}
    columns: dict[int, tuple[int, ...]] = {}
    obstructed = 0
    whole = True
    for anchor in table.anchors:
        index = known.get(anchor.anchor_id)
        if index is None:
            continue
        values = anchor.range_mm
        if values and not 0 < min(values) <= max(values) <= max_range_mm:
            values = tuple([value if 0 < value <= max_range_mm else NO_RANGE for value in values])
            whole = False
        if anchor.nlos:
            values, without = _unobstructed(values, anchor.nlos)
            obstructed += without
            whole = False
        columns[index] = values
    times = table.t_ms
    everything = list(range(len(times)))
    kept = everything if list(times) == sorted(times) else sorted(everything, key=times.__getitem__)
    indices = tuple(sorted(columns))
    chosen = [columns[index] for index in indices]
    if len(chosen) < MIN_ANCHORS or not whole:
        heard = [len(row) - row.count(NO_RANGE) for row in zip(*chosen, strict=True)]
        kept = [position for position in kept if heard and heard[position] >= MIN_ANCHORS]
    if kept != everything:
        times = tuple([times[position] for position in kept])
        chosen = [tuple([column[position] for position in kept]) for column in chosen]
    return UsableRounds(
        t_ms=times,
        anchor_indices=indices,
        range_mm=tuple(chosen),
        discarded=len(table.t_ms) - len(kept),
        obstructed=obstructed,
        span_ms=(min(table.t_ms, default=0), max(table.t_ms, default=0)),
    )


def _unobstructed(values: tuple[int, ...], nlos: Sequence[int]) -> tuple[tuple[int, ...], int]:
    """The ranges without those of obstructed rounds, and how many that leaves out."""
    seen = list(values)
    for round_index in nlos:
        if round_index < len(seen):
            seen[round_index] = NO_RANGE
    return tuple(seen), seen.count(NO_RANGE) - values.count(NO_RANGE)


def pack(table: RangeTable) -> bytes:
    """The compact form; raises RoundsError where times do not rise or a range is no whole centimetre."""
    first = table.t_ms[0] if table.t_ms else 0
    parts = [struct.pack("<BB", _VERSION, len(table.anchors)), first.to_bytes(6, "little")]
    row = struct.Struct(f"<{1 + len(table.anchors)}H")
    before = first
    for position, t_ms in enumerate(table.t_ms):
        gap = t_ms - before
        if not 0 <= gap <= _MAX_GAP_MS:
            raise RoundsError(f"round {position} is {gap} ms after the one before; the compact form holds 0..65535")
        before = t_ms
        parts.append(row.pack(gap, *(_to_cm(anchor.range_mm[position]) for anchor in table.anchors)))
    return b"".join(parts)


def unpack(data: bytes, anchor_ids: Sequence[str]) -> RangeTable:
    """The table in ``data``; raises RoundsError for bytes that are no compact form for these anchors."""
    if len(data) < 8 or data[0] != _VERSION:
        raise RoundsError("not a compact table of ranges, version 1")
    count = data[1]
    if count != len(anchor_ids):
        raise RoundsError(f"the table has {count} anchors, expected are {len(anchor_ids)}")
    row = struct.Struct(f"<{1 + count}H")
    body = data[8:]
    if len(body) % row.size or len(body) // row.size > MAX_ROUNDS:
        raise RoundsError(f"{len(body)} bytes are no whole number of rounds, or more than {MAX_ROUNDS}")
    t_ms = int.from_bytes(data[2:8], "little")
    times: list[int] = []
    columns: list[list[int]] = [[] for _ in anchor_ids]
    for gap, *centimetres in row.iter_unpack(body):
        t_ms += gap
        times.append(t_ms)
        for column, value in zip(columns, centimetres, strict=True):
            column.append(NO_RANGE if value == _NONE_CM else value * 10)
    return RangeTable(
        t_ms=tuple(times),
        anchors=tuple(
            AnchorRanges(anchor_id=anchor_id, range_mm=tuple(column))
            for anchor_id, column in zip(anchor_ids, columns, strict=True)
        ),
    )


def _to_cm(range_mm: int) -> int:
    if range_mm == NO_RANGE:
        return _NONE_CM
    if range_mm % 10 or not 0 <= range_mm < _NONE_CM * 10:
        raise RoundsError(f"a range of {range_mm} mm is no whole centimetre below 655 m")
    return range_mm // 10
