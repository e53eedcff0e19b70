"""Topics of ROS 2 to the ledger, and from it to topics: this wire's side of the half that both share."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Coroutine
from functools import partial
from typing import Any, Final

from wonderland.asset_contract import AssetContract
from wonderland.clock import Clock
from wonderland.proof_contract import RefusedError
from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.definitions import full_name
from wonderland_rmw_zenoh.errors import DefinitionError, Ros2Error
from wonderland_rmw_zenoh.interfaces import Interfaces, MessageType, of_text
from wonderland_rmw_zenoh.node import Arrived, Node, Publication
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.intake import Intake, Kind
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ledger.listener import Listener
from wonderland_ros_bridge.ledger.outbox import Outbox
from wonderland_ros_bridge.ledger.policy import rule_of
from wonderland_ros_bridge.ledger.sender import Sender
from wonderland_ros_bridge.ros2.settings import PREFIX, Settings
from wonderland_ros_bridge.together import run_together

_log = logging.getLogger(__name__)

MAX_TOPICS: Final = 500
LOOK_S: Final = 1.0
DEPTH: Final = 1_000
"""Messages of a topic that wait for the disk; ROS 2's KEEP_LAST: of more the oldest go, and are counted."""
TEXT: Final = "std_msgs/msg/String"


class Topics:
    """Topics to the ledger and back, on a node that is open."""

    def __init__(
        self,
        settings: Settings,
        node: Node,
        outbox: Outbox,
        ledger: AssetContract,
        *,
        clock: Clock,
        steady: Clock,
    ) -> None:
        self._settings = settings
        self._node = node
        self._types = Interfaces(settings.interfaces)
        self._publisher = Ros2Publisher(node, self._types)
        self._heard: set[str] = set()
        self._too_many = False
        self._saying: set[asyncio.Task[None]] = set()
        rules = partial(rule_of, rules=settings.to_ledger)
        self._sender = Sender(outbox, ledger, prefix=PREFIX, rule_of=rules, clock=clock, rejected=self._say)
        self._intake = Intake(outbox, self._sender, clock, steady=steady, max_bytes=settings.max_spool_bytes)
        self._listener = Listener(
            ledger, outbox, self._publisher, settings.from_ledger, prefix=PREFIX, from_start=settings.from_start
        )

    async def wait_placed(self) -> None:
        """Until nothing that is committed from now on is missed."""
        if self._settings.from_ledger:
            await self._listener.placed.wait()

    async def run(self) -> None:
        """Work until cancelled. Raises BridgeError, Ros2Error."""
        work: list[Coroutine[Any, Any, None]] = [self._sender.run(), self._intake.run(), self._subscribe()]
        if self._settings.from_ledger:
            work.append(self._listener.run())
        try:
            await run_together(*work)
        finally:
            await self._intake.flush()

    async def _subscribe(self) -> None:
        for rule in self._settings.to_ledger:
            if not rule.is_pattern:
                await self._hear(rule.topic)
        patterns = [rule for rule in self._settings.to_ledger if rule.is_pattern]
        while True:
            for name in sorted({each.name for each in self._node.endpoints("MP")} if patterns else ()):
                if any(rule.fits(name) for rule in patterns):
                    await self._hear(name)
            await asyncio.sleep(LOOK_S)

    async def _hear(self, topic: str) -> None:
        if topic in self._heard or topic in self._publisher.topics:
            return
        if len(self._heard) >= MAX_TOPICS:
            if not self._too_many:
                _log.warning("%d topics are heard; %s and further ones are not", MAX_TOPICS, topic)
            self._too_many = True
            return
        rule = rule_of(topic, self._settings.to_ledger)
        self._heard.add(topic)
        await self._intake.begin(topic, rule)

        async def take(arrived: Arrived) -> None:
            if rule.type is not None and arrived.type != full_name(rule.type, ""):
                raise DefinitionError(f"its type is {arrived.type}, and {rule.type} is wanted")
            kind = self._types.of_hash(arrived.type, arrived.type_hash)
            sender = arrived.attachment.gid.hex()
            await self._intake.take(topic, _kind(kind), arrived.data, sender, lost=arrived.lost)

        made = self._node.subscribe(topic, take, depth=DEPTH, max_message_bytes=rule.max_message_bytes)
        if rule.type is not None:
            known = self._types.message(full_name(rule.type, ""))
            made.says(known.name, known.hash)

    def _say(self, batch: Batch, asset_id: str, error: RefusedError) -> None:
        """Tell the robot, too, what the ledger refused."""
        what = {"topic": batch.topic, "asset": asset_id, "messages": len(batch.messages)}
        text = json.dumps(what | {"code": error.code, "reason": error.text})
        task = asyncio.create_task(self._publisher.publish_text(f"{self._node.name}/rejected", text, latch=True))
        self._saying.add(task)
        task.add_done_callback(self._saying.discard)


def _kind(kind: MessageType) -> Kind:
    return Kind("cdr", kind.name, kind.hash, kind.codec.definition.text(), kind.codec.decode)


class Ros2Publisher:
    """Publishes only what is what it says: the definition has its hash, and the bytes are a message of it."""

    def __init__(self, node: Node, types: Interfaces) -> None:
        self._node = node
        self._types = types
        self.topics: dict[str, Publication] = {}
        self._told: set[str] = set()

    async def publish_batch(self, topic: str, batch: Batch, definition: str | None, *, latch: bool) -> None:
        """Messages that a bridge stored, in their order. Raises BridgeError."""
        if batch.encoding != "cdr":
            raise BridgeError(f"{topic}: messages in {batch.encoding}, not of ROS 2")
        messages = [each.data for each in batch.messages if each.data is not None]
        if len(messages) < len(batch.messages) and topic not in self._told:
            self._told.add(topic)
            _log.warning("%s has messages by their digest alone: those cannot be published", topic)
        try:
            kind = type_of(self._types, batch, definition)
            for each in messages:
                kind.codec.decode(each)
            publication = self._topic(topic, kind, latch=latch)
            for each in messages:
                await publication.publish_bytes(each)
        except Ros2Error as error:
            raise BridgeError(str(error)) from error

    async def publish_text(self, topic: str, text: str, *, latch: bool) -> None:
        """A text as ``std_msgs/msg/String``. Raises BridgeError."""
        try:
            await self._topic(topic, self._types.message(TEXT), latch=latch).publish({"data": text})
        except Ros2Error as error:
            raise BridgeError(str(error)) from error

    def _topic(self, topic: str, kind: MessageType, *, latch: bool) -> Publication:
        found = self.topics.get(topic)
        if found is None:
            if len(self.topics) >= MAX_TOPICS:
                raise BridgeError(f"{MAX_TOPICS} topics are published; {topic} is not")
            found = self._node.advertise(topic, kind, wire.STATE if latch else wire.Qos())
            self.topics[topic] = found
        if found.type.hash != kind.hash:
            raise BridgeError(f"{topic} has type {found.type.name} already, and these messages are {kind.name}")
        return found


def type_of(types: Interfaces, batch: Batch, text: str | None) -> MessageType:
    """What a batch's type looks like: as the ledger says it, or as it is known here. Raises DefinitionError."""
    if text is not None:
        try:
            return of_text(batch.type, batch.type_hash, text)
        except DefinitionError as error:
            _log.warning("%s", error)
    return types.of_hash(batch.type, batch.type_hash)
