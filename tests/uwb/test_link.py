"""The secure link under loss, reordering, duplication and tampering."""

from __future__ import annotations

import contextlib
import random

import pytest
from cryptography.hazmat.primitives.ciphers.aead import AESCCM
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.uwb.link import (
    MAX_FRAME_OCTETS,
    MAX_MESSAGE_OCTETS,
    Abort,
    AbortCause,
    AbortReason,
    Echo,
    Identity,
    Link,
    LinkAborted,
    LinkBusyError,
    LinkClosedError,
    LinkKeys,
    LinkKeysError,
    MessageDelivered,
    MessageReceived,
    MessageTooLargeError,
    MessageType,
    PayloadError,
)
from wonderland.uwb.link import messages as m
from wonderland.uwb.link.errors import FrameError
from wonderland.uwb.link.retransmit import Acknowledgement
from wonderland.uwb.link.segments import split_frames

VECTORS = [
    "102600010203040000000000016bb593c43876ab6735bdd57c5f2b176d131e69ad5cabd59298",
    "111901010203040000000000000b3f71986cb392ceea2a346f",
    "10260101020304000000000001ce97e5828617375a3c6b46cf3eaff5dea2c8fb1f922c3a457c",
]


class Clock:
    def __init__(self) -> None:
        self.ms = 1_000

    def __call__(self) -> int:
        return self.ms


def keys(**changes: bytes) -> LinkKeys:
    values = {
        "session_id": b"\x00\x00\x00\x07",
        "key_pad_to_uav": b"\x01" * 16,
        "key_uav_to_pad": b"\x02" * 16,
        "iv_pad_to_uav": b"\x03" * 13,
        "iv_uav_to_pad": b"\x04" * 13,
    }
    return LinkKeys(**(values | changes))


def pair(clock: Clock, **options: int) -> tuple[Link, Link]:
    return Link("pad", keys(), clock, **options), Link("uav", keys(), clock, **options)


def received(link: Link) -> list[tuple[int, bytes]]:
    return [(e.message_type, e.payload) for e in link.events() if isinstance(e, MessageReceived)]


def test_poll_and_reply_cross_and_are_acknowledged() -> None:
    clock = Clock()
    pad, uav = pair(clock)
    poll = pad.send(MessageType.POLL, m.encode_code(b"p" * 16))
    for frame in pad.frames_to_send(4 * MAX_FRAME_OCTETS):
        uav.receive(frame)
    assert received(uav) == [(MessageType.POLL, b"p" * 16)]
    uav.send(MessageType.REPLY, m.encode_code(b"u" * 16))
    for frame in uav.frames_to_send(4 * MAX_FRAME_OCTETS):
        pad.receive(frame)
    assert pad.events() == [MessageDelivered(poll), MessageReceived(0, MessageType.REPLY, b"u" * 16)]
    assert not uav.idle
    for frame in pad.frames_to_send(4 * MAX_FRAME_OCTETS):
        uav.receive(frame)
    assert uav.events() == [MessageDelivered(0)]
    assert pad.idle
    assert uav.idle


def test_a_certificate_goes_in_segments_of_at_most_80_octets_and_concatenated_units_are_taken_apart() -> None:
    clock = Clock()
    pad, uav = pair(clock)
    certificate = bytes(range(256)) * 2 + b"x" * 58
    pad.send(MessageType.IDENTITY, Identity(certificate_der=certificate).encode())
    frames = pad.frames_to_send(64 * MAX_FRAME_OCTETS)
    assert len(frames) == 10
    assert all(len(frame) <= MAX_FRAME_OCTETS for frame in frames)
    uav.receive(b"".join(frames[:5]))
    assert uav.events() == []
    uav.receive(b"".join(frames[5:]))
    [event] = uav.events()
    assert isinstance(event, MessageReceived)
    assert Identity.decode(event.payload).certificate_der == certificate


