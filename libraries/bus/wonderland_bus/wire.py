"""A session of Zenoh from asyncio: opened, spoken by and closed in threads, since each of these may take seconds."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

import zenoh

from wonderland_bus.errors import BusError
from wonderland_bus.session import links_changed, open_member
from wonderland_bus.settings import Member

_T = TypeVar("_T")


class Wire:
    """A session with a router; ``lost`` is set when that one is gone."""

    def __init__(self, session: zenoh.Session, sending: ThreadPoolExecutor) -> None:
        self._session = session
        self._sending = sending
        self._loop = asyncio.get_running_loop()
        self._declared: list[Any] = []
        self.lost = asyncio.Event()

    @classmethod
    @contextlib.asynccontextmanager
    async def open(cls, member: Member) -> AsyncIterator[Wire]:
        """A session for as long as it is entered. Raises `BusUnreachableError`, `BusSettingsError`."""
        sending = ThreadPoolExecutor(1, thread_name_prefix="bus")
        opening: Future[zenoh.Session] = sending.submit(open_member, member)
        try:
            session = await asyncio.shield(asyncio.wrap_future(opening))
        except asyncio.CancelledError:
            # The thread cannot be ended: what it opens is closed, whenever that is.
            opening.add_done_callback(_close_late)
            raise
        finally:
            if not opening.done() or opening.exception() is not None:
                sending.shutdown(wait=False)
        wire = cls(session, sending)
        try:
            await wire._in_thread(wire._watch)
            yield wire
        finally:
            sending.submit(wire._close)
            sending.shutdown(wait=False)

    async def subscribe(self, key: str, heard: Callable[[str, bytes], object]) -> Any:
        """``heard(key, data)`` in a thread of Zenoh's, for whatever others put; for `undeclare`. Raises `BusError`."""

        def take(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                heard(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take, indirect=False)
        return await self._in_thread(
            lambda: self._session.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE)
        )

    async def undeclare(self, declared: Any) -> None:
        """What `subscribe` returned. Raises `BusError`."""
        await self._in_thread(declared.undeclare)

    async def serve_as(self, key: str) -> None:
        """A liveliness token, for as long as this session stands. Raises `BusError`."""
        await self._in_thread(lambda: self._declared.append(self._session.liveliness().declare_token(key)))

    async def when_gone(self, key: str, tell: Callable[[], object]) -> None:
        """``tell()`` in asyncio when a token that was there is there no longer. Raises `BusError`."""

        def changed(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.DELETE:
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    self._loop.call_soon_threadsafe(tell)

        callback = zenoh.handlers.Callback(changed, indirect=False)
        await self._in_thread(
            lambda: self._declared.append(self._session.liveliness().declare_subscriber(key, callback, history=True))
        )

    async def put(self, key: str, data: bytes) -> None:
        """Put it, in order; waits while the link is full. Whether it arrives is not known. Raises `BusError`."""
        await self._in_thread(
            partial(self._session.put, key, data, congestion_control=zenoh.CongestionControl.BLOCK, express=True)
        )

    async def _in_thread(self, what: Callable[[], _T]) -> _T:
        try:
            return await self._loop.run_in_executor(self._sending, what)
        except (zenoh.ZError, RuntimeError) as cause:  # RuntimeError: the thread has been shut down
            raise BusError(f"the bus: {str(cause)[:300]}") from cause

    def _watch(self) -> None:
        def tell(found: bool) -> None:
            if not found:
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    self._loop.call_soon_threadsafe(self.lost.set)

        self._declared.append(links_changed(self._session, tell))
        if not self._session.info.routers_zid():
            tell(False)

    def _close(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            for each in self._declared:
                each.undeclare()
            _close(self._session)


def _close(session: zenoh.Session) -> None:
    session.close()  # type: ignore[no-untyped-call]  # zenoh's stub says nothing of it


def _close_late(opening: Future[zenoh.Session]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        _close(opening.result())
