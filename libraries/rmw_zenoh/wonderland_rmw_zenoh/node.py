"""A node of ROS 2 on a Zenoh session: topics both ways, services both ways, and who else is there.

Zenoh calls from threads of its own. What it brings goes into bounded queues, and from there to asyncio; what is sent
goes by one thread, in order, so that a peer that does not read holds up nobody here but the sender.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, Self, TypeVar

import zenoh
from zenoh import ext

from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.errors import CallError, DefinitionError, Ros2Error, SessionError, WireError
from wonderland_rmw_zenoh.interfaces import MessageType, ServiceType
from wonderland_rmw_zenoh.session import Link, open_session
from wonderland_rmw_zenoh.wire import Attachment, Endpoint, Kind, Qos

_log = logging.getLogger(__name__)
_T = TypeVar("_T")

MAX_ENDPOINTS: Final = 20_000
MAX_QUEUE_BYTES: Final = 64 << 20
MAX_CALLS: Final = 64
"""Requests of a service that are answered at once; further ones are told to come again."""
MAX_REQUEST_BYTES: Final = 64 * 1024
CALL_S: Final = 10.0
CDR: Final = "application/cdr"


@dataclass(frozen=True, slots=True)
class Arrived:
    """A message as it came; nobody has looked into it."""

    topic: str
    type: str
    type_hash: str
    data: bytes
    attachment: Attachment
    lost: int
    """Messages of this topic that came before it, and that the queue did not hold."""


Take = Callable[[Arrived], Awaitable[None]]
Serve = Callable[[Any], Awaitable[Mapping[str, Any]]]


class Publication:
    """A topic that the node publishes."""

    def __init__(self, node: Node, name: str, kind: MessageType, qos: Qos) -> None:
        self.name: Final = name
        self.type: Final = kind
        self._node = node
        self._gid = os.urandom(wire.GID_BYTES)
        self._seq = 0
        key = wire.data_key(node.domain, name, kind.name, kind.hash)
        block = zenoh.CongestionControl.BLOCK if qos.reliable else zenoh.CongestionControl.DROP
        if qos.transient_local:
            self._publisher: Any = ext.declare_advanced_publisher(
                node.session,
                key,
                congestion_control=block,
                cache=ext.CacheConfig(qos.depth),
                publisher_detection=True,
            )
        else:
            self._publisher = node.session.declare_publisher(key, congestion_control=block)
        self._token: Any = node.declare("MP", name, kind.name, kind.hash, qos)

    async def publish(self, message: Mapping[str, Any]) -> None:
        """A message from its fields. Raises DefinitionError."""
        await self.publish_bytes(self.type.codec.encode(message))

    async def publish_bytes(self, data: bytes) -> None:
        """A message as CDR."""
        self._seq += 1
        beside = Attachment(self._seq, time.time_ns(), self._gid).encode()
        await self._node.in_thread(lambda: self._publisher.put(data, encoding=CDR, attachment=beside))

    def close(self) -> None:
        """Publish no more."""
        self._token.undeclare()
        self._publisher.undeclare()


class Subscription:
    """A topic that the node hears, whatever its type: ``take`` is awaited for each message, in order."""

    def __init__(
        self, node: Node, name: str, take: Take, *, depth: int, max_message_bytes: int, history: bool = True
    ) -> None:
        self.name: Final = name
        self._take = take
        self._node = node
        self._depth = depth
        self._max_message_bytes = max_message_bytes
        self._lock = threading.Lock()
        self._queue: deque[Arrived] = deque()
        self._bytes = 0
        self._lost = 0
        self._awake = False
        self._some = asyncio.Event()
        self._tokens: dict[tuple[str, str], Any] = {}
        self.refused: dict[str, int] = {}
        """How many messages were left out, by why."""
        key = f"{node.domain}/{name[1:]}/*/*"
        self._subscriber: Any = ext.declare_advanced_subscriber(
            node.session,
            key,
            self._heard,
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=depth) if history else None,
        )
        self._task = asyncio.create_task(self._run(), name=f"hears {name}")

    def says(self, kind: str, type_hash: str) -> None:
        """Be seen as somebody who hears this type."""
        if (kind, type_hash) not in self._tokens and len(self._tokens) < 16:
            self._tokens[kind, type_hash] = self._node.declare("MS", self.name, kind, type_hash, Qos(depth=self._depth))

    async def close(self) -> None:
        """Hear no more."""
        self._subscriber.undeclare()
        for each in self._tokens.values():
            each.undeclare()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    def _heard(self, sample: zenoh.Sample) -> None:
        """In a thread of Zenoh's."""
        try:
            self._put(self._arrived(sample))
        except WireError as error:
            self._node.soon(self._refuse, str(error))
        except Exception:  # noqa: BLE001 - nothing that a peer sends may end Zenoh's thread
            self._node.soon(self._refuse, "a message that nobody foresaw")

    def _arrived(self, sample: zenoh.Sample) -> Arrived:
        parts = str(sample.key_expr).rsplit("/", 2)
        kind, type_hash = wire.ros_type(parts[1]), parts[2]
        if sample.kind != zenoh.SampleKind.PUT:
            raise WireError("a deletion, which ROS 2 does not know")
        size = len(sample.payload)
        if size > self._max_message_bytes:
            raise WireError(f"messages of more than {self._max_message_bytes} bytes")
        beside = None if sample.attachment is None else sample.attachment.to_bytes()
        attachment = wire.parse_attachment(beside)
        return Arrived(self.name, kind, type_hash[:80], sample.payload.to_bytes(), attachment, 0)

    def _put(self, arrived: Arrived) -> None:
        with self._lock:
            self._queue.append(arrived)
            self._bytes += len(arrived.data)
            while len(self._queue) > self._depth or (self._bytes > MAX_QUEUE_BYTES and len(self._queue) > 1):
                self._bytes -= len(self._queue.popleft().data)
                self._lost += 1
            if self._awake:
                return
            self._awake = True
        self._node.soon(self._some.set)

    def _refuse(self, why: str) -> None:
        if why not in self.refused and len(self.refused) < 100:
            _log.warning("%s: %s; such messages are left out", self.name, why)
            self.refused[why] = 0
        if why in self.refused:
            self.refused[why] += 1

    async def _run(self) -> None:
        while True:
            await self._some.wait()
            self._some.clear()
            while (arrived := self._next()) is not None:
                try:
                    await self._take(arrived)
                except Ros2Error as error:
                    self._refuse(str(error))
                except Exception:  # noqa: BLE001 - nothing that a peer says may end its hearing for good, unseen
                    _log.exception("%s: a message is left out for a reason that nobody foresaw", self.name)

    def _next(self) -> Arrived | None:
        with self._lock:
            if not self._queue:
                self._awake = False
                return None
            first = self._queue.popleft()
            self._bytes -= len(first.data)
            lost, self._lost = self._lost, 0
        return Arrived(first.topic, first.type, first.type_hash, first.data, first.attachment, lost)


