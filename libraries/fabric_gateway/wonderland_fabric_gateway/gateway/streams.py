"""Endless streams from a ledger, as asynchronous iterators that can continue by themselves after an interruption."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, Self, TypeVar

import grpc

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway.backoff import Backoff
from wonderland_fabric_gateway.gateway.calls import cancelled_from_outside
from wonderland_fabric_gateway.gateway.deliver import height
from wonderland_fabric_gateway.gateway.errors import BehindError, StreamError, from_rpc

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Generator, Iterator
    from types import TracebackType

    from wonderland_fabric_gateway.gateway.calls import Environment

_log = logging.getLogger(__name__)
Item = TypeVar("Item")
SILENCE_S: Final = 5.0
"""After so long without an answer a stream looks whether its peer stands still; twice in a row, and it is left."""

_WORTH_REOPENING: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.INTERNAL,
        grpc.StatusCode.UNKNOWN,
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.DEADLINE_EXCEEDED,
    }
)


class Source(Protocol[Item]):
    """What a stream reads, and where it continues."""

    async def open(self, environment: Environment) -> Any:
        """A new call, at the one Gateway of that environment, that continues after the last item delivered."""
        ...

    def items(self, answer: bytes) -> Iterator[Item]:
        """What one answer holds."""
        ...

    def delivered(self, item: Item) -> None:
        """The consumer has this item."""
        ...


class Stream(Generic[Item]):
    """``async with stream: async for item in stream: …``. It ends by `close`, or raises `StreamError`.

    It is opened by ``async with``, by ``await stream``, by `open`, or by the first item asked for.

    With `reconnect`, an interruption (ledger restarted, network gone) is survived: the stream is opened again, after
    the last item that was delivered, with growing pauses, for ever, and at another Gateway where there is one. What
    cannot be cured by waiting (not allowed, unknown checkpoint) is raised. Without `reconnect`, each Gateway is tried
    once for the beginning. One task at a time may iterate.
    """

    def __init__(
        self,
        environment: Environment,
        source: Source[Item],
        channel: str,
        *,
        reconnect: bool,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        silence_s: float = SILENCE_S,
    ) -> None:
        self._silence_s = silence_s
        self._environment = environment
        self._at = environment
        self._source = source
        self._channel = channel
        self._reconnect = reconnect
        self._others = environment.calls.count - 1
        self._backoff = Backoff(environment.random_bytes)
        self._sleep = sleep
        self._call: Any = None
        self._waiting: deque[Item] = deque()
        self._closed = False
        self._told = False
        """Whether the log has it that nothing is heard."""

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __await__(self) -> Generator[Any, None, Self]:
        return self._opened().__await__()

    async def _opened(self) -> Self:
        await self.open()
        return self

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Item:
        while not self._waiting:
            await self.open()
            if self._closed:
                raise StopAsyncIteration
            try:
                answer = await self._read()
                if answer is not grpc.aio.EOF:
                    self._goes_on()
                    self._waiting.extend(self._source.items(answer))
                    self._backoff.reset()
                    self._others = 0
                    continue
                ended = StreamError("the gateway ended the stream", status_code=grpc.StatusCode.UNAVAILABLE)
            except asyncio.CancelledError as cause:
                if self._is_closed() and not cancelled_from_outside():
                    raise StopAsyncIteration from None
                self.close()
                if cancelled_from_outside():
                    raise
                raise StreamError("the channel was closed", status_code=grpc.StatusCode.CANCELLED) from cause
            except grpc.aio.AioRpcError as cause:
                ended = from_rpc(cause, StreamError)
                ended.__cause__ = cause
            except StreamError as error:
                ended = error
            except LedgerError:
                self.close()
                raise
            await self._interrupted(ended)
        item = self._waiting.popleft()
        self._source.delivered(item)
        return item

    async def _read(self) -> Any:
        """The next answer. A peer that stands still while another one of the organisation goes on is left."""
        if self._environment.calls.count == 1:
            return await self._call.read()
        reading = asyncio.ensure_future(self._call.read())
        stood_at = -1
        try:
            while True:
                await asyncio.wait({reading}, timeout=self._silence_s)
                if reading.done():
                    return reading.result()
                own, others = await self._heights()
                if others > own == stood_at:
                    raise StreamError(
                        f"the peer stands still at {own} blocks while another one has {others}",
                        status_code=grpc.StatusCode.UNAVAILABLE,
                    )
                stood_at = own if others > own else -1
        finally:
            if not reading.done():
                reading.cancel()

    async def _heights(self) -> tuple[int, int]:
        """Blocks of this stream's peer, and the most that another one has; 0 for those that do not say."""
        calls = self._at.calls
        found = await asyncio.gather(
            height(self._at, self._channel),
            *(height(self._environment.at(index), self._channel) for index in calls.others),
            return_exceptions=True,
        )
        own, *others = [each if isinstance(each, int) else 0 for each in found]
        return own, max(others)

    async def open(self) -> None:
        """Establish the stream: everything committed after this returns will be seen. Iterating does it, too.

        With `reconnect` it waits until there is a gateway to open it at.
        """
        while self._call is None and not self._closed:
            self._at = self._environment.pinned()
            try:
                self._call = await self._source.open(self._at)
            except StreamError as error:
                await self._interrupted(error)

    def close(self) -> None:
        """End the stream; an iteration that waits ends, too. May be called again."""
        self._closed = True
        self._waiting.clear()
        self._drop_call()

    def _is_closed(self) -> bool:
        """Asked after an await: another task may have closed the stream meanwhile."""
        return self._closed

    def _drop_call(self) -> None:
        call, self._call = self._call, None
        if call is not None:
            call.cancel()

    def _goes_on(self) -> None:
        if self._told:
            self._told = False
            _log.info("channel %s: the ledger is heard again", self._channel)

    async def _interrupted(self, error: StreamError) -> None:
        """Pause before a new attempt, or raise when there is to be none."""
        self._drop_call()
        if self._closed:
            return
        if error.is_unreached:
            self._at.calls.pass_over(behind=isinstance(error, BehindError))
        if not self._is_worth_reopening(error):
            self.close()
            raise error
        if self._reconnect and not self._told:
            self._told = True
            _log.warning("channel %s: the ledger is not heard, tried again until it is: %s", self._channel, error)
        await self._sleep(self._backoff.next_s())

    def _is_worth_reopening(self, error: StreamError) -> bool:
        if isinstance(error, BehindError):  # the source knows for how long
            return True
        if error.status_code not in _WORTH_REOPENING:
            return False
        if not self._reconnect and error.is_unreached and self._others > 0:
            self._others -= 1
            return True
        return self._reconnect
