"""The secure link between pad and drone over in-band UWB data: sealed, segmented, acknowledged, in order. Sans-I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from wonderland.uwb.link.cipher import MAX_SEQUENCE, FrameCipher, LinkKeys, Role
from wonderland.uwb.link.errors import FrameError, LinkBusyError, LinkClosedError, MessageTooLargeError
from wonderland.uwb.link.retransmit import Acknowledgement, ReceiveWindow, SendWindow
from wonderland.uwb.link.segments import (
    MAX_FRAME_OCTETS,
    MAX_MESSAGE_OCTETS,
    MIN_FRAME_OCTETS,
    PAD_ADDRESS,
    UAV_ADDRESS,
    Frame,
    FrameKind,
    encode_header,
    split_frames,
)

MAX_WAITING_SEGMENTS: Final = 512


class AbortCause(StrEnum):
    """Why a link ended of itself."""

    TAG_FAILURES = "tag_failures"
    DEADLINE = "deadline"
    UNDELIVERED = "undelivered"
    PEER_BROKE_PROTOCOL = "peer_broke_protocol"


@dataclass(frozen=True, slots=True)
class MessageReceived:
    """A whole, authenticated message of the peer. ``message_type`` is a ``MessageType`` or unknown to this version."""

    message_id: int
    message_type: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class MessageDelivered:
    """The peer's link has acknowledged every segment of the message that ``send`` gave this id."""

    message_id: int


@dataclass(frozen=True, slots=True)
class LinkAborted:
    """The link is over: no more events but those already queued, and ``send`` raises ``LinkClosedError``."""

    cause: AbortCause
    detail: str


LinkEvent = MessageReceived | MessageDelivered | LinkAborted


@dataclass(slots=True)
class LinkStatistics:
    """Counters of frames since the start."""

    frames_sent: int = 0
    frames_received: int = 0
    retransmissions: int = 0
    duplicates: int = 0
    foreign: int = 0
    malformed: int = 0
    tag_failures: int = 0


