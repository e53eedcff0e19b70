"""From texts to messages and back. Whatever a text holds, what comes out is a message or a `TelemetryError`.

Bodies are decoded apart from their frame, so that a bad record is refused alone. Nesting is bounded by the parser,
length by who receives.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Final, TypeVar, get_args

import msgspec

from wonderland.telemetry.bodies import (
    Body,
    Dropped,
    Estimate,
    Finding,
    Health,
    Position,
    SessionEnd,
    Step,
    Track,
)
from wonderland.telemetry.errors import TelemetryError
from wonderland.telemetry.fields import MAX_SEQ, Message, Seq, clean
from wonderland.telemetry.frames import FromAgent, FromServer, Hello, Record, Records

BODIES: Final[dict[str, type[Body]]] = {
    each.KIND: each for each in (Track, Position, Finding, Estimate, Step, SessionEnd, Health, Dropped)
}
"""Which struct the body of each kind is."""

_MAX_MESSAGE: Final = 300
_WHERE: Final = re.compile(r" - at (?:`key` in )?`\$\.?(.*)`\Z", re.DOTALL)
_Message = TypeVar("_Message")


class _Typed(msgspec.Struct):
    """A message of which nothing is known yet but its type."""

    type: str


class _Numbered(msgspec.Struct):
    """A record of which nothing is known yet but its number."""

    seq: Seq


_FROM_AGENT: Final[msgspec.json.Decoder[FromAgent]] = msgspec.json.Decoder(FromAgent)
_FROM_SERVER: Final[msgspec.json.Decoder[FromServer]] = msgspec.json.Decoder(FromServer)
_RECORD: Final = msgspec.json.Decoder(Record)
_TYPED: Final = msgspec.json.Decoder(_Typed)
_SERVER_TYPES: Final = {each.__struct_config__.tag for each in get_args(FromServer)}
_NUMBERED: Final = msgspec.json.Decoder(_Numbered)
_BODIES: Final[dict[str, msgspec.json.Decoder[Body]]] = {
    kind: msgspec.json.Decoder(each) for kind, each in BODIES.items()
}


def decode_hello(text: str | bytes) -> Hello:
    """An agent's first frame. Raises `TelemetryError` (``bad_hello``)."""
    message = _decoded(_FROM_AGENT, text, "bad_hello")
    if not isinstance(message, Hello):
        raise TelemetryError("bad_hello", f"type: expected `hello`, got `{_tag(message)}`")
    return message


def decode_agent(text: str | bytes) -> FromAgent:
    """What an agent sends. Raises `TelemetryError` (``bad_frame``); records in it are not looked at yet."""
    return _decoded(_FROM_AGENT, text, "bad_frame")


def decode_server(text: str | bytes) -> FromServer:
    """What the server sends. Raises `TelemetryError`: ``unknown_type`` for what a later one may say, ``bad_frame``."""
    try:
        return _decoded(_FROM_SERVER, text, "bad_frame")
    except TelemetryError:
        kind = _decoded(_TYPED, text, "bad_frame").type
        if kind in _SERVER_TYPES:
            raise
        raise TelemetryError("unknown_type", f"type: unknown `{clean(kind, 40)}`") from None


def number_of(raw: msgspec.Raw) -> int:
    """A record's number, without which nothing can be said about it. Raises `TelemetryError` (``bad_frame``)."""
    try:
        return _NUMBERED.decode(raw).seq
    except (ValueError, RecursionError):
        raise TelemetryError("bad_frame", f"records: seq must be an integer from 1 to {MAX_SEQ}") from None


def decode_record(raw: msgspec.Raw) -> Record:
    """A record, its body not looked at yet. Raises `TelemetryError` (``bad_record``)."""
    record = _decoded(_RECORD, raw, "bad_record")
    if memoryview(record.body)[0] != ord("{"):
        raise TelemetryError("bad_record", "body: expected an object")
    return record


def decode_body(record: Record) -> Body:
    """A record's body, of the struct of its kind. Raises `TelemetryError` (``unknown_kind``, ``bad_body``)."""
    decoder = _BODIES.get(record.kind)
    if decoder is None:
        raise TelemetryError("unknown_kind", f"kind {record.kind!r}; known are {', '.join(BODIES)}")
    return _decoded(decoder, record.body, "bad_body")


def record_of(seq: int, t_ms: int, body: Body) -> Record:
    """A body as the record of that number; `t_ms` is when it was so (Unix ms)."""
    return Record(seq=seq, kind=body.KIND, t_ms=t_ms, body=msgspec.Raw(canonical(body)))


def records_of(records: Iterable[Record]) -> Records:
    """A frame of records, which must be in order."""
    return Records(records=[msgspec.Raw(canonical(each)) for each in records])


def encode(message: FromAgent | FromServer | Body) -> str:
    """A message as JSON text."""
    return msgspec.json.encode(message).decode()


def canonical(message: Message) -> bytes:
    """A message as canonical JSON (`wonderland.proofs.encoding`): names are sorted."""
    return msgspec.json.encode(message, order="sorted")


def plain(message: Message) -> dict[str, Any]:
    """A message as the JSON object that it is, for who adds to it or encodes it in another way."""
    found: dict[str, Any] = msgspec.to_builtins(message)
    return found


def _tag(message: FromAgent) -> str:
    return str(type(message).__struct_config__.tag)


def _decoded(decoder: msgspec.json.Decoder[_Message], text: str | bytes | msgspec.Raw, code: str) -> _Message:
    try:
        return decoder.decode(text)
    except RecursionError:
        raise TelemetryError(code, "nested too deeply") from None
    except UnicodeError:  # bytes that are no UTF-8, or half of a surrogate pair in a text
        raise TelemetryError(code, "not UTF-8") from None
    except ValueError as error:  # msgspec's own errors are among these
        raise TelemetryError(code, _said(error)) from None


def _said(error: ValueError) -> str:
    """What is wrong, and in which field: bounded and printable, for it may quote names that somebody made up."""
    text = str(error)
    if not isinstance(error, msgspec.ValidationError):
        return clean(f"not JSON: {text.removeprefix('JSON is malformed: ')}", _MAX_MESSAGE)
    where = _WHERE.search(text)
    if where is not None:
        text = f"{where.group(1)}: {text[: where.start()]}" if where.group(1) else text[: where.start()]
    return clean(text, _MAX_MESSAGE)
