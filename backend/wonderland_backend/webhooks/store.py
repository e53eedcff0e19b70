"""Subscriptions and deliveries in the database."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from typing import Any, Final

import orjson
from sqlalchemy import Update, delete, func, insert, select, tuple_, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.db.tables.webhooks import DeliveryRow, SubscriptionRow
from wonderland_backend.events.queries import Filter, Place

ACTIVE: Final = "active"
PAUSED: Final = "paused"
KEPT_MS: Final = 14 * 86_400_000
"""Delivered or given up, a delivery can be looked at, and sent again, for so long."""

Row = dict[str, Any]


def filter_text(wanted: Filter) -> str:
    """A filter as it is kept."""
    parts = {"types": wanted.types, "pads": wanted.pads, "drones": wanted.drones, "outcomes": wanted.outcomes}
    return orjson.dumps({name: sorted(values) for name, values in parts.items() if values}).decode()


def filter_of(row: SubscriptionRow) -> Filter:
    """The filter of a subscription."""
    return Filter(**{name: frozenset(values) for name, values in orjson.loads(row.filter).items()})


def delivery_id(subscription_id: str, event_id: str) -> str:
    """The same on every replica, so that no event is delivered twice."""
    return hashlib.sha256(f"{subscription_id} {event_id}".encode()).hexdigest()[:32]


def new_delivery(subscription_id: str, event_id: str, kind: str, content: Row, now_ms: int) -> Row:
    """The row of a delivery that is due at once."""
    return {
        "delivery_id": delivery_id(subscription_id, event_id),
        "subscription_id": subscription_id,
        "event_id": event_id,
        "type": kind,
        "body": orjson.dumps(content).decode(),
        "created_ms": now_ms,
        "attempts": 0,
        "next_ms": now_ms,
        "delivered_ms": None,
        "status": None,
        "problem": None,
    }


async def add_deliveries(connection: AsyncConnection, rows: Sequence[Row]) -> None:
    """Put them down, but for those that are there already."""
    if rows:
        dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
        statement = dialect.insert(DeliveryRow).on_conflict_do_nothing(index_elements=["delivery_id"])
        await connection.execute(statement, list(rows))


async def with_waiting(database: AsyncSession, least: int) -> frozenset[str]:
    """Subscriptions that at least so many deliveries wait for."""
    query = (
        select(DeliveryRow.subscription_id)
        .where(DeliveryRow.next_ms.is_not(None))
        .group_by(DeliveryRow.subscription_id)
        .having(func.count() >= least)
    )
    return frozenset((await database.scalars(query)).all())


async def move(connection: AsyncConnection, row: SubscriptionRow, to: Place) -> bool:
    """Deliveries up to there are made; False where another replica was quicker."""
    done = await connection.execute(
        update(SubscriptionRow)
        .where(
            SubscriptionRow.subscription_id == row.subscription_id,
            SubscriptionRow.block == row.block,
            SubscriptionRow.tx_index == row.tx_index,
        )
        .values(block=to.block, tx_index=to.tx_index)
    )
    return bool(done.rowcount)


async def add(connection: AsyncConnection, row: Row) -> None:
    """Insert a subscription; its row says after which event it begins."""
    await connection.execute(insert(SubscriptionRow), [row])


async def set_state(connection: AsyncConnection, subscription_id: str, state: str) -> None:
    """Pause, or go on where it was."""
    one = SubscriptionRow.subscription_id == subscription_id
    await connection.execute(update(SubscriptionRow).where(one).values(state=state))


async def plain_secrets(connection: AsyncConnection) -> Sequence[tuple[str, str]]:
    """(subscription, secret) of those that are kept as they are, from before they were sealed."""
    query = select(SubscriptionRow.subscription_id, SubscriptionRow.secret)
    found = await connection.execute(query.where(SubscriptionRow.secret.not_like("sealed:%")).with_for_update())
    return [(row.subscription_id, row.secret) for row in found]


async def set_secret(connection: AsyncConnection, subscription_id: str, sealed: str) -> None:
    """Keep a secret sealed."""
    one = SubscriptionRow.subscription_id == subscription_id
    await connection.execute(update(SubscriptionRow).where(one).values(secret=sealed))


async def remove(connection: AsyncConnection, subscription_id: str) -> None:
    """The subscription and all of its deliveries."""
    await connection.execute(delete(DeliveryRow).where(DeliveryRow.subscription_id == subscription_id))
    await connection.execute(delete(SubscriptionRow).where(SubscriptionRow.subscription_id == subscription_id))


async def find_subscription(database: AsyncSession, subscription_id: str) -> SubscriptionRow | None:
    """The subscription; None where there is none of this id."""
    return await database.get(SubscriptionRow, subscription_id)


async def hold(connection: AsyncConnection, subscription_id: str) -> None:
    """Nobody else changes it until this transaction ends."""
    held = select(SubscriptionRow.subscription_id).where(SubscriptionRow.subscription_id == subscription_id)
    await connection.execute(held.with_for_update())


async def delivery(database: AsyncSession, delivery_id: str) -> DeliveryRow | None:
    """The delivery; None where there is none of this id, or it was forgotten."""
    return await database.get(DeliveryRow, delivery_id)


async def count_of(connection: AsyncConnection, owner: str) -> int:
    """How many somebody has."""
    query = select(func.count()).select_from(SubscriptionRow).where(SubscriptionRow.owner == owner)
    return int((await connection.execute(query)).scalar_one())


async def listing(
    database: AsyncSession, *, owner: str | None = None, after: str | None = None, limit: int
) -> Sequence[SubscriptionRow]:
    """Subscriptions by identifier; of one owner, or all."""
    query = select(SubscriptionRow).order_by(SubscriptionRow.subscription_id).limit(limit)
    if owner is not None:
        query = query.where(SubscriptionRow.owner == owner)
    if after is not None:
        query = query.where(SubscriptionRow.subscription_id > after)
    return (await database.scalars(query)).all()


async def deliveries(
    database: AsyncSession, subscription_id: str, *, state: str | None, before: tuple[int, str] | None, limit: int
) -> Sequence[DeliveryRow]:
    """Deliveries of a subscription, newest first; `state`: waiting, delivered or dead."""
    query = select(DeliveryRow).where(DeliveryRow.subscription_id == subscription_id)
    if state == "delivered":
        query = query.where(DeliveryRow.delivered_ms.is_not(None))
    elif state == "dead":
        query = query.where(DeliveryRow.delivered_ms.is_(None), DeliveryRow.next_ms.is_(None))
    elif state == "waiting":
        query = query.where(DeliveryRow.next_ms.is_not(None))
    if before is not None:
        query = query.where(tuple_(DeliveryRow.created_ms, DeliveryRow.delivery_id) < before)
    query = query.order_by(DeliveryRow.created_ms.desc(), DeliveryRow.delivery_id.desc()).limit(limit)
    return (await database.scalars(query)).all()


async def again(connection: AsyncConnection, delivery: str, now_ms: int) -> None:
    """Send it once more, whatever became of it."""
    await connection.execute(
        update(DeliveryRow)
        .where(DeliveryRow.delivery_id == delivery)
        .values(next_ms=now_ms, created_ms=now_ms, attempts=0, delivered_ms=None, problem=None)
    )


async def forget(connection: AsyncConnection, before_ms: int) -> None:
    """Drop deliveries that are over and older than this."""
    await connection.execute(
        delete(DeliveryRow).where(DeliveryRow.next_ms.is_(None), DeliveryRow.created_ms < before_ms)
    )


def subscription_json(row: SubscriptionRow) -> Row:
    """The subscription as the interface shows it: never its secret."""
    wanted = {"types": [], "pads": [], "drones": [], "outcomes": []} | orjson.loads(row.filter)
    return {
        "subscription_id": row.subscription_id,
        "owner": row.owner,
        "name": row.name,
        "url": row.url,
        **wanted,
        "state": row.state,
        "after": str(Place(row.block, row.tx_index)),
        "created_ms": row.created_ms,
    }


def delivery_json(row: DeliveryRow) -> Row:
    """The delivery as the interface shows it."""
    state = "delivered" if row.delivered_ms is not None else "dead" if row.next_ms is None else "waiting"
    content: Row = {
        "delivery_id": row.delivery_id,
        "event_id": row.event_id,
        "type": row.type,
        "state": state,
        "created_ms": row.created_ms,
        "attempts": row.attempts,
    }
    more = {name: getattr(row, name) for name in ("next_ms", "delivered_ms", "status", "problem")}
    return content | {name: value for name, value in more.items() if value is not None}


async def naming(session: AsyncSession, event_type: str) -> Sequence[SubscriptionRow]:
    """Active subscriptions that name this type of event, and a few that only hold its name: look at their filters."""
    query = select(SubscriptionRow).where(
        SubscriptionRow.state == ACTIVE, SubscriptionRow.filter.contains(event_type, autoescape=True)
    )
    return (await session.scalars(query)).all()


async def behind(session: AsyncSession, tip: Place, limit: int) -> Sequence[SubscriptionRow]:
    """Active subscriptions that have not had all events up to there; who waits longest, first."""
    query = (
        select(SubscriptionRow)
        .where(
            SubscriptionRow.state == ACTIVE,
            tuple_(SubscriptionRow.block, SubscriptionRow.tx_index) < (tip.block, tip.tx_index),
        )
        .order_by(SubscriptionRow.block)
        .limit(limit)
    )
    return (await session.scalars(query)).all()


async def due_subscriptions(session: AsyncSession, now_ms: int, but: Collection[str], limit: int) -> Sequence[str]:
    """Active subscriptions to which something is due, without these."""
    query = (
        select(DeliveryRow.subscription_id)
        .join(SubscriptionRow, SubscriptionRow.subscription_id == DeliveryRow.subscription_id)
        .where(
            DeliveryRow.next_ms <= now_ms,
            SubscriptionRow.state == ACTIVE,
            DeliveryRow.subscription_id.not_in(but),
        )
        .group_by(DeliveryRow.subscription_id)
        .order_by(func.min(DeliveryRow.next_ms))
        .limit(limit)
    )
    return (await session.scalars(query)).all()


async def due_deliveries(
    session: AsyncSession, subscription_id: str, now_ms: int, limit: int
) -> list[tuple[DeliveryRow, SubscriptionRow]]:
    """What is due to one subscription, while it is active."""
    rows = await session.execute(
        select(DeliveryRow, SubscriptionRow)
        .join(SubscriptionRow, SubscriptionRow.subscription_id == DeliveryRow.subscription_id)
        .where(
            DeliveryRow.subscription_id == subscription_id,
            SubscriptionRow.state == ACTIVE,
            DeliveryRow.next_ms <= now_ms,
        )
        .order_by(DeliveryRow.next_ms)
        .limit(limit)
    )
    return [(row[0], row[1]) for row in rows]


async def claim_delivery(connection: AsyncConnection, delivery: DeliveryRow, until_ms: int) -> bool:
    """Whether it is ours until then; False where another replica has taken it."""
    taken = await connection.execute(
        _one(delivery).where(DeliveryRow.next_ms == delivery.next_ms).values(next_ms=until_ms)
    )
    return taken.rowcount == 1


async def note_delivery(connection: AsyncConnection, delivery: DeliveryRow, values: dict[str, Any]) -> None:
    """Set columns of a delivery after an attempt: when it arrived, or what went wrong and when it is tried again."""
    await connection.execute(_one(delivery).values(**values))


def _one(delivery: DeliveryRow) -> Update:
    return update(DeliveryRow).where(DeliveryRow.delivery_id == delivery.delivery_id)
