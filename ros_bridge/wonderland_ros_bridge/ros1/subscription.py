"""One topic that a node subscribes to: a connection to each of its publishers, for as long as the master names it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from typing import Final

from wonderland_ros_bridge.errors import DefinitionError, WireError
from wonderland_ros_bridge.ros1 import definitions, tcpros, xml_rpc
from wonderland_ros_bridge.ros1.definitions import Definition
from wonderland_ros_bridge.ros1.hosts import Hosts

_log = logging.getLogger(__name__)

FIRST_PAUSE_S: Final = 0.2
MAX_PAUSE_S: Final = 10.0
MAX_PUBLISHERS: Final = 64
READ_BYTES: Final = 1 << 20
"""What a connection reads ahead: beyond it the publisher waits, while the bridge does not take more."""


@dataclass(frozen=True, slots=True)
class Arrived:
    """A message as it came, and what its publisher says it is."""

    topic: str
    definition: Definition
    data: bytes
    publisher: str


Take = Callable[[Arrived], Awaitable[None]]


class Subscription:
    """``take`` is awaited for each message: as long as it does not return, nothing more of that publisher is read."""

    def __init__(
        self, name: str, topic: str, hosts: Hosts, take: Take, *, kind: str | None = None, max_message_bytes: int
    ) -> None:
        self.topic: Final = topic
        self.kind: Final = kind or "*"
        self._name = name
        self._hosts = hosts
        self._take = take
        self._max_message_bytes = max_message_bytes
        self._publishers: dict[str, asyncio.Task[None]] = {}
        self.trouble: dict[str, str] = {}
        """Why a publisher is not heard, by its address."""
        self.connected: set[str] = set()

    def update(self, uris: Iterable[object], own: str) -> None:
        """The topic's publishers, as the master says; ``own`` is the bridge's address, which it does not hear."""
        named = [uri for uri in uris if isinstance(uri, str) and len(uri) < 300 and uri != own]
        if len(named) > MAX_PUBLISHERS:
            _log.warning("%s has %d publishers; the first %d are heard", self.topic, len(named), MAX_PUBLISHERS)
        wanted = set(named[:MAX_PUBLISHERS])
        for uri in self._publishers.keys() - wanted:
            self._publishers.pop(uri).cancel()
            self.trouble.pop(uri, None)
        for uri in wanted - self._publishers.keys():
            self._publishers[uri] = asyncio.create_task(self._hear(uri), name=f"{self.topic} from {uri}")

    async def close(self) -> None:
        """Hear nobody any more."""
        tasks = list(self._publishers.values())
        self._publishers.clear()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _hear(self, uri: str) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            try:
                if await self._connection(uri):
                    pause_s = FIRST_PAUSE_S
            except (WireError, DefinitionError, OSError) as error:
                if self.trouble.get(uri) != str(error):
                    _log.warning("%s is not heard from %s: %s", self.topic, uri, error)
                self.trouble[uri] = str(error)
            except Exception:  # noqa: BLE001 - nothing that a publisher says may end its hearing for good, unseen
                _log.exception("%s is not heard from %s for a reason that nobody foresaw", self.topic, uri)
            await asyncio.sleep(pause_s)
            pause_s = min(MAX_PAUSE_S, pause_s * 2)

    async def _connection(self, uri: str) -> bool:
        """One connection from its beginning to its end; whether a message came. Raises WireError, DefinitionError."""
        answer = await xml_rpc.call(self._hosts, uri, "requestTopic", self._name, self.topic, [["TCPROS"]])
        if not (
            isinstance(answer, list)
            and len(answer) == 3
            and answer[0] == "TCPROS"
            and isinstance(answer[1], str)
            and isinstance(answer[2], int)
            and 0 < answer[2] < 65_536
        ):
            raise WireError("the publisher does not offer TCPROS")
        async with asyncio.timeout(xml_rpc.CALL_S):
            reader, writer = await self._hosts.connect(answer[1], answer[2], limit=READ_BYTES)
        try:
            wanted = {"callerid": self._name, "topic": self.topic, "type": self.kind, "md5sum": "*", "tcp_nodelay": "1"}
            writer.write(tcpros.header(wanted))
            await writer.drain()
            definition = self._understood(await tcpros.read_header(reader))
            self.connected.add(uri)
            self.trouble.pop(uri, None)
            heard = False
            while (data := await tcpros.read_message(reader, self._max_message_bytes)) is not None:
                await self._take(Arrived(self.topic, definition, data, uri))
                heard = True
            return heard
        finally:
            self.connected.discard(uri)
            writer.close()

    def _understood(self, fields: dict[str, str]) -> Definition:
        if "error" in fields:
            raise WireError(f"the publisher refuses: {fields['error'][:200]}")
        kind, md5 = fields.get("type", ""), fields.get("md5sum", "")
        if self.kind not in {"*", kind}:
            raise WireError(f"its type is {kind[:60]!r}, and {self.kind} is wanted")
        if not definitions.is_type(kind):
            raise WireError(f"its type is {kind[:60]!r}, which is no package/Type")
        text = fields.get("message_definition") or definitions.standard(kind)
        if text is None:
            raise DefinitionError(f"{kind} is not known here, and the publisher does not say its definition")
        definition = definitions.parse(kind, text)
        if definition.md5 != md5:
            raise DefinitionError(
                f"{kind}: MD5 sum {md5[:40]!r}, but the definition has {definition.md5}; one of them is wrong"
            )
        return definition