def test_nothing_readable_is_on_air_and_a_repetition_is_the_identical_frame() -> None:
    clock = Clock()
    pad, uav = pair(clock, retransmit_after_ms=100)
    pad.send(MessageType.POLL, b"sixteen octets!!")
    [first] = pad.frames_to_send(4 * MAX_FRAME_OCTETS)
    assert b"sixteen" not in first
    assert pad.frames_to_send(4 * MAX_FRAME_OCTETS) == []
    clock.ms += 99
    assert pad.frames_to_send(4 * MAX_FRAME_OCTETS) == []
    clock.ms += 1
    assert pad.next_wakeup_ms() == clock.ms
    assert pad.frames_to_send(4 * MAX_FRAME_OCTETS) == [first]
    uav.receive(first)
    uav.receive(first)
    assert len(uav.events()) == 1
    assert uav.statistics.duplicates == 1
    assert pad.statistics.retransmissions == 1


def test_a_lost_acknowledgement_is_repeated_when_the_segment_comes_again() -> None:
    clock = Clock()
    pad, uav = pair(clock, retransmit_after_ms=100)
    sent = pad.send(MessageType.CHALLENGE, m.encode_challenge(b"c" * 8))
    for frame in pad.frames_to_send(4 * MAX_FRAME_OCTETS):
        uav.receive(frame)
    assert len(uav.frames_to_send(4 * MAX_FRAME_OCTETS)) == 1  # lost
    clock.ms += 100
    for frame in pad.frames_to_send(4 * MAX_FRAME_OCTETS):
        uav.receive(frame)
        uav.receive(frame)  # heard by a second node
    [acknowledgement] = uav.frames_to_send(4 * MAX_FRAME_OCTETS)
    pad.receive(acknowledgement)
    pad.receive(acknowledgement)
    assert pad.events() == [MessageDelivered(sent)]
    assert len(received(uav)) == 1


def test_a_gap_is_repeated_before_its_time() -> None:
    clock = Clock()
    pad, uav = pair(clock, retransmit_after_ms=10_000)
    pad.send(MessageType.IDENTITY, bytes(300))
    frames = pad.frames_to_send(64 * MAX_FRAME_OCTETS)
    for frame in frames[:2] + frames[3:]:
        uav.receive(frame)
    clock.ms += 50
    for frame in uav.frames_to_send(MAX_FRAME_OCTETS):
        pad.receive(frame)
    assert pad.frames_to_send(64 * MAX_FRAME_OCTETS) == [frames[2]]


def test_tampering_with_any_octet_is_never_accepted() -> None:
    clock = Clock()
    pad, _ = pair(clock)
    pad.send(MessageType.SIGNATURE, bytes(range(30)))
    [frame] = pad.frames_to_send(MAX_FRAME_OCTETS)
    for at in range(len(frame)):
        uav = Link("uav", keys(), clock)
        uav.receive(frame[:at] + bytes((frame[at] ^ 0x01,)) + frame[at + 1 :])
        assert uav.events() == [], at
        uav.receive(frame)
        assert len(uav.events()) == 1, at


def test_a_frame_reflected_to_its_sender_is_not_accepted() -> None:
    clock = Clock()
    pad, _ = pair(clock)
    mirror = Link("pad", keys(), clock, address=0)
    pad.send(MessageType.POLL, bytes(16))
    mirror.receive(pad.frames_to_send(MAX_FRAME_OCTETS)[0])
    assert mirror.events() == []
    assert mirror.statistics.tag_failures == 1


def test_sixteen_forged_frames_end_the_link() -> None:
    clock = Clock()
    pad, uav = pair(clock)
    pad.send(MessageType.POLL, bytes(16))
    [frame] = pad.frames_to_send(MAX_FRAME_OCTETS)
    forged = frame[:-1] + bytes((frame[-1] ^ 1,))
    for _ in range(15):
        uav.receive(forged)
    assert uav.events() == []
    uav.receive(forged)
    [event] = uav.events()
    assert isinstance(event, LinkAborted)
    assert event.cause is AbortCause.TAG_FAILURES
    with pytest.raises(LinkClosedError):
        uav.send(MessageType.REPLY, bytes(16))
    assert uav.frames_to_send(4 * MAX_FRAME_OCTETS) == []


def test_foreign_frames_do_not_count_against_the_link() -> None:
    clock = Clock()
    other = Link("pad", keys(session_id=b"\x00\x00\x00\x08"), clock)
    elsewhere = Link("uav", keys(), clock, address=3)
    pad, uav = pair(clock)
    other.send(MessageType.POLL, bytes(16))
    pad.send(MessageType.POLL, bytes(16))
    for _ in range(40):
        due = other.frames_to_send(MAX_FRAME_OCTETS) if uav.statistics.foreign == 0 else []
        uav.receive(due[0] if due else b"\xff\xff\xff")
    elsewhere.receive(pad.frames_to_send(MAX_FRAME_OCTETS)[0])
    assert elsewhere.statistics.foreign == 1
    assert uav.statistics.foreign == 1
    assert uav.statistics.malformed == 39
    assert not uav.closed


