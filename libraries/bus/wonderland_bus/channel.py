"""A channel of texts between an agent and a backend over the bus: in order, none twice, ended where one was lost.

What Zenoh brings comes in its threads, into a queue that is as long as what may be under way. What is sent waits until
the other side has room, so that whoever reads slowly holds up nobody but its peer.
"""

from __future__ import annotations

import asyncio
import contextlib
import ssl
import struct
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Final

from wonderland_bus.errors import BusError, ChannelClosedError
from wonderland_bus.secure import Frame, FrameError, FrameKind, SecureStream
from wonderland_bus.segments import MAX_DATA_BYTES, WINDOW, Kind, Numbers, Segment, SegmentError, parse

MAX_REASON_BYTES: Final = 400
_CREDIT_EACH: Final = WINDOW // 4
_HIGH_WATER_BYTES: Final = 2 * MAX_DATA_BYTES
_MAX_TEXTS: Final = 16
_DRAIN_S: Final = 2.0
_CODE: Final = struct.Struct(">H")
_FLOOD: Final = "the peer sends more than is taken of it"


class Channel:
    """One connection. ``transmit`` puts a message on the bus; ``server`` is 0 with an agent."""

    def __init__(
        self,
        stream: SecureStream,
        transmit: Callable[[bytes], Awaitable[None]],
        *,
        server: int,
        ping_s: float,
        on_closed: Callable[[], object] = lambda: None,
    ) -> None:
        self._stream = stream
        self._transmit = transmit
        self._server = server
        self._answers = server != 0
        self._ping_s = ping_s
        self._on_closed = on_closed
        self._loop = asyncio.get_running_loop()
        self._numbers = Numbers()
        self._lock = threading.Lock()
        self._raw: deque[bytes] = deque()
        self._flooded = False
        self._awake = False
        self._heard_s = self._loop.time()
        self._some, self._writable, self._arrival, self._room = (asyncio.Event() for _ in range(4))
        self._out = bytearray()
        self._told = 0
        self._opening = b""
        self._transmitting = False
        self._texts: deque[str] = deque()
        self._end: ChannelClosedError | None = None
        self._ready: asyncio.Future[None] = self._loop.create_future()
        self._tasks = [
            self._loop.create_task(self._pump()),
            self._loop.create_task(self._write()),
            self._loop.create_task(self._keep_alive()),
        ]
        self._finishing: asyncio.Task[None] | None = None

    def open(self) -> None:
        """The agent begins; and again, the same, while nobody answers: the first may have come before a backend did."""
        if not self._opening:
            self._stream.shake()
            self._opening = self._stream.outgoing()
        if self._server == 0:
            self._numbers.sent = 0
            self._out[:] = self._opening
            self._writable.set()

    @property
    def server(self) -> int:
        """Which run of a backend this is with; 0 before one has answered."""
        return self._server

    async def ready(self) -> ssl.SSLObject:
        """The TLS that stands, once both sides have shown who they are. Raises `ChannelClosedError`."""
        await asyncio.shield(self._ready)
        return self._stream.tls

    async def receive(self) -> str:
        """The next text. Raises `ChannelClosedError` once all have been received that came before the end."""
        while not self._texts:
            if self._end is not None:
                raise self._end
            self._arrival.clear()
            await self._arrival.wait()
        self._room.set()
        return self._texts.popleft()

    async def send(self, text: str) -> None:
        """Send a text; waits while much is under way. Raises `ChannelClosedError`."""
        self._put(Frame(FrameKind.TEXT, text.encode()))
        while len(self._out) > _HIGH_WATER_BYTES:
            self._room.clear()
            await self._room.wait()
            if self._end is not None:
                raise self._end

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Tell the other side, and end."""
        if self._end is None:
            with contextlib.suppress(ChannelClosedError, ssl.SSLError):
                self._put(Frame(FrameKind.CLOSE, _CODE.pack(code) + reason.encode()[:MAX_REASON_BYTES]))
            self.end(reason or "closed here", code)
        if self._finishing is not None:
            await asyncio.shield(self._finishing)

    def arrived(self, message: bytes) -> None:
        """In a thread of Zenoh's: a message for this channel."""
        with self._lock:
            if self._flooded:
                return
            if len(self._raw) >= 2 * WINDOW:  # data and credits
                self._flooded = True
                self._raw.clear()
            else:
                self._raw.append(message)
                if self._awake:
                    return
                self._awake = True
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._flood if self._flooded else self._some.set)

    def end(self, reason: str, code: int = 1006) -> None:
        """End it without a word; what was to be sent gets a moment to go."""
        if self._end is not None:
            return
        self._end = ChannelClosedError(reason, code)
        if not self._ready.done():
            self._ready.set_exception(self._end)
            self._ready.exception()  # perhaps nobody waits for it
        self._arrival.set()
        self._room.set()
        self._finishing = self._loop.create_task(self._finish())

    async def _finish(self) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_DRAIN_S):
                while (self._out and self._numbers.may_send) or self._transmitting:
                    self._room.clear()
                    await self._room.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._on_closed()

    def _put(self, frame: Frame) -> None:
        if self._end is not None:
            raise self._end
        self._stream.put(frame)
        self._flush()

    def _flush(self) -> None:
        self._out += self._stream.outgoing()
        self._writable.set()

    async def _pump(self) -> None:
        while True:
            await self._some.wait()
            self._some.clear()
            while (message := self._next()) is not None:
                self._heard_s = self._loop.time()
                try:
                    await self._take(parse(message))
                except SegmentError as cause:
                    return self.end(str(cause))
                except FrameError as cause:
                    return self._refuse(cause.code, str(cause))
                except ssl.SSLError as cause:
                    self._flush()  # the alert
                    return self.end(_told(cause))

    def _flood(self) -> None:
        """At once, also where nobody reads."""
        self._refuse(1008, _FLOOD)

    def _refuse(self, code: int, reason: str) -> None:
        with contextlib.suppress(ChannelClosedError, ssl.SSLError):
            self._put(Frame(FrameKind.CLOSE, _CODE.pack(code) + reason.encode()))
        self.end(reason, code)

    def _next(self) -> bytes | None:
        with self._lock:
            if not self._raw:
                self._awake = False
                return None
            return self._raw.popleft()

    async def _take(self, segment: Segment) -> None:
        self._server = self._server or segment.server
        opening = self._answers and segment.server == 0 and segment.seq == 0
        if segment.server != self._server and not opening:
            return  # of another backend, or of an earlier run of this one
        is_next = self._numbers.arrived(segment)
        self._writable.set()
        if not is_next:
            return
        for frame in self._stream.take(segment.data):
            await self._heard(frame)
        if self._stream.ready and not self._ready.done():
            self._ready.set_result(None)
        self._numbers.taken += 1
        self._flush()
        return

    async def _heard(self, frame: Frame) -> None:
        match frame.kind:
            case FrameKind.TEXT:
                while len(self._texts) >= _MAX_TEXTS:
                    self._room.clear()
                    await self._room.wait()
                try:
                    self._texts.append(frame.payload.decode())
                except UnicodeDecodeError:
                    raise FrameError("a text that is not UTF-8", 1007) from None
                self._arrival.set()
            case FrameKind.PING:
                self._put(Frame(FrameKind.PONG))
            case FrameKind.PONG:
                pass
            case FrameKind.CLOSE:
                code = _CODE.unpack_from(frame.payload)[0] if len(frame.payload) >= _CODE.size else 1005
                reason = frame.payload[_CODE.size :][:MAX_REASON_BYTES].decode(errors="replace")
                self.end(reason, code)

    async def _write(self) -> None:
        while True:
            await self._writable.wait()
            self._writable.clear()
            while (segment := self._next_out()) is not None:
                self._told = segment.taken
                self._transmitting = True
                try:
                    await self._transmit(segment.encode())
                except BusError as cause:
                    self._out.clear()
                    return self.end(str(cause))
                finally:
                    self._transmitting = False
                    self._room.set()

    def _next_out(self) -> Segment | None:
        numbers = self._numbers
        if self._out and numbers.may_send and not (self._server == 0 and numbers.sent):
            data = bytes(self._out[:MAX_DATA_BYTES])
            del self._out[:MAX_DATA_BYTES]
            numbers.sent += 1
            return Segment(Kind.DATA, self._server, numbers.sent - 1, numbers.taken, data)
        if numbers.taken - self._told >= _CREDIT_EACH:
            return Segment(Kind.CREDIT, self._server, numbers.sent, numbers.taken)
        return None

    async def _keep_alive(self) -> None:
        """End it where nothing is heard: neither a router's death nor a backend's is told to whoever is left."""
        while True:
            await asyncio.sleep(self._ping_s)
            if self._loop.time() - self._heard_s > 2 * self._ping_s:
                return self.end(f"nothing was heard for {2 * self._ping_s:g} s")
            if self._stream.ready and self._end is None:
                self._put(Frame(FrameKind.PING))


def _told(cause: ssl.SSLError) -> str:
    if isinstance(cause, ssl.SSLCertVerificationError):
        return f"certificate verify failed: {cause.verify_message}"
    if isinstance(cause, ssl.SSLZeroReturnError):
        return "the connection ended"
    return f"TLS: {(cause.reason or str(cause)).lower().replace('_', ' ')}"
