"""From a wire into the outbox: samples, numbers, and no more than there is room for."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland.clock import Clock
from wonderland_ros_bridge.errors import DefinitionError
from wonderland_ros_bridge.ledger.envelope import Encoding
from wonderland_ros_bridge.ledger.outbox import Outbox, Received
from wonderland_ros_bridge.ledger.policy import Rule, Sampler
from wonderland_ros_bridge.ledger.sender import Sender

_log = logging.getLogger(__name__)

MAX_AT_ONCE: Final = 4 << 20
"""Bytes of messages that wait for the disk together."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What a message is said to be; ``read`` raises DefinitionError for bytes that are none of it."""

    encoding: Encoding
    type: str
    type_hash: str
    definition: str
    read: Callable[[bytes], object]


class Intake:
    """``take`` returns when the message is on the disk's way, and not before there is room.

    ``clock`` is the time that people read; samples go by ``steady``, which no step of the system's clock moves.
    """

    def __init__(self, outbox: Outbox, sender: Sender, clock: Clock, *, steady: Clock, max_bytes: int) -> None:
        self._outbox = outbox
        self._sender = sender
        self._clock = clock
        self._steady = steady
        self._max_bytes = max_bytes
        self._samplers: dict[str, Sampler] = {}
        self._counts: dict[str, int] = {}
        self._queue: list[Received] = []
        self._definitions: dict[tuple[str, str], str] = {}
        self._queued_bytes = 0
        self._change = asyncio.Condition()
        self._writing = asyncio.Lock()
        self.waits = 0
        """How often a publisher had to wait for room."""
        self.taken = 0
        self.refused = 0
        self._told: set[tuple[str, str]] = set()

    async def begin(self, topic: str, rule: Rule) -> None:
        """A topic that will be taken."""
        self._samplers[topic] = Sampler(rule)
        self._counts[topic] = await self._outbox.run(self._outbox.received, topic)

    async def take(self, topic: str, kind: Kind, data: bytes, publisher: str, *, lost: int = 0) -> None:
        """A message that came; bytes that are none of its type are refused and counted.

        ``lost``: how many of the topic came before it and could not be held; they are counted, too.
        """
        sampler = self._samplers[topic]
        t_ms = self._clock()
        self._counts[topic] += 1 + lost
        seq = self._counts[topic]
        if not sampler.takes(self._steady()):
            return
        message = sampler.message(seq, t_ms, data)
        if message.data is not None:
            try:
                kind.read(data)
            except DefinitionError as error:
                self._refuse((topic, publisher), error)
                return
        if self._outbox.pending_bytes >= self._max_bytes:
            self.waits += 1
            async with self._sender.settled:
                await self._sender.settled.wait_for(lambda: self._outbox.pending_bytes < self._max_bytes)
        async with self._change:
            await self._change.wait_for(lambda: self._queued_bytes < MAX_AT_ONCE)
            self._definitions[kind.type, kind.type_hash] = kind.definition
            self._queue.append(Received(topic, kind.encoding, kind.type, kind.type_hash, message))
            self._queued_bytes += len(message.data or b"") + 200
            self._change.notify_all()

    def _refuse(self, who: tuple[str, str], error: DefinitionError) -> None:
        self.refused += 1
        if who not in self._told:
            self._told.add(who)
            _log.warning("%s from %s: %s; such messages are left out", *who, error)

    async def run(self) -> None:
        """Write what came to the disk, all that is there at once, until cancelled. Raises SpoolError."""
        while True:
            async with self._change:
                await self._change.wait_for(lambda: bool(self._queue))
            for topic in await self.flush():
                self._sender.wake(topic)

    async def flush(self) -> set[str]:
        """Write what has come to the disk; returns the topics of which something came. Raises SpoolError."""
        async with self._writing:
            async with self._change:
                messages, self._queue, self._queued_bytes = self._queue, [], 0
                definitions = [(*kind, text) for kind, text in self._definitions.items()]
                self._definitions.clear()
                self._change.notify_all()
            topics = {each.topic for each in messages}
            if messages:
                counts = {each: self._counts[each] for each in topics}
                # Who is told to stop meanwhile must not take back what waits for the disk.
                await asyncio.shield(self._outbox.run(self._outbox.put, messages, counts, definitions))
                self.taken += len(messages)
            return topics
