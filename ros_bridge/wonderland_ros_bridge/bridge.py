"""A bridge at work: outbox, ledger and node, put together."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from collections.abc import AsyncIterator, Coroutine
from functools import partial
from typing import Any, Final

from wonderland.asset_contract import AssetContract
from wonderland.clock import Clock, SteadyClock
from wonderland.proof_contract import RefusedError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_ros_bridge.intake import Intake, Kind
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ledger.listener import Listener
from wonderland_ros_bridge.ledger.orders import MAX_ORDER_BYTES, Orders
from wonderland_ros_bridge.ledger.outbox import Outbox
from wonderland_ros_bridge.ledger.policy import rule_of
from wonderland_ros_bridge.ledger.sender import Sender
from wonderland_ros_bridge.ros1 import definitions
from wonderland_ros_bridge.ros1.hosts import Hosts
from wonderland_ros_bridge.ros1.node import MAX_TOPICS, Node
from wonderland_ros_bridge.ros1.publisher import STRING, Ros1Publisher
from wonderland_ros_bridge.ros1.subscription import Arrived
from wonderland_ros_bridge.settings import PREFIX, Settings
from wonderland_ros_bridge.together import run_together

_log = logging.getLogger(__name__)


class Ros1Bridge:
    """Topics to the ledger, the ledger to topics."""

    def __init__(
        self, settings: Settings, outbox: Outbox, ledger: AssetContract, *, clock: Clock, steady: Clock
    ) -> None:
        self._settings = settings
        self.outbox: Final = outbox
        ros1 = settings.ros1
        self.node: Final = Node(
            ros1.node,
            ros1.master,
            host=ros1.host,
            port=ros1.port,
            hosts=Hosts(ros1.networks),
            on_topics=self._look_at if any(rule.is_pattern for rule in settings.to_ledger) else None,
        )
        rules = partial(rule_of, rules=settings.to_ledger)
        self.sender: Final = Sender(outbox, ledger, prefix=PREFIX, rule_of=rules, clock=clock, rejected=self._say)
        self.intake: Final = Intake(outbox, self.sender, clock, steady=steady, max_bytes=settings.max_spool_bytes)
        self._publisher = Ros1Publisher(self.node)
        self._saying: set[asyncio.Task[None]] = set()
        self.listener: Final = Listener(
            ledger,
            outbox,
            self._publisher,
            settings.from_ledger,
            prefix=PREFIX,
            from_start=settings.from_start,
        )
        self._orders = Orders(ledger, prefix=PREFIX, bridge=settings.bridge)
        self._too_many = False
        self._appeared: asyncio.Queue[str] = asyncio.Queue()

    async def run(self) -> None:
        """Work until cancelled. Raises BridgeError."""
        work: list[Coroutine[Any, Any, None]] = [self.sender.run(), self.intake.run(), self._subscribe()]
        if self._settings.orders is not None:
            await self.node.subscribe(
                self._settings.orders, self._take_order, kind=STRING, max_message_bytes=MAX_ORDER_BYTES
            )
        if self._settings.from_ledger:
            work.append(self.listener.run())
        async with self.node:
            try:
                await run_together(self.node.run(), *work)
            finally:
                await self.intake.flush()

    async def wait_ready(self) -> None:
        """Until the master knows this node, and nothing that is committed from now on is missed."""
        await self.node.known.wait()
        if self._settings.from_ledger:
            await self.listener.placed.wait()

    def _say(self, batch: Batch, asset_id: str, error: RefusedError) -> None:
        """Tell the robot, too, what the ledger refused."""
        what = {"topic": batch.topic, "asset": asset_id, "messages": len(batch.messages)}
        text = json.dumps(what | {"code": error.code, "reason": error.text})
        task = asyncio.create_task(self._publisher.publish_text(f"{self.node.name}/rejected", text, latch=True))
        self._saying.add(task)
        task.add_done_callback(self._saying.discard)

    async def _take_order(self, arrived: Arrived) -> None:
        answer = await self._orders.carry_out(arrived.data[4:])
        await self._publisher.publish_text(f"{self.node.name}/answers", answer, latch=False)

    async def _take(self, arrived: Arrived) -> None:
        said = arrived.definition

        def read(data: bytes) -> object:
            return definitions.codec(said.type, said.text).decode(data)

        kind = Kind("ros1", said.type, said.md5, said.text, read)
        await self.intake.take(arrived.topic, kind, arrived.data, arrived.publisher)

    def _look_at(self, topics: list[tuple[str, str]]) -> None:
        for topic, _ in topics:
            if topic in self.node.subscriptions or not any(rule.fits(topic) for rule in self._settings.to_ledger):
                continue
            if len(self.node.subscriptions) + self._appeared.qsize() >= MAX_TOPICS:
                if not self._too_many:
                    _log.warning("%d topics are heard; %s and further ones are not", MAX_TOPICS, topic)
                self._too_many = True
                return
            self._appeared.put_nowait(topic)

    async def _subscribe(self) -> None:
        for rule in self._settings.to_ledger:
            if not rule.is_pattern:
                self._appeared.put_nowait(rule.topic)
        while True:
            topic = await self._appeared.get()
            if topic in self.node.subscriptions or topic in self.node.publications:
                continue
            rule = rule_of(topic, self._settings.to_ledger)
            await self.intake.begin(topic, rule)
            await self.node.subscribe(topic, self._take, kind=rule.type, max_message_bytes=rule.max_message_bytes)


def _now_ms() -> int:
    return time.time_ns() // 1_000_000


@contextlib.asynccontextmanager
async def opened(settings: Settings) -> AsyncIterator[Ros1Bridge]:
    """A bridge, ready to run. Raises BridgeError, LedgerError."""
    where = Connection.load(settings.ledger.connection)
    who, signer = where.identity(settings.ledger.identity), where.signer(settings.ledger.identity)
    outbox = Outbox(settings.spool, bridge=settings.bridge)
    try:
        async with where.open_channel() as channel:
            ledger = AssetContract(Gateway(channel, who, signer).network(where.channel), where.chaincode)
            yield Ros1Bridge(settings, outbox, ledger, clock=_now_ms, steady=SteadyClock())
    finally:
        outbox.close()