class Service:
    """A service that the node offers."""

    def __init__(self, node: Node, name: str, kind: ServiceType, serve: Serve) -> None:
        self.name: Final = name
        self._node = node
        self._type = kind
        self._serve = serve
        self._key = wire.data_key(node.domain, name, kind.name, kind.hash)
        self._calls: set[asyncio.Task[None]] = set()
        self._queryable: Any = node.session.declare_queryable(self._key, self._asked, complete=True)
        self._token: Any = node.declare("SS", name, kind.name, kind.hash, Qos())

    def close(self) -> None:
        """Answer no more."""
        self._token.undeclare()
        self._queryable.undeclare()
        for each in self._calls:
            each.cancel()

    def _asked(self, query: zenoh.Query) -> None:
        """In a thread of Zenoh's."""
        self._node.soon(self._begin, query)

    def _begin(self, query: zenoh.Query) -> None:
        if len(self._calls) >= MAX_CALLS:
            self._node.send_soon(lambda: _refuse(query, "too many calls at once; call again"))
            return
        task = asyncio.create_task(self._answer(query), name=f"a call of {self.name}")
        self._calls.add(task)
        task.add_done_callback(self._calls.discard)

    async def _answer(self, query: zenoh.Query) -> None:
        try:
            payload, beside = query.payload, query.attachment
            attachment = wire.parse_attachment(None if beside is None else beside.to_bytes())
            asked = self._type.request.decode(_request(payload))
            data = self._type.response.encode(await self._serve(asked))
            back = Attachment(attachment.seq, time.time_ns(), attachment.gid).encode()
            await self._node.in_thread(lambda: _reply(query, self._key, data, back))
        except Ros2Error as error:
            why = str(error)
            _log.warning("%s: a call is refused: %s", self.name, why)
            await self._node.in_thread(lambda: _refuse(query, why))
        except Exception:  # noqa: BLE001 - whoever calls gets an answer
            _log.exception("%s: a call ended for a reason that nobody foresaw", self.name)
            await self._node.in_thread(lambda: _refuse(query, "the service failed; see its log"))


