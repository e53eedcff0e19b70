"""One topic that a node publishes: its subscribers' connections, and the last message for those who come later."""

from __future__ import annotations

import asyncio
import logging
from typing import Final

from wonderland_ros_bridge.errors import WireError
from wonderland_ros_bridge.ros1 import tcpros
from wonderland_ros_bridge.ros1.definitions import Definition

_log = logging.getLogger(__name__)

MAX_BEHIND_BYTES: Final = 32 << 20
"""What a subscriber may leave unread; one that leaves more is let go, and may come again."""


class Publication:
    """A message goes to whoever is connected; TCPROS knows no acknowledgement."""

    def __init__(self, topic: str, definition: Definition, *, latch: bool) -> None:
        self.topic: Final = topic
        self.definition: Final = definition
        self.latch: Final = latch
        self._writers: dict[asyncio.StreamWriter, str] = {}
        self._last: bytes | None = None
        self.subscribed = asyncio.Condition()
        """Notified when somebody has connected."""

    @property
    def subscribers(self) -> int:
        """How many are connected."""
        return len(self._writers)

    def refuses(self, fields: dict[str, str]) -> str:
        """Why a subscriber with this header is not served; empty where it is."""
        kind, md5 = fields.get("type", "*"), fields.get("md5sum", "*")
        if kind not in {"*", self.definition.type}:
            return f"{self.topic} has type {self.definition.type}, not {kind[:100]}"
        if md5 not in {"*", self.definition.md5}:
            return f"{self.topic} has md5sum {self.definition.md5}, not {md5[:40]}: another definition of the type"
        return ""

    async def serve(
        self, name: str, fields: dict[str, str], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Send to a subscriber until it goes."""
        answer = {
            "callerid": name,
            "latching": str(int(self.latch)),
            "md5sum": self.definition.md5,
            "message_definition": self.definition.text,
            "topic": self.topic,
            "type": self.definition.type,
        }
        writer.write(tcpros.header(answer))
        if self._last is not None:
            writer.write(self._last)
        self._writers[writer] = fields.get("callerid", "?")[:100]
        async with self.subscribed:
            self.subscribed.notify_all()
        try:
            while await reader.read(4_096):
                pass  # a subscriber has nothing to say
        finally:
            self._writers.pop(writer, None)

    def publish(self, data: bytes) -> None:
        """Send a message to all that are connected."""
        framed = tcpros.frame(data)
        if self.latch:
            self._last = framed
        for writer, who in list(self._writers.items()):
            if writer.transport.get_write_buffer_size() > MAX_BEHIND_BYTES:
                _log.warning("%s does not read %s: let go", who, self.topic)
                self._writers.pop(writer, None)
                writer.transport.abort()
            else:
                writer.write(framed)

    async def wait_for(self, subscribers: int, wait_s: float) -> None:
        """Until so many are connected, or the time is up."""
        try:
            async with asyncio.timeout(wait_s), self.subscribed:
                await self.subscribed.wait_for(lambda: len(self._writers) >= subscribers)
        except TimeoutError:
            pass

    def close(self) -> None:
        """Let all subscribers go."""
        for writer in list(self._writers):
            writer.close()


def of_header(publications: dict[str, Publication], fields: dict[str, str]) -> Publication:
    """The publication that a subscriber's header asks for. Raises WireError."""
    found = publications.get(fields.get("topic", ""))
    if found is None:
        raise WireError(f"no publisher of {fields.get('topic', '')[:100]!r} here")
    if why := found.refuses(fields):
        raise WireError(why)
    return found