class Link:
    """One end of the link. Never blocks, never does I/O.

    ``role``: which end this is. ``clock``: milliseconds, monotonic, any origin. ``deadline_ms``: on that clock, when
    the whole link gives up. ``delivery_timeout_ms``: longest time that a message may stay unacknowledged.
    ``max_tag_failures``: forged or corrupted frames for this session and address before it gives up.
    ``retransmit_after_ms``: repeat an unacknowledged segment after that time (two slow rounds and a half).
    ``address``: which frames are for this end (default: 1 for the pad, 0 for the UAV). ``frame_octets``: the largest
    frame that is sent.

    Use: feed every data unit from a node to ``receive``; each ranging round hand ``frames_to_send(octets)`` to the
    node; read ``events``. The pad may feed what all its nodes heard: copies are dropped.
    """

    def __init__(
        self,
        role: Role,
        keys: LinkKeys,
        clock: Callable[[], int],
        *,
        deadline_ms: int | None = None,
        delivery_timeout_ms: int = 10_000,
        max_tag_failures: int = 16,
        retransmit_after_ms: int = 250,
        address: int | None = None,
        frame_octets: int = MAX_FRAME_OCTETS,
    ) -> None:
        peer: Role = "uav" if role == "pad" else "pad"
        own_default, self._peer_address = (PAD_ADDRESS, UAV_ADDRESS) if role == "pad" else (UAV_ADDRESS, PAD_ADDRESS)
        self._address = own_default if address is None else address
        self._text_octets = frame_octets - MIN_FRAME_OCTETS
        self._session_id = keys.session_id
        self._sealer = FrameCipher(keys, role)
        self._opener = FrameCipher(keys, peer)
        self._clock = clock
        self._deadline_ms = deadline_ms
        self._delivery_timeout_ms = delivery_timeout_ms
        self._max_tag_failures = max_tag_failures
        self._acknowledge_again_ms = retransmit_after_ms // 2
        self._outgoing = SendWindow(retransmit_after_ms)
        self._incoming = ReceiveWindow()
        self._next_sequence = 0
        self._next_acknowledgement = 0
        self._heard_acknowledgement = -1
        self._acknowledgement_due = False
        self._heard_ms = 0
        """When the first frame came that is not acknowledged yet."""
        self._acknowledged_ms: int | None = None
        self._events: deque[LinkEvent] = deque()
        self._statistics = LinkStatistics()
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether the link was closed or has aborted."""
        return self._closed

    @property
    def idle(self) -> bool:
        """Nothing waits to be sent or to be acknowledged by the peer."""
        return not len(self._outgoing) and not self._acknowledgement_due

    @property
    def statistics(self) -> LinkStatistics:
        """Counters; a live object."""
        self._statistics.retransmissions = self._outgoing.retransmissions
        return self._statistics

    def send(self, message_type: int, payload: bytes) -> int:
        """Queues a message; its id comes back in ``MessageDelivered``. Messages arrive in the order of sending.

        Raises ``MessageTooLargeError`` above 4096 octets, ``LinkBusyError`` when too much waits, ``LinkClosedError``.
        """
        if self._closed:
            raise LinkClosedError("the link is closed; start a new session")
        if len(payload) > MAX_MESSAGE_OCTETS:
            raise MessageTooLargeError(f"a payload of {len(payload)} octets; at most {MAX_MESSAGE_OCTETS} are allowed")
        if not 0 <= message_type <= 0xFF:
            raise MessageTooLargeError(f"message type {message_type} does not fit in an octet")
        text = bytes((message_type,)) + payload
        total = -(-len(text) // self._text_octets)
        if len(self._outgoing) + total > MAX_WAITING_SEGMENTS:
            raise LinkBusyError(f"{len(self._outgoing)} segments wait already; wait for a delivery")
        message_id = self._next_sequence
        if message_id + total > MAX_SEQUENCE:
            raise LinkClosedError("all sequence numbers are used up; start a new session")
        self._next_sequence += total
        now_ms = self._clock()
        for index in range(total):
            part = text[index * self._text_octets : (index + 1) * self._text_octets]
            sequence = message_id + index
            frame = self._seal(FrameKind.DATA, sequence, index, total, part)
            self._outgoing.add(sequence, frame, message_id, now_ms)
        return message_id

    def receive(self, frame: bytes) -> None:
        """Takes one data unit from the radio: one frame, or several that the node concatenated.

        Never raises on what it hears: garbage, copies and foreign frames are counted in ``statistics``.
        """
        if self._closed or not frame:
            return
        try:
            frames = split_frames(bytes(frame))
        except FrameError:
            self._statistics.malformed += 1
            return
        for parsed in frames:
            if not self._closed:
                self._receive_frame(parsed)

    def _receive_frame(self, frame: Frame) -> None:
        if frame.addressee != self._address or frame.session_id != self._session_id:
            self._statistics.foreign += 1
            return
        if frame.kind is FrameKind.DATA:
            if self._incoming.is_duplicate(frame.sequence):
                self._repeat_acknowledgement()
                return
            if not self._incoming.is_new(frame.sequence):
                self._statistics.foreign += 1
                return
        elif frame.sequence <= self._heard_acknowledgement:
            self._statistics.duplicates += 1
            return
        text = self._opener.open(frame.kind, frame.sequence, frame.sealed, frame.header)
        if text is None:
            self._statistics.tag_failures += 1
            if self._statistics.tag_failures >= self._max_tag_failures:
                self._abort(AbortCause.TAG_FAILURES, f"{self._statistics.tag_failures} frames failed authentication")
            return
        self._statistics.frames_received += 1
        if frame.kind is FrameKind.DATA:
            self._incoming.add(frame.sequence, frame.index, frame.total, text)
            if not self._acknowledgement_due:
                self._acknowledgement_due, self._heard_ms = True, self._clock()
            self._hand_over()
        else:
            self._heard_acknowledgement = frame.sequence
            acknowledgement = Acknowledgement.decode(text)
            if acknowledgement is None or acknowledgement.base > self._next_sequence:
                self._abort(AbortCause.PEER_BROKE_PROTOCOL, "an authenticated acknowledgement is malformed")
                return
            self._events.extend(MessageDelivered(i) for i in self._outgoing.acknowledge(acknowledgement))

    def _repeat_acknowledgement(self) -> None:
        """A copy may mean that our acknowledgement was lost; copies heard by several nodes at once do not."""
        self._statistics.duplicates += 1
        if self._acknowledged_ms is None or self._clock() - self._acknowledged_ms >= self._acknowledge_again_ms:
            self._acknowledgement_due = True

    def _hand_over(self) -> None:
        try:
            while (message := self._incoming.next_message()) is not None:
                message_id, text = message
                if not text:
                    self._abort(AbortCause.PEER_BROKE_PROTOCOL, f"message {message_id} has no type")
                    return
                self._events.append(MessageReceived(message_id, text[0], text[1:]))
        except ValueError as error:
            self._abort(AbortCause.PEER_BROKE_PROTOCOL, str(error))

    def frames_to_send(self, octets: int) -> list[bytes]:
        """Frames (≤ 80 octets each) for one data unit of so many octets: data, and an acknowledgement if one is due.

        Where both do not fit, data go first as long as nobody repeats anything for want of the acknowledgement. Call it
        at least every few rounds even with nothing to send: deadlines are checked here.
        """
        now_ms = self._clock()
        self._check_deadlines(now_ms)
        if self._closed:
            return []
        acknowledgement = self._incoming.acknowledgement().encode() if self._acknowledgement_due else b""
        needs = MIN_FRAME_OCTETS + len(acknowledgement) if acknowledgement else 0
        out = self._outgoing.due(octets - needs, now_ms)
        if acknowledgement and not out and now_ms - self._heard_ms < self._acknowledge_again_ms:
            out = self._outgoing.due(octets, now_ms)
        if acknowledgement and needs <= octets - sum(map(len, out)):
            self._acknowledgement_due = False
            self._acknowledged_ms = now_ms
            out.insert(0, self._seal(FrameKind.ACKNOWLEDGEMENT, self._next_acknowledgement, 0, 0, acknowledgement))
            self._next_acknowledgement += 1
        self._statistics.frames_sent += len(out)
        return out

    def next_wakeup_ms(self) -> int | None:
        """When ``frames_to_send`` will next have something to do, on the clock; None while all is quiet."""
        if self._closed:
            return None
        if self._acknowledgement_due:
            return self._clock()
        times = [self._outgoing.next_due_ms(), self._deadline_ms]
        return min((t for t in times if t is not None), default=None)

    def events(self) -> list[LinkEvent]:
        """What happened since the last call, in order."""
        out = list(self._events)
        self._events.clear()
        return out

    def close(self) -> None:
        """Forgets everything that still waits. Without an event; to tell the peer, send an ABORT message before."""
        self._closed = True

    def _seal(self, kind: FrameKind, sequence: int, index: int, total: int, text: bytes) -> bytes:
        header = encode_header(
            kind,
            self._peer_address,
            self._session_id,
            sequence=sequence,
            index=index,
            total=total,
            text_octets=len(text),
        )
        return header + self._sealer.seal(kind, sequence, text, header)

    def _check_deadlines(self, now_ms: int) -> None:
        if self._closed:
            return
        if self._deadline_ms is not None and now_ms >= self._deadline_ms:
            self._abort(AbortCause.DEADLINE, "the session's deadline has passed")
            return
        oldest_ms = self._outgoing.oldest_ms
        if oldest_ms is not None and now_ms - oldest_ms >= self._delivery_timeout_ms:
            detail = f"a message was not acknowledged within {self._delivery_timeout_ms} ms"
            self._abort(AbortCause.UNDELIVERED, detail)

    def _abort(self, cause: AbortCause, detail: str) -> None:
        self._closed = True
        self._events.append(LinkAborted(cause, detail))