def test_deadline_and_undelivered_message_end_the_link() -> None:
    clock = Clock()
    pad = Link("pad", keys(), clock, deadline_ms=2_000)
    clock.ms = 2_000
    assert pad.frames_to_send(MAX_FRAME_OCTETS) == []
    assert [e.cause for e in pad.events() if isinstance(e, LinkAborted)] == [AbortCause.DEADLINE]
    uav = Link("uav", keys(), clock, delivery_timeout_ms=500)
    uav.send(MessageType.REPLY, bytes(16))
    clock.ms += 499
    assert len(uav.frames_to_send(MAX_FRAME_OCTETS)) == 1
    clock.ms += 1
    assert uav.frames_to_send(MAX_FRAME_OCTETS) == []
    assert [e.cause for e in uav.events() if isinstance(e, LinkAborted)] == [AbortCause.UNDELIVERED]


def test_limits_of_sending() -> None:
    pad, _ = pair(Clock())
    with pytest.raises(MessageTooLargeError, match="4096"):
        pad.send(MessageType.CLAIMS, bytes(MAX_MESSAGE_OCTETS + 1))
    with pytest.raises(MessageTooLargeError, match="octet"):
        pad.send(256, b"")
    with pytest.raises(LinkBusyError):
        for _ in range(100):
            pad.send(MessageType.CLAIMS, bytes(MAX_MESSAGE_OCTETS))


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    loss=st.sampled_from((0.0, 0.1, 0.3, 0.5)),
    sizes=st.lists(st.integers(0, 1_200), min_size=1, max_size=6),
    budget=st.integers(1, 6),
)
def test_all_messages_arrive_once_and_in_order_whatever_the_air_does(
    seed: int, loss: float, sizes: list[int], budget: int
) -> None:
    rng = random.Random(seed)
    clock = Clock()
    ends = pair(clock, delivery_timeout_ms=10**9, max_tag_failures=10**9)
    wanted: list[list[tuple[int, bytes]]] = [[], []]
    ids: list[list[int]] = [[], []]
    for number, size in enumerate(sizes):
        for side in (0, 1):
            message = (1 + number % 10, rng.randbytes(size))
            wanted[1 - side].append(message)
            ids[side].append(ends[side].send(*message))
    got: list[list[tuple[int, bytes]]] = [[], []]
    delivered: list[list[int]] = [[], []]
    air: list[tuple[int, int, bytes]] = []
    nonces: dict[tuple[int, bytes], bytes] = {}
    for _ in range(6_000):
        clock.ms += 50
        for side in (0, 1):
            for frame in ends[side].frames_to_send(budget * MAX_FRAME_OCTETS):
                assert len(frame) <= MAX_FRAME_OCTETS
                # Kind and sequence number fix the nonce: the same nonce must always be the same frame.
                assert nonces.setdefault((side, frame[:1] + frame[7:11]), frame) == frame
                for _copy in range(rng.choice((1, 1, 1, 2, 4))):
                    if rng.random() >= loss:
                        damaged = bytearray(frame)
                        if rng.random() < 0.05:
                            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
                        air.append((clock.ms + rng.choice((0, 0, 0, 50, 200)), 1 - side, bytes(damaged)))
        rng.shuffle(air)
        for _, side, frame in [entry for entry in air if entry[0] <= clock.ms]:
            ends[side].receive(frame)
        air = [entry for entry in air if entry[0] > clock.ms]
        for side in (0, 1):
            for event in ends[side].events():
                if isinstance(event, MessageReceived):
                    got[side].append((event.message_type, event.payload))
                elif isinstance(event, MessageDelivered):
                    delivered[side].append(event.message_id)
                else:
                    pytest.fail(str(event))
        if all(end.idle for end in ends) and not air:
            break
    assert got == wanted
    assert [sorted(d) for d in delivered] == ids


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200))
def test_garbage_is_counted_and_never_raises(data: bytes) -> None:
    uav = Link("uav", keys(), Clock())
    uav.receive(data)
    uav.receive(bytes((0x10, min(len(data) + 2, 255))) + data)
    assert uav.events() == []
    with contextlib.suppress(FrameError):
        split_frames(data)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**128 - 1))
