"""A node of ROS 1: known to the master, in both directions, through restarts of either."""

from __future__ import annotations

import asyncio
import logging
import os
import re
from collections.abc import Callable
from typing import Any, Final, Self

from wonderland_ros_bridge.errors import BridgeError, WireError
from wonderland_ros_bridge.ros1 import tcpros, xml_rpc
from wonderland_ros_bridge.ros1.definitions import Definition
from wonderland_ros_bridge.ros1.hosts import Hosts
from wonderland_ros_bridge.ros1.publication import Publication, of_header
from wonderland_ros_bridge.ros1.subscription import Subscription, Take

_log = logging.getLogger(__name__)

_TOPIC: Final = re.compile(r"(?:/[A-Za-z][A-Za-z0-9_]*)+")
LOOK_S: Final = 1.0
"""How often the master is asked whether it knows this node, and which topics there are."""
SUBSCRIBERS_S: Final = 1.0
"""How long the first message of a new topic waits for those who have subscribed to it already."""
MAX_TOPICS: Final = 500
MAX_CONNECTIONS: Final = 1_000


class Node:
    """``name`` is the node's (``/wonderland``). Enter it to start; ``run`` keeps it known to the master."""

    def __init__(
        self,
        name: str,
        master: str,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        hosts: Hosts | None = None,
        on_topics: Callable[[list[tuple[str, str]]], None] | None = None,
    ) -> None:
        self.name: Final = name
        self._master = master
        self._host = host
        self._port = port
        self._hosts = hosts or Hosts()
        self._on_topics = on_topics
        self._api = xml_rpc.Server(self._hosts, self._handle)
        self._data: asyncio.Server | None = None
        self._open = 0
        self._subscriptions: dict[str, Subscription] = {}
        self._publications: dict[str, Publication] = {}
        self._asked_for: dict[str, int] = {}
        self._told: set[Subscription | Publication] = set()
        self._shutdown: asyncio.Future[None] | None = None
        self.known: Final = asyncio.Event()
        """Whether the master knows this node, as far as is known."""
        self.trouble = ""
        """Why the master does not know it at present."""

    async def __aenter__(self) -> Self:
        await self._api.start(self._host, self._port)
        self._shutdown = asyncio.get_running_loop().create_future()
        try:
            self._data = await asyncio.start_server(self._serve, self._host, 0, limit=tcpros.MAX_HEADER_BYTES)
        except OSError as cause:
            await self._api.close()
            raise WireError(f"cannot listen on {self._host}: {cause.strerror or cause}") from cause
        return self

    async def __aexit__(self, *_: object) -> None:
        for each in self._subscriptions.values():
            await each.close()
        for topic in self._subscriptions if self.known.is_set() else ():
            await self._quietly("unregisterSubscriber", topic, self.uri)
        for topic in self._publications if self.known.is_set() else ():
            await self._quietly("unregisterPublisher", topic, self.uri)
        for publication in self._publications.values():
            publication.close()
        if self._data is not None:
            self._data.close()
        await self._api.close()

    @property
    def uri(self) -> str:
        """This node's own API."""
        return f"http://{self._advertised}:{self._api.port}/"

    @property
    def subscriptions(self) -> dict[str, Subscription]:
        """What is heard, by topic."""
        return self._subscriptions

    @property
    def publications(self) -> dict[str, Publication]:
        """What is published, by topic."""
        return self._publications

    async def run(self) -> None:
        """Be known to the master until cancelled. Raises BridgeError when a tool of ROS ends this node."""
        assert self._shutdown is not None
        keeping = asyncio.create_task(self._keep_known(), name="the master")
        try:
            await asyncio.wait({keeping, self._shutdown}, return_when=asyncio.FIRST_COMPLETED)
            (keeping if keeping.done() else self._shutdown).result()
        finally:
            keeping.cancel()
            await asyncio.gather(keeping, return_exceptions=True)

    async def subscribe(self, topic: str, take: Take, *, kind: str | None = None, max_message_bytes: int) -> None:
        """Hear a topic from now on, from whoever publishes it."""
        if topic in self._subscriptions or len(self._subscriptions) >= MAX_TOPICS:
            return
        made = Subscription(self.name, topic, self._hosts, take, kind=kind, max_message_bytes=max_message_bytes)
        self._subscriptions[topic] = made
        if self.known.is_set():
            await self._try(self._register_subscriber(made))

    async def advertise(self, topic: str, definition: Definition, *, latch: bool) -> Publication:
        """Publish a topic from now on, once the master knows of it. Raises WireError where it has another type."""
        found = self._publications.get(topic)
        if found is not None:
            if found.definition.md5 != definition.md5 or found.definition.type != definition.type:
                raise WireError(f"{topic} is published as {found.definition.type}, and cannot be {definition.type} too")
            return found
        if len(self._publications) >= MAX_TOPICS:
            raise WireError(f"{topic}: {MAX_TOPICS} topics are published already")
        made = self._publications[topic] = Publication(topic, definition, latch=latch)
        await self.known.wait()
        while not await self._try(self._register_publisher(made)):
            await self.known.wait()
        await made.wait_for(self._asked_for.pop(topic, 0), SUBSCRIBERS_S)
        return made

    async def _keep_known(self) -> None:
        while True:
            try:
                if not (self.known.is_set() and await self._is_known()):
                    await self._register()
                if self._on_topics is not None:
                    self._on_topics(_topics(await self._call("getPublishedTopics", "")))
                self.trouble = ""
            except WireError as error:
                if str(error) != self.trouble:
                    _log.warning("the master does not know this node, tried again: %s", error)
                self.trouble = str(error)
                self.known.clear()
            await asyncio.sleep(LOOK_S)

    async def _is_known(self) -> bool:
        try:
            return bool(await self._call("lookupNode", self.name) == self.uri)
        except WireError as error:
            if ": refused: " in str(error):
                return False  # a new master, which has to be told everything
            raise

    async def _register(self) -> None:
        """Tell a master everything, also what is added meanwhile."""
        self._told.clear()
        await self._call("getUri")
        while more := [each for each in self._all() if each not in self._told]:
            for each in more:
                if isinstance(each, Subscription):
                    await self._register_subscriber(each)
                else:
                    await self._register_publisher(each)
        self.known.set()

    def _all(self) -> list[Subscription | Publication]:
        return [*self._subscriptions.values(), *self._publications.values()]

    async def _register_subscriber(self, subscription: Subscription) -> None:
        publishers = await self._call("registerSubscriber", subscription.topic, subscription.kind, self.uri)
        self._told.add(subscription)
        subscription.update(publishers if isinstance(publishers, list) else [], self.uri)

    async def _register_publisher(self, publication: Publication) -> None:
        subscribers = await self._call("registerPublisher", publication.topic, publication.definition.type, self.uri)
        self._told.add(publication)
        count = sum(each != self.uri for each in subscribers) if isinstance(subscribers, list) else 0
        self._asked_for[publication.topic] = min(count, 16)

    async def _try(self, work: Any) -> bool:
        try:
            await work
        except WireError as error:
            _log.warning("not registered, tried again: %s", error)
            self.known.clear()
            return False
        return True

    async def _call(self, method: str, *parameters: Any) -> Any:
        return await xml_rpc.call(self._hosts, self._master, method, self.name, *parameters)

    async def _quietly(self, method: str, *parameters: Any) -> None:
        try:
            await xml_rpc.call(self._hosts, self._master, method, self.name, *parameters, wait_s=0.5)
        except WireError:
            self.known.clear()  # it went first

    def _handle(self, method: str, parameters: tuple[Any, ...]) -> tuple[int, str, Any]:
        match method, parameters:
            case "publisherUpdate", (_, str() as topic, list() as uris):
                if topic in self._subscriptions:
                    self._subscriptions[topic].update(uris, self.uri)
                return 1, "", 0
            case "requestTopic", (_, str() as topic, list() as protocols):
                if topic not in self._publications:
                    return 0, f"no publisher of {topic[:100]}", 0
                if not any(isinstance(each, list) and each and each[0] == "TCPROS" for each in protocols):
                    return 0, "TCPROS alone is spoken", 0
                assert self._data is not None
                return 1, "", ["TCPROS", self._advertised, self._data.sockets[0].getsockname()[1]]
            case "getPid", _:
                return 1, "", os.getpid()
            case "getMasterUri", _:
                return 1, "", self._master
            case "getSubscriptions", _:
                return 1, "", [[each.topic, each.kind] for each in self._subscriptions.values()]
            case "getPublications", _:
                return 1, "", [[each.topic, each.definition.type] for each in self._publications.values()]
            case "getBusStats", _:
                return 1, "", [[], [], []]
            case "getBusInfo", _:
                return 1, "", []
            case "paramUpdate", _:
                return 1, "", 0
            case "shutdown", (str() as caller, *rest):
                if self._shutdown is not None and not self._shutdown.done():
                    why = f" ({str(rest[0])[:100]})" if rest else ""
                    self._shutdown.set_exception(BridgeError(f"{caller[:100]} ended this node{why}"))
                return 1, "", 0
        return -1, f"no method {method[:60]!r} with these parameters", 0

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = writer.get_extra_info("peername") or ("?",)
        self._open += 1
        try:
            if self._open > MAX_CONNECTIONS or not self._hosts.allows(str(peer[0])):
                return
            fields = await tcpros.read_header(reader)
            try:
                publication = of_header(self._publications, fields)
            except WireError as error:
                writer.write(tcpros.header({"error": str(error)}))
                await writer.drain()
                raise
            await publication.serve(self.name, fields, reader, writer)
        except WireError as error:
            _log.warning("a subscriber from %s is refused: %s", peer[0], error)
        except OSError:
            pass  # it went away
        finally:
            self._open -= 1
            writer.close()

    @property
    def _advertised(self) -> str:
        return xml_rpc.own_name(self._host)


def is_topic(name: str) -> bool:
    """Whether this is the full name of a topic, as ROS allows it."""
    return len(name) <= 255 and _TOPIC.fullmatch(name) is not None


def _topics(answer: Any) -> list[tuple[str, str]]:
    """(topic, type) of what the master says is published; names that ROS does not allow are left out."""
    if not isinstance(answer, list):
        return []
    return [
        (each[0], each[1])
        for each in answer
        if isinstance(each, list) and len(each) == 2 and all(isinstance(one, str) for one in each) and is_topic(each[0])
    ]
