"""The spool as the agent uses it: asynchronous, and never a disk flush on the event loop.

One thread does all the disk's work. Records that come while a flush runs share the next one (group commit), so that
twenty estimates a second and a dozen tracks cost a few dozen flushes, not hundreds.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland.proofs.records.fields import MAX_TIME_MS
from wonderland_edge_agent.spool.errors import RecordRefusedError, SpoolClosedError, SpoolError, SpoolFull
from wonderland_edge_agent.spool.lock import LOCK_NAME, ProcessLock
from wonderland_edge_agent.spool.store import Entry, SpoolStatus, SpoolStore, StoredRecord

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

DEFAULT_QUOTA_BYTES: Final = 64 << 20
DEFAULT_RESERVE_BYTES: Final = 2 << 20
MAX_BODY_BYTES: Final = 128 * 1024
"""A frame to the server holds 256 KiB; no record may come near."""
MAX_QUEUED: Final = 4096
MAX_BATCH: Final = 512
MAINTENANCE_S: Final = 1.0
"""How often a full disk is looked at again."""
_KIND: Final = re.compile(r"[a-z][a-z0-9_]{0,31}\Z")

_Result = TypeVar("_Result")


class Spool:
    """Durable records on their way to the server, and the agent's own state. Made by `Spool.open`.

    >>> spool = await Spool.open(directory, owner="pad-1")
    >>> spool.offer("track", t_ms, body)                                      # telemetry: soon durable, may be dropped
    >>> await spool.append("step", t_ms, body, evidence=True)                 # durable when it returns; never dropped
    """

    def __init__(self, store: SpoolStore, lock: ProcessLock, worker: ThreadPoolExecutor, linger_s: float) -> None:
        self._store = store
        self._lock = lock
        self._worker = worker
        self._linger_s = linger_s
        self._queue: list[tuple[Entry, asyncio.Future[int] | None]] = []
        self._lost = 0
        self._wake = asyncio.Event()
        self._urgent = asyncio.Event()
        self._changed = asyncio.Event()
        self._closed = False
        self._status = store.status
        self._flusher = asyncio.create_task(self._flush_forever(), name="spool flusher")

    @classmethod
    async def open(
        cls,
        directory: Path,
        *,
        owner: str,
        quota_bytes: int = DEFAULT_QUOTA_BYTES,
        reserve_bytes: int = DEFAULT_RESERVE_BYTES,
        linger_s: float = 0.05,
    ) -> Spool:
        """The spool in a directory (made with mode 0700 if missing) of the pad ``owner``.

        ``quota_bytes`` bounds what is stored, ``reserve_bytes`` of disk are put aside for evidence, telemetry waits
        at most ``linger_s`` for company before it is flushed. Raises `SpoolError`, among them `SpoolLockedError`.
        """
        worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="spool")

        def open_store() -> tuple[SpoolStore, ProcessLock]:
            try:
                directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            except OSError as cause:
                raise SpoolError(f"spool {directory}: cannot be made ({cause.strerror or cause})") from cause
            lock = ProcessLock(directory / LOCK_NAME)
            try:
                store = SpoolStore(
                    directory / "spool.db", owner=owner, quota_bytes=quota_bytes, reserve_bytes=reserve_bytes
                )
            except BaseException:
                lock.release()
                raise
            return store, lock

        try:
            store, lock = await asyncio.get_running_loop().run_in_executor(worker, open_store)
        except BaseException:
            worker.shutdown(wait=False)
            raise
        return cls(store, lock, worker, linger_s)

    async def close(self) -> None:
        """Store what is queued and give the directory back."""
        if self._closed:
            return
        self._closed = True
        self._urgent.set()
        self._wake.set()
        await self._flusher
        await asyncio.get_running_loop().run_in_executor(self._worker, self._store.close)
        self._worker.shutdown(wait=True)
        self._lock.release()
        self._changed.set()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def id(self) -> str:
        """The spool's UUID (32 hexadecimal digits): with the pad's id the name of its sequence of numbers."""
        return self._status.spool

    @property
    def status(self) -> SpoolStatus:
        """Where it stood after its last flush."""
        return self._status

    @property
    def accepts_sessions(self) -> bool:
        """Whether there is room for a whole session's evidence; the pad refuses new sessions while there is not."""
        return not self._status.reason

    # Records

    def offer(self, kind: str, t_ms: int, body: Mapping[str, Any]) -> None:
        """Queue telemetry and return at once; under pressure it may be dropped, and a ``dropped`` record says so.

        Raises `RecordRefusedError` for what could never be sent and `SpoolClosedError`.
        """
        entry = _entry(kind, t_ms, body, evidence=False)
        self._check_open()
        if len(self._queue) >= MAX_QUEUED:
            self._lost += 1
            return
        self._queue.append((entry, None))
        self._wake.set()

    async def append(
        self, kind: str, t_ms: int, body: Mapping[str, Any], *, evidence: bool, ends_session: str | None = None
    ) -> int:
        """Store a record durably; its number. Evidence is flushed at once, telemetry with the next flush.

        ``ends_session`` removes that session's state in the same transaction, so that a session's end is recorded
        exactly once, whatever is killed when. Raises `SpoolFull` (nothing is stored then), `RecordRefusedError`.
        """
        entry = _entry(kind, t_ms, body, evidence=evidence, ends_session=ends_session)
        self._check_open()
        future: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._queue.append((entry, future))
        if evidence:
            self._urgent.set()
        self._wake.set()
        return await future

    async def pending(
        self, after_seq: int = 0, *, max_records: int = 256, max_bytes: int = 128 * 1024
    ) -> list[StoredRecord]:
        """Stored records after a number, in order, within both limits (but at least one if there is any)."""
        return await self._run(partial(self._store.pending, after_seq, max_records, max_bytes))

    async def acknowledge(self, seq: int) -> None:
        """Forget what the server holds durably, all up to ``seq``. Raises `SpoolError` for a number never given."""
        await self._run(partial(self._store.acknowledge, seq))

    async def renew(self) -> None:
        """Take a new id and number what is pending from 1; see `SpoolStore.renew`."""
        await self._run(self._store.renew)

    async def wait_beyond(self, seq: int) -> None:
        """Return when there is a record after ``seq``, or the spool is closed."""
        while self._status.last_seq <= seq and not self._closed:
            self._changed.clear()
            await self._changed.wait()

    # The agent's own state

    async def put_secret(self, name: str, value: bytes) -> None:
        """Keep a private key. Raises `SpoolError` for a name that exists."""
        await self._run(partial(self._store.state.put_secrets, {name: value}))

    async def put_secrets(self, secrets: Mapping[str, bytes]) -> None:
        """Keep several private keys, all or none."""
        await self._run(partial(self._store.state.put_secrets, dict(secrets)))

    async def take_secret(self, name: str) -> bytes | None:
        """A private key, once: it is durably gone from the spool before this returns; None when it was taken."""
        return await self._run(partial(self._store.state.take_secret, name))

    async def secret_names(self) -> list[str]:
        """Names of the private keys that are left."""
        return await self._run(self._store.state.secret_names)

    async def put_session(self, session_id: str, state: Mapping[str, Any]) -> None:
        """Keep the state (canonical JSON) of a session in progress, so that a restarted agent can end it."""
        await self._run(partial(self._store.state.put_session, session_id, _encoded(state, "session state")))

    async def remove_session(self, session_id: str) -> None:
        """Forget a session; where its end is recorded, give `append` ``ends_session`` instead."""
        await self._run(partial(self._store.state.remove_session, session_id))

    async def sessions(self) -> dict[str, dict[str, Any]]:
        """Sessions in progress by id; right after `open`: those that were interrupted."""
        stored = await self._run(self._store.state.sessions)
        return {session_id: encoding.decode(state) for session_id, state in stored.items()}

    async def put_note(self, name: str, value: bytes) -> None:
        """Keep a small value of the agent's own."""
        await self._run(partial(self._store.state.put_note, name, value))

    async def note(self, name: str) -> bytes | None:
        """A value kept by `put_note`; None when there is none."""
        return await self._run(partial(self._store.state.note, name))

    # Inside

    async def _run(self, work: Callable[[], _Result]) -> _Result:
        self._check_open()
        return await self._in_worker(work)

    async def _in_worker(self, work: Callable[[], _Result]) -> _Result:
        def work_and_look() -> _Result:
            try:
                return work()
            finally:
                self._status = self._store.status

        try:
            return await asyncio.get_running_loop().run_in_executor(self._worker, work_and_look)
        finally:
            self._changed.set()

    async def _flush_forever(self) -> None:
        while True:
            if not self._queue:
                if self._closed:
                    return
                await self._wait_for_work()
                continue
            if not self._urgent.is_set() and len(self._queue) < MAX_BATCH:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._urgent.wait(), self._linger_s)
            await self._flush()

    async def _wait_for_work(self) -> None:
        self._wake.clear()
        if not self._store.degraded:
            await self._wake.wait()
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._wake.wait(), MAINTENANCE_S)
        await self._in_worker(self._store.maintain)

    async def _flush(self) -> None:
        batch, self._queue = self._queue[:MAX_BATCH], self._queue[MAX_BATCH:]
        lost, self._lost = self._lost, 0
        if not self._queue and not self._closed:
            self._urgent.clear()
        entries = [entry for entry, _ in batch]
        results: list[int | SpoolFull] | list[SpoolError]
        try:
            results = await self._in_worker(partial(self._store.write, entries, lost))
        except SpoolError as error:
            results = [error] * len(batch)
        except BaseException as error:
            for _, future in batch:
                if future is not None and not future.done():
                    future.set_exception(SpoolError(f"the spool has failed: {error!r}"))
            raise
        for (_, future), result in zip(batch, results, strict=True):
            if future is None or future.done():
                continue
            if isinstance(result, SpoolError):
                future.set_exception(result)
            else:
                future.set_result(result)

    def _check_open(self) -> None:
        if self._closed:
            raise SpoolClosedError("the spool is closed: the agent is stopping")
        if self._flusher.done():
            raise SpoolError("the spool has failed; the agent must be started again")


def _entry(kind: str, t_ms: int, body: Mapping[str, Any], *, evidence: bool, ends_session: str | None = None) -> Entry:
    if not _KIND.match(kind):
        raise RecordRefusedError(f"{kind!r} is no kind of record: lower-case letters, digits and _, at most 32")
    if not 0 <= t_ms <= MAX_TIME_MS:
        raise RecordRefusedError(f"{kind}: t_ms {t_ms} is no time in milliseconds since 1970")
    return Entry(kind, t_ms, _encoded(body, kind), evidence, ends_session)


def _encoded(value: Mapping[str, Any], what: str) -> bytes:
    try:
        data = encoding.encode(dict(value))
    except EncodingError as cause:
        raise RecordRefusedError(f"{what}: {cause}") from cause
    if len(data) > MAX_BODY_BYTES:
        raise RecordRefusedError(f"{what}: {len(data)} bytes; a record holds at most {MAX_BODY_BYTES}")
    return data
