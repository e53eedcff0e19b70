"""Reading the ledger's events after a place, for one pair of eyes."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Self

import orjson
from sqlalchemy import select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.problems import said
from wonderland_backend.context import part
from wonderland_backend.db.tables.ledger import Checkpoint, DroneRow, EventRow, PadRow, TransactionRow
from wonderland_backend.errors import BadRequest
from wonderland_backend.masking import is_drone, shown_uav
from wonderland_backend.person import Person

BATCH: Final = 200
PATTERN: Final = r"^\d{1,15}\.\d{1,9}$"
BAD_PLACE: Final = BadRequest(said("bad_event_id"))
_PLACE: Final = re.compile(PATTERN)


@dataclass(frozen=True, order=True, slots=True)
class Place:
    """A transaction's place on the ledger. As a cursor: what comes after it."""

    block: int
    tx_index: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """From ``block.index``. Raises `BadRequest`."""
        if _PLACE.fullmatch(text) is None:
            raise BadRequest(BAD_PLACE.said)
        block, _, index = text.partition(".")
        return cls(int(block), int(index))

    def __str__(self) -> str:
        return f"{self.block}.{self.tx_index}"


@dataclass(frozen=True)
class Filter:
    """What a list, stream or subscription of events is narrowed by. Empty: all."""

    types: frozenset[str] = field(default_factory=frozenset)
    pads: frozenset[str] = field(default_factory=frozenset)
    drones: frozenset[str] = field(default_factory=frozenset)
    outcomes: frozenset[str] = field(default_factory=frozenset)
    """Of `ProofDecided`; events of other types pass only without this."""

    def passes(self, kind: str, record: dict[str, Any]) -> bool:
        """Whether an event is wanted."""
        return (
            (not self.types or kind in self.types)
            and (not self.pads or record.get("pad_id") in self.pads)
            and (not self.drones or record.get("uav_id") in self.drones)
            and (not self.outcomes or record.get("outcome") in self.outcomes)
        )


@dataclass(frozen=True, slots=True)
class Event:
    """An event as others see it."""

    place: Place
    type: str
    t_ms: int
    tx_id: str
    record: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """As all interfaces show it."""
        return {
            "id": str(self.place),
            "type": self.type,
            "t_ms": self.t_ms,
            "tx_id": self.tx_id,
            "block": self.place.block,
            "tx_index": self.place.tx_index,
            "record": self.record,
        }


@dataclass(frozen=True, slots=True)
class Batch:
    """Events after a place, and how far was looked: nothing that is wanted lies between the last one and there."""

    events: list[Event]
    seen: Place
    more: bool
    """Whether there may be more at once."""


async def tip(database: AsyncSession) -> Place:
    """The end of what is mirrored: after it come only blocks that are not there yet."""
    block = await database.scalar(select(Checkpoint.block))
    return Place(block if block is not None else 0, 2**30)


async def read(database: AsyncSession, after: Place, wanted: Filter, person: Person, limit: int = BATCH) -> Batch:
    """The next events after a place that pass the filter and that this person may see, in the ledger's order."""
    query = (
        select(EventRow, TransactionRow.tx_id, TransactionRow.t_ms)
        .join(TransactionRow, (TransactionRow.block == EventRow.block) & (TransactionRow.tx_index == EventRow.tx_index))
        .where(tuple_(EventRow.block, EventRow.tx_index) > (after.block, after.tx_index))
        .order_by(EventRow.block, EventRow.tx_index)
        .limit(limit)
    )
    if wanted.types:
        query = query.where(EventRow.name.in_(wanted.types))
    rows = (await database.execute(query)).all()
    events = [_event(row, tx_id, t_ms) for row, tx_id, t_ms in rows]
    passing = [event for event in events if wanted.passes(event.type, event.record)]
    shown = [_masked(event, person) for event in await visible(database, passing, person)]
    seen = events[-1].place if events else after
    return Batch(shown, seen, len(rows) == limit)


def _event(row: EventRow, tx_id: str, t_ms: int) -> Event:
    record: Any = {}
    try:
        payload = orjson.loads(row.payload)
        record = payload.get("record", {}) if isinstance(payload, dict) else {}
    except ValueError:
        pass  # Another contract's event: its name and place are told, its payload stands in the block.
    return Event(Place(row.block, row.tx_index), row.name, t_ms, tx_id, record if isinstance(record, dict) else {})


async def visible(database: AsyncSession, events: Sequence[Event], person: Person) -> list[Event]:
    """Those whose pad or drone this person may see."""
    if person.scope.everything or not events:
        return list(events)
    pads = {str(event.record.get("pad_id", "")) for event in events}
    drones = {str(event.record.get("uav_id", "")) for event in events}
    of_pads = person.scope.narrow(select(PadRow.pad_id).where(PadRow.pad_id.in_(pads)), pad=PadRow.pad_id)
    of_drones = person.scope.narrow(select(DroneRow.uav_id).where(DroneRow.uav_id.in_(drones)), drone=DroneRow.uav_id)
    theirs_pads = set((await database.scalars(of_pads)).all())
    theirs_drones = set((await database.scalars(of_drones)).all())
    return [
        event
        for event in events
        if event.record.get("pad_id") in theirs_pads or event.record.get("uav_id") in theirs_drones
    ]


def _masked(event: Event, person: Person) -> Event:
    if not is_drone(event.record):
        return event
    record = orjson.loads(shown_uav(orjson.dumps(event.record).decode(), person))
    return Event(event.place, event.type, event.t_ms, event.tx_id, record)


class Commits:
    """Wakes those who wait for the next block, and tells them when the server stops."""

    def __init__(self) -> None:
        self._next = asyncio.Event()
        self.stopping = False

    def pulse(self) -> None:
        """Wake every stream: the mirror has committed something."""
        self._next.set()
        self._next = asyncio.Event()

    def stop(self) -> None:
        """End every stream, since the server stops."""
        self.stopping = True
        self.pulse()

    @property
    def upcoming(self) -> asyncio.Event:
        """Set by the next commit. Take it before you look, so that none slips by between looking and waiting."""
        return self._next


CommitsDep = Annotated[Commits, part(Commits)]


async def happens(upcoming: asyncio.Event, timeout_s: float) -> bool:
    """Wait for it; False when it did not come in time."""
    try:
        async with asyncio.timeout(timeout_s):
            await upcoming.wait()
    except TimeoutError:
        return False
    return True
