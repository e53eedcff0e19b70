"""Blinks of the drone as all nodes time-stamped them: grouped by number, subtracted, kept for the contract.

A stamp counts ticks of a 40-bit counter that begins anew every 17.2 s; only differences within one blink are used, and
these are taken modulo the counter. A blink counts only with the answer that nobody but the drone can give.
"""

from __future__ import annotations

import hmac
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from wonderland.proofs.records.sessions import MAX_FRAMES, NO_TICK, AnchorTicks, TimeStamps
from wonderland_fira_uci.uci.ranging import CLOCK_BITS

WINDOW_MS: Final = 40
"""A blink is complete, or as complete as it will be, so long after the first report of it."""
MAX_OPEN: Final = 8
"""Blinks of which not all nodes have reported yet; the oldest is closed when there are more."""
MAX_TICKS: Final = 1 << 17
"""600 m of light: two anchors of one pad never hear one frame further apart. Such a stamp is left out."""
_CLOCK: Final = 1 << CLOCK_BITS
_HALF: Final = 1 << (CLOCK_BITS - 1)


@dataclass(slots=True)
class _Blink:
    """One blink whose reports come in."""

    t_ms: int
    ticks: dict[int, int] = field(default_factory=dict)


class FrameGatherer:
    """Takes reports of single nodes; ``stamps`` is the record of what they make together.

    ``bound_by`` says what ties the blinks to the session, as in the record ``TimeStamps``.
    """

    def __init__(self, anchor_ids: Sequence[str], bound_by: str) -> None:
        self.anchor_ids = tuple(anchor_ids)
        self._bound_by = bound_by
        self._index = {anchor_id: index for index, anchor_id in enumerate(self.anchor_ids)}
        self._answer: bytes | None = None
        self._open: dict[int, _Blink] = {}
        self._last = -1
        self._t_ms: list[int] = []
        self._columns: list[list[int]] = [[] for _ in self.anchor_ids]
        self.frozen = False
        self.foreign = 0
        """Reports of blinks without the right answer."""

    @property
    def frames(self) -> int:
        """Blinks gathered."""
        return len(self._t_ms)

    def expect(self, answer: bytes) -> None:
        """From now on blinks with this answer count."""
        self._answer = answer

    def add(self, anchor_id: str, t_ms: int, number: int, ticks: int, payload: bytes) -> None:
        """One node's report of one blink."""
        index = self._index.get(anchor_id)
        if index is None or self.frozen or self._answer is None:
            return
        if not hmac.compare_digest(payload, self._answer):
            self.foreign += 1
            return
        self.expire(t_ms)
        if number <= self._last:  # closed already, or a node that starts to count anew
            return
        blink = self._open.get(number)
        if blink is None:
            blink = self._open[number] = _Blink(t_ms)
        blink.ticks.setdefault(index, ticks % _CLOCK)
        if len(blink.ticks) == len(self.anchor_ids) or len(self._open) > MAX_OPEN:
            self._close_to(number if len(blink.ticks) == len(self.anchor_ids) else min(self._open))

    def expire(self, now_ms: int) -> None:
        """Close the blinks whose time is up."""
        due = [number for number, blink in self._open.items() if now_ms - blink.t_ms >= WINDOW_MS]
        if due:
            self._close_to(max(due))

    def stamps(self) -> TimeStamps | None:
        """The record; None before the first blink."""
        if not self._t_ms:
            return None
        before = self._t_ms[0]
        gaps = []
        for t_ms in self._t_ms:
            gaps.append(t_ms - before)
            before = t_ms
        return TimeStamps(
            start_ms=self._t_ms[0],
            gap_ms=tuple(gaps),
            anchors=tuple(
                AnchorTicks(anchor_id=anchor_id, ticks=tuple(column))
                for anchor_id, column in zip(self.anchor_ids, self._columns, strict=True)
            ),
            bound_by=self._bound_by,
        )

    def _close_to(self, number: int) -> None:
        """Keep what the blinks up to this number brought, in their order."""
        for known in sorted(self._open):
            if known > number:
                return
            self._keep(self._open.pop(known))
            self._last = known

    def _keep(self, blink: _Blink) -> None:
        if len(blink.ticks) < 2 or len(self._t_ms) >= MAX_FRAMES:
            return
        reference = next(iter(blink.ticks.values()))
        # Which one came first is not known before the counter's end is taken into account.
        after = {index: (ticks - reference + _HALF) % _CLOCK - _HALF for index, ticks in blink.ticks.items()}
        middle = sorted(after.values())[len(after) // 2]
        after = {index: ticks for index, ticks in after.items() if abs(ticks - middle) <= MAX_TICKS}
        first = min(after.values())
        self._t_ms.append(max(blink.t_ms, self._t_ms[-1] if self._t_ms else 0))
        for index, column in enumerate(self._columns):
            column.append(after[index] - first if index in after else NO_TICK)
