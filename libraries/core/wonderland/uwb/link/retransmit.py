"""Reliability of one direction: what to repeat (sender) and what was heard (receiver). No bytes of the wire here."""

from __future__ import annotations

import struct
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

WINDOW: Final = 128
"""Segments that may be under way at once: the receiver's memory and the acknowledgement's bitmap are that large."""
_BASE: Final = struct.Struct(">I")
MAX_ACKNOWLEDGEMENT_OCTETS: Final = _BASE.size + WINDOW // 8


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Every sequence number below ``base`` was received, and ``base + 1 + i`` for each set bit ``i`` of ``bitmap``."""

    base: int
    bitmap: int

    def encode(self) -> bytes:
        """4 octets of base, then the bitmap, least significant bit first, without trailing zero octets."""
        return _BASE.pack(self.base) + self.bitmap.to_bytes(-(-self.bitmap.bit_length() // 8), "little")

    @classmethod
    def decode(cls, text: bytes) -> Acknowledgement | None:
        """None when the length is impossible."""
        if not _BASE.size <= len(text) <= MAX_ACKNOWLEDGEMENT_OCTETS:
            return None
        return cls(_BASE.unpack_from(text)[0], int.from_bytes(text[_BASE.size :], "little"))

    def covers(self, sequence: int) -> bool:
        """Whether ``sequence`` was received."""
        behind = sequence - self.base
        return behind < 0 or (behind > 0 and bool(self.bitmap >> (behind - 1) & 1))


@dataclass(slots=True)
class _Outgoing:
    frame: bytes
    message_id: int
    queued_ms: int
    sent_ms: int = 0
    sent_order: int = 0  # 0: never sent


class SendWindow:
    """Frames not yet acknowledged, in order. A frame is sealed once and only ever repeated as it is."""

    def __init__(self, retransmit_after_ms: int) -> None:
        self._retransmit_after_ms = retransmit_after_ms
        self._frames: OrderedDict[int, _Outgoing] = OrderedDict()
        self._left: dict[int, int] = {}  # message id -> segments not yet acknowledged
        self._order = 0
        self.retransmissions = 0

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def oldest_ms(self) -> int | None:
        """When the oldest frame still waiting was queued."""
        return next(iter(self._frames.values())).queued_ms if self._frames else None

    def add(self, sequence: int, frame: bytes, message_id: int, now_ms: int) -> None:
        """Queues a sealed frame; sequence numbers come in ascending order."""
        self._frames[sequence] = _Outgoing(frame, message_id, now_ms)
        self._left[message_id] = self._left.get(message_id, 0) + 1

    def _in_window(self) -> list[_Outgoing]:
        if not self._frames:
            return []
        limit = next(iter(self._frames)) + WINDOW
        return [waiting for sequence, waiting in self._frames.items() if sequence < limit]

    def due(self, octets: int, now_ms: int) -> list[bytes]:
        """Frames that are new or whose acknowledgement is overdue, as many as fit; marks them as sent now."""
        out: list[bytes] = []
        for waiting in self._in_window():
            if waiting.sent_order and now_ms - waiting.sent_ms < self._retransmit_after_ms:
                continue
            octets -= len(waiting.frame)
            if octets < 0:
                break
            self._order += 1
            self.retransmissions += 1 if waiting.sent_order else 0
            waiting.sent_ms, waiting.sent_order = now_ms, self._order
            out.append(waiting.frame)
        return out

    def next_due_ms(self) -> int | None:
        """When ``due`` will have something; None while nothing waits."""
        return min(
            (w.sent_ms + self._retransmit_after_ms if w.sent_order else w.queued_ms for w in self._in_window()),
            default=None,
        )

    def acknowledge(self, acknowledgement: Acknowledgement) -> list[int]:
        """Forgets what was received; ids of the messages that are thereby delivered whole.

        A frame sent before one that has arrived is lost, not late (a node keeps order): it is due at once.
        """
        gone = [sequence for sequence in self._frames if acknowledgement.covers(sequence)]
        newest = max((self._frames[sequence].sent_order for sequence in gone), default=0)
        delivered: list[int] = []
        for sequence in gone:
            message_id = self._frames.pop(sequence).message_id
            self._left[message_id] -= 1
            if not self._left[message_id]:
                del self._left[message_id]
                delivered.append(message_id)
        for waiting in self._frames.values():
            if 0 < waiting.sent_order < newest:
                waiting.sent_ms -= self._retransmit_after_ms
        return delivered


class ReceiveWindow:
    """Segments heard ahead of the next message, and the acknowledgement that says so."""

    def __init__(self) -> None:
        self._segments: dict[int, tuple[int, int, bytes]] = {}
        self._next = 0  # first segment of the next message to hand over

    def is_new(self, sequence: int) -> bool:
        """Whether a segment is wanted: not seen before and within the window."""
        return self._next <= sequence < self._next + WINDOW and sequence not in self._segments

    def is_duplicate(self, sequence: int) -> bool:
        """Whether a segment was received before."""
        return sequence < self._next or sequence in self._segments

    def add(self, sequence: int, index: int, total: int, text: bytes) -> None:
        """Keeps an authenticated segment for which ``is_new`` holds."""
        self._segments[sequence] = (index, total, text)

    def next_message(self) -> tuple[int, bytes] | None:
        """Id and octets of the next message in order, if whole.

        Raises ``ValueError`` when authenticated segments contradict each other: the peer is broken.
        """
        first = self._segments.get(self._next)
        if first is None:
            return None
        total = first[1]
        parts: list[bytes] = []
        for index in range(total):
            segment = self._segments.get(self._next + index)
            if segment is None:
                return None
            if segment[0] != index or segment[1] != total:
                raise ValueError(f"segment {self._next + index} says {segment[0]} of {segment[1]}")
            parts.append(segment[2])
        message_id = self._next
        for index in range(total):
            del self._segments[message_id + index]
        self._next += total
        return message_id, b"".join(parts)

    def acknowledgement(self) -> Acknowledgement:
        """What was received so far."""
        base = self._next
        while base in self._segments:
            base += 1
        bitmap = 0
        for sequence in self._segments:
            if sequence > base:
                bitmap |= 1 << (sequence - base - 1)
        return Acknowledgement(base, bitmap)
