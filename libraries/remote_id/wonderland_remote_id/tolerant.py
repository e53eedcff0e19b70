"""Reading what breaks the standard: what can be saved of a frame, and a list of what was wrong with it.

`wonderland_remote_id.decode` refuses a frame with one bad field. Here that field becomes "unknown" (or undeclared), the
fault is reported, and the rest is kept. Nothing is guessed: a message whose type is reserved is not read, and a value
that the standard does not define is never passed on as if it were one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland_remote_id.decoding import (
    FIRST_PAGE_BYTES,
    MAX_PACK_MESSAGES,
    MAX_PAGES,
    PACK_HEADER_BYTES,
    PAGE_BYTES,
    check_pack,
    decode,
)
from wonderland_remote_id.enums import (
    CategoryEu,
    ClassEu,
    ClassificationType,
    IdType,
    MessageType,
    OperatorLocationType,
    ProtocolVersion,
)
from wonderland_remote_id.errors import FieldError, PackError, RemoteIdError
from wonderland_remote_id.messages import MESSAGE_BYTES, Message, Pack

MAX_REPAIRS: Final = 32
"""More than any message has fields: a bound on the work for one message."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One fault that was passed over.

    ``kind`` is the name of the error that the strict decoder raises for it (``FieldError``, ``PackError``, …),
    ``offset`` the byte of the frame, ``field`` the field's name where it lies in one, ``index`` the place of the
    message in its pack (−1: the frame itself).
    """

    kind: str
    message: str
    offset: int | None = None
    field: str | None = None
    index: int = -1


@dataclass(frozen=True, slots=True)
class Tolerated:
    """What a frame holds in spite of its faults; ``problems`` is empty for a frame that the strict decoder takes."""

    messages: tuple[Message, ...]
    is_pack: bool
    problems: tuple[Problem, ...]


def decode_tolerant(frame: bytes) -> Tolerated:
    """Whatever can be read of a frame of any length and content. Never raises."""
    if not frame:
        return Tolerated((), is_pack=False, problems=(Problem("FrameLengthError", "an empty frame", 0),))
    problems: list[Problem] = []
    if frame[0] >> 4 == MessageType.PACK:
        return Tolerated(_pack(frame, problems), is_pack=True, problems=tuple(problems))
    if len(frame) < MESSAGE_BYTES:
        problems.append(
            Problem("FrameLengthError", f"{len(frame)} bytes; a message has {MESSAGE_BYTES}", len(frame)),
        )
        return Tolerated((), is_pack=False, problems=tuple(problems))
    if len(frame) > MESSAGE_BYTES:
        problems.append(
            Problem("FrameLengthError", f"{len(frame) - MESSAGE_BYTES} bytes after the message", MESSAGE_BYTES)
        )
    message = _repaired(frame[:MESSAGE_BYTES], 0, -1, problems)
    return Tolerated(() if message is None else (message,), is_pack=False, problems=tuple(problems))


def _pack(frame: bytes, problems: list[Problem]) -> tuple[Message, ...]:
    if len(frame) < PACK_HEADER_BYTES:
        problems.append(Problem("FrameLengthError", f"a pack of {len(frame)} bytes has no header", len(frame)))
        return ()
    version = frame[0] & 15
    if version > max(ProtocolVersion):
        problems.append(Problem("ProtocolVersionError", f"protocol version {version} is unknown; read as 2", 0))
    if frame[1] != MESSAGE_BYTES:
        problems.append(Problem("PackError", f"announces messages of {frame[1]} bytes; they have {MESSAGE_BYTES}", 1))
        return ()
    count, there = frame[2], (len(frame) - PACK_HEADER_BYTES) // MESSAGE_BYTES
    if not 1 <= count <= MAX_PACK_MESSAGES:
        problems.append(Problem("PackError", f"announces {count} messages; a pack holds 1 to {MAX_PACK_MESSAGES}", 2))
    expected = PACK_HEADER_BYTES + count * MESSAGE_BYTES
    if len(frame) != expected:
        problems.append(
            Problem("FrameLengthError", f"a pack of {count} messages has {expected} bytes, not {len(frame)}", 2)
        )
    messages = []
    for index in range(min(count, there, MAX_PACK_MESSAGES)):
        start = PACK_HEADER_BYTES + index * MESSAGE_BYTES
        message = _repaired(frame[start : start + MESSAGE_BYTES], start, index, problems)
        if message is not None:
            messages.append(message)
    try:
        check_pack(messages)
    except PackError as error:
        problems.append(Problem("PackError", error.message, error.offset, index=error.index))
    return tuple(messages)


def _repaired(frame: bytes, start: int, index: int, problems: list[Problem]) -> Message | None:
    """The message in 25 bytes, each faulty field set to what means "unknown"; None where there is no telling."""
    patched = bytearray(frame)
    if patched[0] >> 4 == MessageType.PACK:
        problems.append(Problem("MessageTypeError", "a pack inside a pack is not read", start, index=index))
        return None
    if patched[0] & 15 > max(ProtocolVersion):
        text = f"protocol version {patched[0] & 15} is unknown; read as 2"
        problems.append(Problem("ProtocolVersionError", text, start, index=index))
        patched[0] = patched[0] & 0xF0 | ProtocolVersion.F3411_22A
    for _ in range(MAX_REPAIRS):
        try:
            message = decode(bytes(patched))
        except FieldError as error:
            offset = None if error.offset is None else start + error.offset
            problems.append(Problem("FieldError", error.message, offset, error.field, index))
            _patch(patched, error)
        except RemoteIdError as error:
            problems.append(Problem(type(error).__name__, error.message, start, index=index))
            return None
        else:
            assert not isinstance(message, Pack)  # 25 bytes are never one
            return message
    problems.append(Problem("FieldError", "too many faults to read the rest", start, index=index))  # pragma: no cover
    return None  # pragma: no cover - each repair heals one field, and there are fewer


def _patch(message: bytearray, error: FieldError) -> None:
    """Set the field that an error names to what the standard has for "unknown"."""
    kind, field = message[0] >> 4, error.field
    if field in {"UAS id", "text", "operator id"}:
        _patch_text(message, error)
    elif kind == MessageType.LOCATION:
        _patch_location(message, field)
    elif kind == MessageType.SYSTEM:
        _patch_system(message, field)
    elif kind == MessageType.AUTHENTICATION:
        if field == "authentication type":
            message[1] &= 15
        elif field == "last page":
            message[2] = MAX_PAGES - 1
        else:
            message[3] = min(FIRST_PAGE_BYTES + message[2] * PAGE_BYTES, 255)
    elif kind == MessageType.BASIC_ID:
        message[1] &= 15
    else:
        message[1] = 0


def _patch_text(message: bytearray, error: FieldError) -> None:
    """A character that cannot be shown becomes a question mark; an id that is none of its kind is left out."""
    assert error.offset is not None
    if message[0] >> 4 == MessageType.BASIC_ID and message[1] >> 4 in {IdType.UTM_UUID, IdType.SPECIFIC_SESSION}:
        if message[1] >> 4 == IdType.UTM_UUID:
            message[18:22] = bytes(4)
        else:
            message[1] &= 15
            message[2:22] = bytes(20)
    else:
        message[error.offset] = ord("?")


def _patch_location(message: bytearray, field: str) -> None:
    if field == "status":
        message[1] &= 15
    elif field == "track":
        message[1] |= 2
        message[2] = 181
    elif field == "vertical speed":
        message[4] = 126
    elif field in {"latitude", "longitude"}:
        message[5:13] = bytes(8)
    elif field == "horizontal accuracy":
        message[19] &= 0xF0
    elif field == "vertical accuracy":
        message[19] &= 15
    elif field == "speed accuracy":
        message[20] &= 0xF0
    elif field == "pressure altitude accuracy":
        message[20] &= 15
    else:
        message[21:23] = b"\xff\xff"


def _patch_system(message: bytearray, field: str) -> None:
    if field in {"operator latitude", "operator longitude"}:
        message[2:10] = bytes(8)
    elif field == "operator location":
        message[1] = message[1] & ~3 | OperatorLocationType.TAKEOFF
    elif field == "classification":
        message[1] = message[1] & ~0x1C | ClassificationType.UNDECLARED << 2
    elif field == "EU category":
        message[17] = message[17] & 15 | CategoryEu.UNDECLARED << 4
    else:
        message[17] = message[17] & 0xF0 | ClassEu.UNDECLARED
