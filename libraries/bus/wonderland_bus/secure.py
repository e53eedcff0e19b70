"""TLS and frames over a stream of bytes that somebody else carries; no I/O.

The router ends the TLS of its links and could read, change and answer what passes. So agent and backend have TLS of
their own within, each with its certificate: who speaks is known by issuer and name, as on a WebSocket.
"""

from __future__ import annotations

import enum
import ssl
import struct
from dataclasses import dataclass
from typing import Final

_HEADER: Final = struct.Struct(">BI")
_READ_BYTES: Final = 64 * 1024


class FrameKind(enum.IntEnum):
    """What a frame is."""

    TEXT = 1
    PING = 2
    PONG = 3
    CLOSE = 4


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame."""

    kind: FrameKind
    payload: bytes = b""


class FrameError(Exception):
    """What arrived within TLS is no frame; ``code`` as of WebSockets."""

    def __init__(self, reason: str, code: int) -> None:
        super().__init__(reason)
        self.code = code


class SecureStream:
    """One side of a connection: what the other sent in, frames out, and back."""

    def __init__(self, context: ssl.SSLContext, *, server_name: str | None, max_frame_bytes: int) -> None:
        """`server_name`: as which the backend has to prove itself; None: this is the backend."""
        self._in, self._out = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._max_frame_bytes = max_frame_bytes
        self._buffer = bytearray()
        self.ready = False
        """The other side has proved who it is."""
        self.tls = context.wrap_bio(self._in, self._out, server_side=server_name is None, server_hostname=server_name)

    def shake(self) -> None:
        """Go on with the handshake. Raises `ssl.SSLError`."""
        try:
            self.tls.do_handshake()
        except ssl.SSLWantReadError:
            return
        self.ready = True

    def take(self, data: bytes) -> list[Frame]:
        """What came next. Raises `ssl.SSLError` (what to say to the other side is in `outgoing`), `FrameError`."""
        self._in.write(data)
        if not self.ready:
            self.shake()
        if self.ready:
            while True:
                try:
                    self._buffer += self.tls.read(_READ_BYTES)
                except ssl.SSLWantReadError:
                    break
        return self._frames()

    def put(self, frame: Frame) -> None:
        """Send a frame. Raises `ssl.SSLError` before `ready`."""
        self.tls.write(_HEADER.pack(frame.kind, len(frame.payload)) + frame.payload)

    def outgoing(self) -> bytes:
        """What is to be carried to the other side."""
        return self._out.read()

    def _frames(self) -> list[Frame]:
        found = []
        while len(self._buffer) >= _HEADER.size:
            kind, length = _HEADER.unpack_from(self._buffer)
            if length > self._max_frame_bytes:
                raise FrameError(f"a frame of {length} bytes; at most {self._max_frame_bytes}", 1009)
            end = _HEADER.size + length
            if len(self._buffer) < end:
                break
            try:
                found.append(Frame(FrameKind(kind), bytes(self._buffer[_HEADER.size : end])))
            except ValueError:
                raise FrameError(f"a frame of the unknown kind {kind}", 1002) from None
            del self._buffer[:end]
        return found
