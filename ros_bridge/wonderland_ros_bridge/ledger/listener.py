"""From the ledger to topics: what is committed, chosen by event, type, asset and owner, not by knowing publishers.

Blocks are read from where the last run left off. A block's messages are handed out first and its place is kept after:
a kill in between hands some out again. What a bridge sends is numbered, so a batch that was handed out before this
block is not handed out twice, whatever way it comes.
"""

from __future__ import annotations

import asyncio
import fnmatch
import logging
from collections.abc import AsyncIterator, Sequence
from typing import Annotated, Final, Literal, Protocol

from msgspec import Meta

from wonderland.asset_contract import CommittedBlock, CommittedEvent
from wonderland.proofs import encoding
from wonderland.proofs.records.assets import Asset
from wonderland.toml_settings import Table
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_ros_bridge.errors import BridgeError, EnvelopeError
from wonderland_ros_bridge.ledger import envelope
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ledger.outbox import Outbox

_log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
KEEP_EVERY: Final = 64
"""Blocks without anything for this bridge, after which the place is kept all the same."""

Pattern = Annotated[str, Meta(min_length=1, max_length=200)]


class Choice(Table, frozen=True):
    """``[[from_ledger]]``: which committed events become messages, and of which topic."""

    senders: Annotated[tuple[Pattern, ...], Meta(min_length=1)]
    """``MSP/common name`` of whose transactions this robot hears, as patterns. Say ``["*"]`` where all may speak."""
    topic: Annotated[
        str,
        Meta(
            min_length=2,
            max_length=255,
            pattern=r"\A(?:/|\{topic\})[A-Za-z0-9_/{}]*\Z",
            examples=["/ledger/{bridge}{topic}"],
        ),
    ] = "/ledger/{bridge}{topic}"
    """Where to: ``{bridge}`` and ``{topic}`` are those from which the messages come, ``{event}`` is the event."""
    events: tuple[Pattern, ...] = ("Asset*",)
    """Names of the ledger’s events."""
    types: tuple[Pattern, ...] = ("*",)
    """Of an asset's value, for example ``geometry_msgs/*``."""
    assets: tuple[Pattern, ...] = ("*",)
    """Identifiers of assets."""
    give: Literal["messages", "events"] = "messages"
    """What a bridge stored, as it was published; or each event as JSON in a ``std_msgs/String``."""
    latch: bool = True
    """Whether who subscribes later gets the last message."""

    def fits(self, event: CommittedEvent) -> bool:
        """Whether this choice is about an event."""
        record = event.record
        return (
            _one_of(self.events, event.name)
            and _one_of(self.senders, event.sender)
            and (not event.name.startswith("Asset") or _one_of(self.types, str(record.get("type", ""))))
            and (not event.name.startswith("Asset") or _one_of(self.assets, str(record.get("id", ""))))
        )


class Committed(Protocol):
    """What is committed (``wonderland.asset_contract.AssetContract``)."""

    async def height(self) -> int:
        """How many blocks there are."""
        ...

    def committed(self, start_block: int) -> AsyncIterator[CommittedBlock]:
        """Every block from there on, for ever."""
        ...

    async def read_asset(self, asset_id: str) -> Asset | None:
        """An asset as it stands."""
        ...


class Publisher(Protocol):
    """A wire that publishes."""

    async def publish_batch(self, topic: str, batch: Batch, definition: str | None, *, latch: bool) -> None:
        """Messages that a bridge stored. Raises BridgeError for what this wire cannot publish."""
        ...

    async def publish_text(self, topic: str, text: str, *, latch: bool) -> None:
        """A text (JSON)."""
        ...