@settings(max_examples=100, deadline=None)
def test_acknowledgements_round_trip(base: int, bitmap: int) -> None:
    acknowledgement = Acknowledgement(base, bitmap)
    assert Acknowledgement.decode(acknowledgement.encode()) == acknowledgement
    assert Acknowledgement.decode(b"abc") is None


def test_keys_are_checked_and_never_shown() -> None:
    with pytest.raises(LinkKeysError, match="iv_uav_to_pad"):
        keys(iv_uav_to_pad=b"short")
    with pytest.raises(LinkKeysError, match="differ"):
        keys(key_uav_to_pad=b"\x01" * 16)
    assert "\\x01" not in repr(keys())


def test_payloads_round_trip_and_refuse_by_name() -> None:
    for identity in (Identity(certificate_sha256=b"h" * 32), Identity(certificate_der=b"der")):
        assert Identity.decode(identity.encode()) == identity
    echo = Echo(b"c" * 8, 1_700_000_000_123)
    assert Echo.decode(echo.encode()) == echo
    abort = Abort(AbortReason.TIMEOUT, "zu spät")
    assert Abort.decode(abort.encode()) == abort
    assert Abort.decode(b"\xee").reason is AbortReason.UNSPECIFIED
    assert m.decode_signature(m.encode_signature(b"s" * 64)) == b"s" * 64
    for bad in (
        Identity,
        lambda: Identity(b"h" * 32, b"der"),
        lambda: Identity(certificate_sha256=b"h"),
        lambda: Identity(certificate_der=b""),
    ):
        with pytest.raises(PayloadError):
            bad().encode()
    with pytest.raises(PayloadError, match="session code"):
        m.decode_code(b"short")
    with pytest.raises(PayloadError, match="challenge"):
        m.decode_challenge(b"")
    with pytest.raises(PayloadError, match="echo"):
        Echo.decode(b"")
    with pytest.raises(PayloadError, match="heard_ms"):
        Echo(b"c" * 8, -1).encode()
    with pytest.raises(PayloadError, match="UTF-8"):
        Abort.decode(b"\x01\xff")
    with pytest.raises(PayloadError, match="200"):
        Abort(AbortReason.TIMEOUT, "x" * 201).encode()
    with pytest.raises(PayloadError, match="identity"):
        Identity.decode(b"\x02abc")


@given(st.binary(max_size=300))
@settings(max_examples=100, deadline=None)
def test_payload_decoders_raise_only_their_own_error(data: bytes) -> None:
    for decode in (Identity.decode, Echo.decode, Abort.decode, m.decode_code, m.decode_challenge, m.decode_signature):
        try:
            decode(data)
        except PayloadError:
            continue


def test_frames_are_frozen() -> None:
    """Own test vector: a change of it is a change of the protocol's version."""
    fixed = LinkKeys(
        bytes.fromhex("01020304"),
        bytes(range(0x10)),
        bytes(range(0x10, 0x20)),
        bytes(range(0x20, 0x2D)),
        bytes(range(0x30, 0x3D)),
    )
    clock = Clock()
    pad, uav = Link("pad", fixed, clock), Link("uav", fixed, clock)
    pad.send(MessageType.POLL, bytes(range(16)))
    [poll] = pad.frames_to_send(MAX_FRAME_OCTETS)
    uav.receive(poll)
    uav.send(MessageType.REPLY, bytes(range(16, 32)))
    acknowledgement, reply = uav.frames_to_send(2 * MAX_FRAME_OCTETS)
    assert [frame.hex() for frame in (poll, acknowledgement, reply)] == VECTORS
    # The poll once more, from the definition alone: RFC 3610 with an 8-octet tag over direction ‖ header.
    nonce = bytes(range(0x20, 0x2D))
    sealed = AESCCM(bytes(range(16)), tag_length=8).encrypt(
        nonce, b"\x01" + bytes(range(16)), b"\x00" + bytes.fromhex("10260001020304000000000001")
    )
    assert poll == bytes.fromhex("10260001020304000000000001") + sealed
