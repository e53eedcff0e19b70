"""From the outbox onto the ledger: each batch once, in the order of its topic, until the ledger has spoken."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final, Protocol

from wonderland.clock import Clock
from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.assets import Asset
from wonderland_ros_bridge.errors import EnvelopeError
from wonderland_ros_bridge.ledger import envelope
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ledger.outbox import Outbox
from wonderland_ros_bridge.ledger.policy import Rule

_log = logging.getLogger(__name__)

FIRST_PAUSE_S: Final = 0.1
MAX_PAUSE_S: Final = 10.0
IN_FLIGHT: Final = 8
"""Topics whose transactions are under way at once."""
_OF_THE_MESSAGE: Final = frozenset({400, 403, 404, 409, 413, 422})
"""Statuses of the contract that the same batch will meet again; all else may pass, and is tried again."""
_OF_THE_BRIDGE: Final = frozenset(
    {"FUNCTION_UNKNOWN", "ROLE_MISSING", "ROLE_OF_OTHER_ORGANISATION", "ROLE_NOT_ALLOWED"}
)
"""Refusals that are about this bridge's certificate, not about what it sends: they hold everything up."""


class AssetLedger(Protocol):
    """Assets on the ledger (``wonderland.asset_contract.AssetContract``)."""

    async def create_asset(self, argument: tx.CreateAsset) -> Committed:
        """Store a new value."""
        ...

    async def update_asset(self, argument: tx.UpdateAsset) -> Committed:
        """Replace a value."""
        ...

    async def read_asset(self, asset_id: str) -> Asset | None:
        """An asset as it stands."""
        ...


