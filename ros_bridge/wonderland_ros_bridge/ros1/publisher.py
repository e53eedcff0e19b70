"""What the ledger half hands out, published by a node of ROS 1."""

from __future__ import annotations

import logging
from typing import Final

from wonderland_ros_bridge.errors import DefinitionError, WireError
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ros1 import definitions
from wonderland_ros_bridge.ros1.definitions import Definition
from wonderland_ros_bridge.ros1.node import Node, is_topic

_log = logging.getLogger(__name__)
STRING: Final = "std_msgs/String"


class Ros1Publisher:
    """Publishes only what is what it says: the definition has its MD5 sum, and the bytes are a message of it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: set[str] = set()

    async def publish_batch(self, topic: str, batch: Batch, definition: str | None, *, latch: bool) -> None:
        """Messages that a bridge stored, in their order. Raises WireError, DefinitionError."""
        if batch.encoding != "ros1":
            raise WireError(f"{topic}: messages in {batch.encoding}, not of ROS 1")
        if not is_topic(topic):
            raise WireError(f"{topic[:100]!r} is no name of a topic of ROS")
        parsed = definition_of(batch, definition)
        reader = definitions.codec(batch.type, parsed.text)
        messages = [each.data for each in batch.messages if each.data is not None]
        for each in messages:
            reader.decode(each)
        if len(messages) < len(batch.messages) and topic not in self._told:
            self._told.add(topic)
            _log.warning("%s has messages by their digest alone: those cannot be published", topic)
        if not messages:
            return
        publication = await self._node.advertise(topic, parsed, latch=latch)
        for each in messages:
            publication.publish(each)

    async def publish_text(self, topic: str, text: str, *, latch: bool) -> None:
        """A text as ``std_msgs/String``. Raises WireError."""
        parsed = definitions.parse(STRING, "string data\n")
        data = text.encode()
        publication = await self._node.advertise(topic, parsed, latch=latch)
        publication.publish(len(data).to_bytes(4, "little") + data)


def definition_of(batch: Batch, text: str | None) -> Definition:
    """What a batch's type looks like: as the ledger says it, or ROS's standard. Raises DefinitionError."""
    for each in (text, definitions.standard(batch.type)):
        if each is None:
            continue
        parsed = definitions.parse(batch.type, each)
        if parsed.md5 == batch.type_hash:
            return parsed
    raise DefinitionError(
        f"{batch.type} with MD5 sum {batch.type_hash}: nobody here or on the ledger says its definition"
    )
