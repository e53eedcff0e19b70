"""The bus for asyncio: Zenoh's callbacks come in threads of its own, and its calls may wait for a router."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final

import zenoh

from wonderland_backend.replicas.messages import UnansweredError
from wonderland_backend.replicas.pieces import Assembly, cut, label_of
from wonderland_backend.replicas.sealed import KEY_BYTES, Seal

logger = logging.getLogger(__name__)

MOST_BYTES: Final = 128 << 20
"""Of what is put together at a time, of each key."""
MOST_UNDER_WAY: Final = 64
"""Questions that are being answered at a time, of each key."""
_REMEMBERED: Final = 4_096
_BUSY: Final = b"busy"
_QUERIERS: Final = 8
_LOOKS: Final = 10
_LOOK_S: Final = 0.05
_QUESTION: Final = b" ?"
_ANSWER: Final = b" !"


class Bus:
    """A session, used from one event loop."""

    def __init__(self, session: zenoh.Session, clock: Callable[[], int]) -> None:
        self._session = session
        self._clock = clock
        self._seal = Seal(os.urandom(KEY_BYTES))  # until `use` nobody can be understood
        self._loop = asyncio.get_running_loop()
        self._threads = ThreadPoolExecutor(4, thread_name_prefix="bus")
        self._declared: list[Any] = []
        self._queriers: dict[str, zenoh.Querier] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def use(self, key: bytes) -> None:
        """What is said is sealed with this key from now on, and what is not is not heard."""
        self._seal = Seal(key)

    async def put(self, key: str, data: bytes) -> None:
        """Tell whoever listens now. Where the bus has no room it is lost: number what is said."""
        for piece, label in cut(self.closed(data, key), os.urandom(8)):
            # Else one listener that hangs would hold up all.
            put = partial(self._session.put, congestion_control=zenoh.CongestionControl.DROP)
            await self._in_thread(partial(put, key, piece, attachment=label))

    def listen(self, key: str, heard: Callable[[bytes], None]) -> None:
        """Have `heard` called with everything that is put there, on the event loop."""
        assembly = Assembly(MOST_BYTES)

        def take(label: bytes, piece: bytes) -> None:
            try:
                data = assembly.take(label_of(label), piece)
            except ValueError:
                return  # whoever numbers what he says sees the gap
            try:
                if data is not None:
                    heard(self.opened(data, key))
            except ValueError as cause:
                logger.warning("something on the bus at %s is not of a backend of this database: %s", key, cause)

        def sample(each: zenoh.Sample) -> None:
            label = b"" if each.attachment is None else each.attachment.to_bytes()
            self._soon(take, label, each.payload.to_bytes())

        subscriber = self._session.declare_subscriber(key, zenoh.handlers.Callback(sample, indirect=False))
        self._declared.append(subscriber)

    def answer(self, key: str, work: Callable[[bytes], Awaitable[bytes]]) -> None:
        """Have `work` answer what is asked there; each question once, however often it comes."""
        answering = _Answering(self, key, work)

        def queried(query: zenoh.Query) -> None:
            self._soon(answering.take, query)

        self._declared.append(self._session.declare_queryable(key, zenoh.handlers.Callback(queried, indirect=False)))

    async def ask(self, key: str, data: bytes, within_s: float) -> bytes:
        """The answer of whoever answers there. Raises `UnansweredError`."""
        querier = await self._querier(key, within_s)
        name = os.urandom(16)
        *before, last = cut(self.closed(data, key, _QUESTION + name), name)
        for piece, label in before:
            await self._ask_once(querier, piece, label, within_s, asked=False)
        answer = await self._ask_once(querier, *last, within_s, asked=True)
        try:
            return self.opened(answer, key, _ANSWER + name)
        except ValueError as cause:
            raise UnansweredError(str(cause), asked=True) from None

    async def _querier(self, key: str, within_s: float) -> zenoh.Querier:
        """Raises `UnansweredError` where nobody is there to be asked: then nothing was."""
        querier = self._queriers.get(key)
        if querier is None:
            declare = partial(self._session.declare_querier, consolidation=zenoh.ConsolidationMode.NONE)
            querier = self._queriers[key] = await self._in_thread(partial(declare, key, timeout=within_s))
            while len(self._queriers) > _QUERIERS:
                await self._in_thread(self._queriers.pop(next(iter(self._queriers))).undeclare)
        for _ in range(_LOOKS):  # whether somebody is comes from the router, a moment after it was asked
            if (await self._in_thread(lambda: querier.matching_status)).matching:
                return querier
            await asyncio.sleep(_LOOK_S)
        raise UnansweredError("nobody answers there", asked=False)

    async def _ask_once(
        self, querier: zenoh.Querier, piece: bytes, label: bytes, within_s: float, *, asked: bool
    ) -> bytes:
        ended: asyncio.Future[None] = self._loop.create_future()
        assembly = Assembly(MOST_BYTES)
        whole: list[bytes] = []
        refusals: list[bytes] = []

        def take(label: bytes, payload: bytes) -> None:
            try:
                data = assembly.take(label_of(label), payload)
            except ValueError:
                return
            if data is not None:
                whole.append(data)

        def replied(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                label = b"" if reply.ok.attachment is None else reply.ok.attachment.to_bytes()
                self._soon(take, label, reply.ok.payload.to_bytes())
            elif reply.err is not None:
                self._soon(refusals.append, reply.err.payload.to_bytes())

        def end() -> None:
            self._soon(_finish, ended)

        handler: Any = zenoh.handlers.Callback(replied, end, indirect=False)
        await self._in_thread(lambda: querier.get(handler=handler, payload=piece, attachment=label))
        try:
            async with asyncio.timeout(within_s + 1):
                await ended
        except TimeoutError:
            raise UnansweredError("no answer in time", asked=asked) from None
        if whole:
            return whole[0]
        if _BUSY in refusals:
            raise UnansweredError("too much is asked at once", asked=False)
        raise UnansweredError("no answer", asked=asked)

    def closed(self, data: bytes, key: str, about: bytes = b"") -> bytes:
        """Sealed for this key of the bus."""
        return self._seal.closed(data, key.encode() + about, self._clock())

    def opened(self, data: bytes, key: str, about: bytes = b"") -> bytes:
        """Raises `ValueError`."""
        return self._seal.opened(data, key.encode() + about, self._clock())

    async def close(self) -> None:
        """End everything."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self.silence()
        await asyncio.to_thread(self._session.close)
        self._threads.shutdown(wait=False, cancel_futures=True)

    def silence(self) -> None:
        """Neither listen nor answer any more."""
        for each in self._declared:
            each.undeclare()
        self._declared.clear()

    def run(self, work: Any) -> None:
        """Work that goes on by itself."""
        task: asyncio.Task[None] = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def reply(self, query: zenoh.Query, data: bytes) -> None:
        """Answer, and be done with it."""
        pieces = list(cut(data, b"answer"))

        def send() -> None:
            for piece, label in pieces:
                query.reply(query.key_expr, piece, attachment=label)
            query.drop()  # type: ignore[no-untyped-call]

        await self._in_thread(send)

    async def refuse(self, query: zenoh.Query, why: bytes) -> None:
        """Say that it is not done."""

        def send() -> None:
            query.reply_err(why)
            query.drop()  # type: ignore[no-untyped-call]

        await self._in_thread(send)

    async def _in_thread(self, call: Callable[[], Any]) -> Any:
        return await self._loop.run_in_executor(self._threads, call)

    def _soon(self, call: Callable[..., object], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended, and with it whoever would hear of it
            self._loop.call_soon_threadsafe(call, *arguments)


def _finish(ended: asyncio.Future[None]) -> None:
    if not ended.done():
        ended.set_result(None)


class _Answering:
    """One key's questions."""

    def __init__(self, bus: Bus, key: str, work: Callable[[bytes], Awaitable[bytes]]) -> None:
        self._bus = bus
        self._key = key
        self._work = work
        self._assembly = Assembly(MOST_BYTES)
        self._seen: OrderedDict[bytes, None] = OrderedDict()
        self._under_way = 0

    def take(self, query: zenoh.Query) -> None:
        """A question, or a piece of one."""
        try:
            label = label_of(b"" if query.attachment is None else query.attachment.to_bytes())
            data = self._assembly.take(label, b"" if query.payload is None else query.payload.to_bytes())
            if data is not None:
                data = self._bus.opened(data, self._key, _QUESTION + label.of)
        except ValueError as cause:
            logger.warning("a question on the bus at %s is not answered: %s", self._key, cause)
            self._bus.run(self._bus.refuse(query, b"refused"))
            return
        if data is None:
            self._bus.run(self._bus.reply(query, b""))
        elif label.of in self._seen:
            self._bus.run(self._bus.refuse(query, b"asked before"))
        elif self._under_way >= MOST_UNDER_WAY:
            self._bus.run(self._bus.refuse(query, _BUSY))
        else:
            self._seen[label.of] = None
            while len(self._seen) > _REMEMBERED:
                self._seen.popitem(last=False)
            self._under_way += 1
            self._bus.run(self._answer(query, data, label.of))

    async def _answer(self, query: zenoh.Query, data: bytes, name: bytes) -> None:
        try:
            await self._bus.reply(query, self._bus.closed(await self._work(data), self._key, _ANSWER + name))
        except Exception:
            logger.exception("a question on the bus (%s) could not be answered", self._key)
            await self._bus.refuse(query, b"failed")
        finally:
            self._under_way -= 1