class Sender:
    """Sends what waits in the outbox; ``rejected`` hears of each batch that the ledger refused for good."""

    def __init__(
        self,
        outbox: Outbox,
        ledger: AssetLedger,
        *,
        prefix: str,
        rule_of: Callable[[str], Rule],
        clock: Clock,
        rejected: Callable[[Batch, str, RefusedError], None] = lambda *_: None,
    ) -> None:
        self._outbox = outbox
        self._ledger = ledger
        self._prefix = prefix
        self._rule_of = rule_of
        self._clock = clock
        self._rejected = rejected
        self._slots = asyncio.Semaphore(IN_FLIGHT)
        self._topics: dict[str, asyncio.Task[None]] = {}
        self._more: dict[str, asyncio.Event] = {}
        self._defined: set[tuple[str, str]] = set()
        self._failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.settled = asyncio.Condition()
        """Notified when room came about in the outbox."""
        self.committed = 0
        """Batches that the ledger took since the start."""
        self.trouble = ""
        """Why nothing gets through at present."""

    def wake(self, topic: str) -> None:
        """Something of a topic waits."""
        if topic not in self._more:
            self._more[topic] = asyncio.Event()
            task = asyncio.create_task(self._run_topic(topic), name=f"to the ledger: {topic}")
            task.add_done_callback(self._ended)
            self._topics[topic] = task
        self._more[topic].set()

    async def run(self) -> None:
        """Send until cancelled, beginning with what a former run left. Raises SpoolError."""
        for topic in await self._outbox.run(self._outbox.waiting):
            self.wake(topic)
        try:
            await self._failed
        finally:
            for task in self._topics.values():
                task.cancel()
            await asyncio.gather(*self._topics.values(), return_exceptions=True)

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None and not self._failed.done():
            self._failed.set_exception(error)

    async def _run_topic(self, topic: str) -> None:
        more, rule = self._more[topic], self._rule_of(topic)
        while True:
            more.clear()
            found = await self._outbox.run(
                self._outbox.next_batch,
                topic,
                max_messages=rule.batch_messages,
                max_characters=rule.batch_bytes * 4 // 3,
            )
            if found is None:
                await more.wait()
                continue
            batch, perhaps_sent = found
            async with self._slots:
                await self._send(batch, rule, perhaps_sent=perhaps_sent)
            async with self.settled:
                self.settled.notify_all()

    async def _send(self, batch: Batch, rule: Rule, *, perhaps_sent: bool) -> None:
        each = rule.keep == "each"
        asset_id = (
            envelope.batch_asset_id(self._prefix, batch)
            if each
            else envelope.topic_asset_id(self._prefix, batch.bridge, batch.topic)
        )
        pause_s = FIRST_PAUSE_S
        while True:
            try:
                await self._define(batch)
                if not (perhaps_sent and await self._is_there(asset_id, batch)):
                    perhaps_sent = True
                    await self._submit(asset_id, batch, each=each)
            except AwayError as error:
                self._held_up(f"the ledger cannot be reached: {error}")
            except RefusedError as error:
                if error.status in _OF_THE_MESSAGE and error.code not in _OF_THE_BRIDGE:
                    await self._outbox.run(
                        self._outbox.reject, batch, asset_id, int(self._clock()), error.code, error.text
                    )
                    _log.error(
                        "%s: the ledger refused %d messages (%s); they are kept: wonderland ros1 rejected",
                        *(batch.topic, len(batch.messages), error),
                    )
                    self._rejected(batch, asset_id, error)
                    return
                self._held_up(str(error))
            else:
                await self._outbox.run(self._outbox.settle, batch)
                self.committed += 1
                self.trouble = ""
                return
            await asyncio.sleep(pause_s)
            pause_s = min(MAX_PAUSE_S, pause_s * 2)

    def _held_up(self, why: str) -> None:
        if why != self.trouble:
            _log.warning("nothing gets onto the ledger, tried again: %s", why)
        self.trouble = why

    async def _submit(self, asset_id: str, batch: Batch, *, each: bool) -> None:
        value = batch.value()
        if not each:
            try:
                argument = tx.UpdateAsset(id=asset_id, value=value, type=batch.type, media_type=envelope.MEDIA_TYPE)
                await self._ledger.update_asset(argument)
            except RefusedError as error:
                if error.code != "ASSET_UNKNOWN":
                    raise
            else:
                return
        await self._ledger.create_asset(
            tx.CreateAsset(id=asset_id, type=batch.type, media_type=envelope.MEDIA_TYPE, value=value)
        )

    async def _is_there(self, asset_id: str, batch: Batch) -> bool:
        """Whether an earlier attempt got through, though its answer did not."""
        asset = await self._ledger.read_asset(asset_id)
        if asset is None:
            return False
        try:
            stored = envelope.parse(asset.value)
        except EnvelopeError:
            return False
        return (stored.bridge, stored.epoch) == (batch.bridge, batch.epoch) and stored.batch >= batch.batch

    async def _define(self, batch: Batch) -> None:
        """The type's definition comes before its first message, so that a listener can know any type."""
        if (batch.type, batch.type_hash) in self._defined:
            return
        found = await self._outbox.run(self._outbox.definition, batch.type, batch.type_hash)
        if found is None or found[1]:
            self._defined.add((batch.type, batch.type_hash))
            return
        asset_id = envelope.definition_asset_id(self._prefix, batch.bridge, batch.type, batch.type_hash)
        argument = tx.CreateAsset(
            id=asset_id, type=batch.type, media_type=envelope.DEFINITION_MEDIA_TYPE, value=found[0]
        )
        try:
            await self._ledger.create_asset(argument)
        except RefusedError as error:
            if error.code != "ASSET_EXISTS":
                raise
            there = await self._ledger.read_asset(asset_id)
            if there is not None and there.value != argument.value:
                _log.error(
                    "the definition of %s is not on the ledger: asset %s belongs to %s of %s and says something else; "
                    "call this bridge by another name",
                    *(batch.type, asset_id, there.owner, there.owner_msp),
                )
        await self._outbox.run(self._outbox.definition_stored, batch.type, batch.type_hash)