class Listener:
    """Hands what is committed to a wire. ``prefix`` is that of the other bridges' definitions."""

    def __init__(
        self,
        ledger: Committed,
        outbox: Outbox,
        publisher: Publisher,
        choices: Sequence[Choice],
        *,
        prefix: str,
        from_start: bool = False,
    ) -> None:
        self._ledger = ledger
        self._outbox = outbox
        self._publisher = publisher
        self._choices = tuple(choices)
        self._prefix = prefix
        self._from_start = from_start
        self._definitions: dict[tuple[str, str, str], str | None] = {}
        self._unkept = 0
        self.placed: Final = asyncio.Event()
        """It is known from which block on nothing is missed."""
        self.handed_out = 0
        self.trouble = ""
        """Why no blocks come at present."""

    async def run(self) -> None:
        """Listen until cancelled. Raises BridgeError."""
        while True:
            try:
                start = await self._outbox.run(self._outbox.place)
                if start is None:
                    start = 0 if self._from_start else await self._ledger.height()
                    await self._outbox.run(self._outbox.keep_place, start, {})
                elif start > (height := await self._ledger.height()):
                    _log.warning(
                        "the ledger has %d blocks, and %d were read before: its peer is behind, or this is another "
                        "ledger (then give this bridge another spool)",
                        *(height, start),
                    )
                self.placed.set()
                async for block in self._ledger.committed(start):
                    self.trouble = ""
                    await self._take(block)
            except LedgerError as error:
                if str(error) != self.trouble:
                    _log.warning("the ledger's blocks stopped, asked again: %s", error)
                self.trouble = str(error)
            await asyncio.sleep(AGAIN_S)

    async def _take(self, block: CommittedBlock) -> None:
        seen: dict[str, int] = {}
        before = self.handed_out
        for event in block.events:
            for choice in self._choices:
                if choice.fits(event):
                    await self._hand_out(event, choice, seen)
        self._unkept += 1
        if self.handed_out != before or self._unkept >= KEEP_EVERY:
            await self._outbox.run(self._outbox.keep_place, block.number + 1, seen)
            self._unkept = 0

    async def _hand_out(self, event: CommittedEvent, choice: Choice, seen: dict[str, int]) -> None:
        try:
            if choice.give == "events":
                text = {"kind": event.name, "tx_id": event.tx_id, "t_ms": event.t_ms, "record": event.record}
                topic = choice.topic.replace("{event}", event.name).replace("{bridge}{topic}", event.name)
                await self._publisher.publish_text(topic, encoding.encode(text).decode(), latch=choice.latch)
                self.handed_out += 1
            elif event.asset is not None and event.asset.media_type == envelope.MEDIA_TYPE:
                await self._hand_out_messages(event.asset, choice, seen)
        except BridgeError as error:
            _log.error("transaction %s is not published: %s", event.tx_id, error)

    async def _hand_out_messages(self, asset: Asset, choice: Choice, seen: dict[str, int]) -> None:
        batch = envelope.parse(asset.value)
        if batch.type != asset.type:
            raise EnvelopeError(f"asset {asset.id} says type {asset.type} and holds {batch.type}")
        if (batch.bridge, batch.epoch) == (self._outbox.bridge, self._outbox.epoch):
            return  # our own: it would go round and round
        source = f"{asset.owner_msp}/{asset.owner}/{batch.bridge}/{batch.epoch}{batch.topic}>{choice.topic}"
        last = seen.get(source)
        if batch.batch <= (await self._outbox.run(self._outbox.last_seen, source) if last is None else last):
            return
        topic = choice.topic.replace("{bridge}", _as_name(batch.bridge)).replace("{topic}", batch.topic)
        definition = await self._definition(batch)
        await self._publisher.publish_batch(topic, batch, definition, latch=choice.latch)
        seen[source] = batch.batch
        self.handed_out += 1

    async def _definition(self, batch: Batch) -> str | None:
        """The type's definition as that bridge stored it; the wire checks that it has the hash that it should have."""
        key = (batch.bridge, batch.type, batch.type_hash)
        if key not in self._definitions:
            asset_id = envelope.definition_asset_id(self._prefix, *key)
            found = await self._ledger.read_asset(asset_id)
            if found is None:
                return None
            if len(self._definitions) >= 1_000:
                self._definitions.clear()
            self._definitions[key] = found.value
        return self._definitions[key]


def _one_of(patterns: Sequence[str], text: str) -> bool:
    return any(fnmatch.fnmatchcase(text, pattern) for pattern in patterns)


def _as_name(text: str) -> str:
    """As a part of a topic's name."""
    return "".join(letter if letter.isalnum() and letter.isascii() else "_" for letter in text)