def _request(payload: zenoh.ZBytes | None) -> bytes:
    if payload is None or len(payload) > MAX_REQUEST_BYTES:
        raise WireError(f"a request without a payload, or with more than {MAX_REQUEST_BYTES} bytes")
    return payload.to_bytes()


def _reply(query: zenoh.Query, key: str, data: bytes, beside: bytes) -> None:
    with query:
        query.reply(key, data, encoding=CDR, attachment=beside)


def _refuse(query: zenoh.Query, why: str) -> None:
    with query:
        query.reply_err(why.encode())


class Node:
    """``name`` is the node's full one (``/namespace/name``). Enter it to start."""

    def __init__(self, name: str, link: Link | None = None, *, domain: int = 0) -> None:
        if not wire.is_name(name) or not 0 <= domain <= wire.MAX_DOMAIN:
            raise SessionError(f"node {name[:100]!r} in domain {domain}: a name is /like/this, a domain 0 to 232")
        self.name: Final = name
        self.domain: Final = domain
        self._link = link or Link()
        self._session: zenoh.Session | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._sending = ThreadPoolExecutor(1, thread_name_prefix="ros2-send")
        self._ids = 0
        self._graph: dict[str, Endpoint] = {}
        self._parts: list[Any] = []
        self.changed = asyncio.Condition()
        """Notified when somebody came or went."""

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._session = await self.in_thread(lambda: open_session(self._link))
        self._zid = str(self._session.info.zid())
        node = Endpoint(self.domain, self._zid, 0, 0, "NN", self.name)
        self._parts = [
            self._session.liveliness().declare_token(node.token()),
            self._session.liveliness().declare_subscriber(
                f"{wire.ADMIN}/{self.domain}/**", self._graph_changed, history=True
            ),
        ]
        return self

    async def __aexit__(self, *_: object) -> None:
        session = self.session
        await self.in_thread(session.close)
        self._sending.shutdown(wait=False, cancel_futures=True)

    @property
    def session(self) -> zenoh.Session:
        """Zenoh's own. Raises SessionError before the node was entered."""
        if self._session is None:
            raise SessionError("the node is not open")
        return self._session

    def meets_somebody(self) -> bool:
        """Whether a router or a peer is connected just now."""
        info = self.session.info
        return bool(info.routers_zid() or info.peers_zid())

    def endpoints(self, kind: Kind, name: str | None = None) -> list[Endpoint]:
        """Who else publishes, hears, serves or calls; also this node's own."""
        return [each for each in self._graph.values() if each.kind == kind and name in {None, each.name}]

    async def wait_for(self, kind: Kind, name: str, wait_s: float) -> Endpoint | None:
        """The first of a kind; None where there was none within the time."""
        try:
            async with asyncio.timeout(wait_s), self.changed:
                await self.changed.wait_for(lambda: self.endpoints(kind, name))
        except TimeoutError:
            return None
        return self.endpoints(kind, name)[0]

    def advertise(self, name: str, kind: MessageType, qos: Qos | None = None) -> Publication:
        """Publish a topic from now on. Raises WireError."""
        return Publication(self, name, kind, qos or Qos())

    def subscribe(
        self,
        name: str,
        take: Take,
        *,
        depth: int = 10,
        max_message_bytes: int = 1 << 20,
        kind: MessageType | None = None,
        history: bool = True,
    ) -> Subscription:
        """Hear a topic from now on; ``take`` sees types and hashes, and refuses what it does not want."""
        if not wire.is_name(name):
            raise WireError(f"{name[:100]!r} is no name of ROS 2 (/like/this)")
        made = Subscription(self, name, take, depth=depth, max_message_bytes=max_message_bytes, history=history)
        if kind is not None:
            made.says(kind.name, kind.hash)
        return made

    def serve(self, name: str, kind: ServiceType, serve: Serve) -> Service:
        """Offer a service from now on. Raises WireError."""
        return Service(self, name, kind, serve)

    async def call(self, name: str, kind: ServiceType, request: Mapping[str, Any], wait_s: float = CALL_S) -> Any:
        """Call a service; the response as `rosbags` has it. Raises CallError, DefinitionError."""
        data = kind.request.encode(request)
        beside = Attachment(1, time.time_ns(), os.urandom(wire.GID_BYTES)).encode()
        key = wire.data_key(self.domain, name, kind.name, kind.hash)
        answer: asyncio.Future[bytes | str] = asyncio.get_running_loop().create_future()

        def settle(found: bytes | str) -> None:
            if not answer.done():
                answer.set_result(found)

        def replied(reply: zenoh.Reply) -> None:
            said: bytes | str = ""
            if reply.ok is not None:
                said = reply.ok.payload.to_bytes()
            elif reply.err is not None:
                said = reply.err.payload.to_bytes().decode(errors="replace")[:300]
            self.soon(settle, said)

        await self.in_thread(
            lambda: self.session.get(
                key,
                replied,
                payload=data,
                attachment=beside,
                encoding=CDR,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=wait_s,
            )
        )
        try:
            found = await asyncio.wait_for(answer, wait_s)
        except TimeoutError as cause:
            raise CallError(f"{name} ({kind.name}) did not answer within {wait_s:g} s; is it there?") from cause
        if isinstance(found, str):
            raise CallError(f"{name} refused the call: {found}")
        return kind.response.decode(found)

    def declare(self, kind: Kind, name: str, of: str, type_hash: str, qos: Qos) -> Any:
        """A token by which others see what is offered or heard."""
        self._ids += 1
        made = Endpoint(self.domain, self._zid, 0, self._ids, kind, self.name, name, of, type_hash, qos)
        return self.session.liveliness().declare_token(made.token())

    def soon(self, what: Callable[..., object], *arguments: object) -> None:
        """From another thread into asyncio's."""
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(what, *arguments)

    def send_soon(self, what: Callable[[], object]) -> None:
        """By the sending thread, waited for by nobody."""
        self._sending.submit(what)

    async def in_thread(self, what: Callable[[], _T]) -> _T:
        """By the sending thread, in order. Raises SessionError for what Zenoh refuses."""
        try:
            return await asyncio.get_running_loop().run_in_executor(self._sending, what)
        except zenoh.ZError as cause:
            raise SessionError(f"Zenoh: {str(cause)[:300]}") from cause

    def _graph_changed(self, sample: zenoh.Sample) -> None:
        """In a thread of Zenoh's."""
        self.soon(self._note, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _note(self, key: str, there: bool) -> None:
        if not there:
            self._graph.pop(key, None)
        elif len(self._graph) < MAX_ENDPOINTS:
            try:
                self._graph[key] = wire.parse_token(key)
            except WireError as error:
                _log.debug("%s", error)
                return
        asyncio.ensure_future(self._notify())  # noqa: RUF006 - it only wakes who waits

    async def _notify(self) -> None:
        async with self.changed:
            self.changed.notify_all()


__all__ = ["Arrived", "CallError", "DefinitionError", "Node", "Publication", "Service", "Subscription"]
