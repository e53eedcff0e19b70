"""TCPROS: a header of ``name=value`` fields, then messages, each after its length. Little-endian throughout."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Mapping
from typing import Final

from wonderland_ros_bridge.errors import WireError

MAX_HEADER_BYTES: Final = 256 * 1024
MAX_FIELDS: Final = 64
HEADER_S: Final = 5.0
"""How long a peer may take for its header."""
FRAME_S: Final = 30.0
"""How long it may take for a message once it has said its length."""
_LENGTH: Final = struct.Struct("<I")


def header(fields: Mapping[str, str]) -> bytes:
    """A header's bytes, its length first."""
    parts = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(body)) + body


def parse_header(body: bytes) -> dict[str, str]:
    """The fields of a header without its length. Raises WireError."""
    fields: dict[str, str] = {}
    at = 0
    while at < len(body):
        if at + 4 > len(body) or at + 4 + (size := _LENGTH.unpack_from(body, at)[0]) > len(body):
            raise WireError("a header of TCPROS that is cut off in a field")
        name, separator, value = body[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not separator or len(fields) >= MAX_FIELDS:
            raise WireError("a header of TCPROS with a field without a value, or too many of them")
        try:
            fields[name.decode("utf-8")] = value.decode("utf-8")
        except UnicodeDecodeError as cause:
            raise WireError("a header of TCPROS that is no UTF-8") from cause
    return fields


async def read_header(reader: asyncio.StreamReader) -> dict[str, str]:
    """A peer's header. Raises WireError."""
    try:
        async with asyncio.timeout(HEADER_S):
            (size,) = _LENGTH.unpack(await reader.readexactly(4))
            if size > MAX_HEADER_BYTES:
                raise WireError(f"a header of {size} bytes; {MAX_HEADER_BYTES} are allowed: is this TCPROS?")
            return parse_header(await reader.readexactly(size))
    except TimeoutError as cause:
        raise WireError(f"no header within {HEADER_S:g} s") from cause
    except (OSError, EOFError) as cause:
        raise WireError("the connection ended before its header") from cause


async def read_message(reader: asyncio.StreamReader, max_bytes: int) -> bytes | None:
    """The next message, however long it takes to begin; None at the end of the connection. Raises WireError."""
    try:
        (size,) = _LENGTH.unpack(await reader.readexactly(4))
    except asyncio.IncompleteReadError as cause:
        if not cause.partial:
            return None
        raise WireError("the connection ended within a message's length") from cause
    except OSError:
        return None
    if size > max_bytes:
        raise WireError(f"a message of {size} bytes; max_message_bytes allows {max_bytes}")
    try:
        async with asyncio.timeout(FRAME_S):
            return await reader.readexactly(size)
    except TimeoutError as cause:
        raise WireError(f"a message of {size} bytes that did not come within {FRAME_S:g} s") from cause
    except (OSError, EOFError) as cause:
        raise WireError(f"the connection ended within a message of {size} bytes") from cause


def frame(data: bytes) -> bytes:
    """A message after its length."""
    return _LENGTH.pack(len(data)) + data
