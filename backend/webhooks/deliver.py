"""The work of webhooks: making deliveries of events, and sending what is due until it arrives or is given up."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final

from sqlalchemy import select, tuple_, update
from sqlalchemy.ext.asyncio import AsyncSession

from backend.auth.person import Person, roles_of
from backend.clients.machines import person_of_client
from backend.clients.store import CLIENT
from backend.db.engine import Database
from backend.db.tables.clients import ClientRow
from backend.db.tables.people import PersonRow
from backend.db.tables.webhooks import DeliveryRow, SubscriptionRow
from backend.events import feed
from backend.events.feed import Commits, Place
from backend.webhooks import store
from backend.webhooks.post import Poster, Undelivered, retry_ms

logger = logging.getLogger(__name__)

EVERY_S: Final = 2.0
LEASE_MS: Final = 60_000
"""Another replica leaves a delivery alone for so long after one has begun it."""
GIVE_UP_MS: Final = 3 * 86_400_000
MAX_AT_ONCE: Final = 50
MAX_SUBSCRIPTIONS: Final = 5_000
TIDY_EVERY_MS: Final = 3_600_000


class Webhooks:
    """Runs beside the server. `make` and `send_due` once by themselves for tests."""

    def __init__(self, database: Database, poster: Poster, commits: Commits, clock: Callable[[], int]) -> None:
        self._database = database
        self._poster = poster
        self._commits = commits
        self._clock = clock
        self._tidied_ms = 0

    async def run(self) -> None:
        """Until cancelled."""
        while True:
            upcoming = self._commits.upcoming
            try:
                await self.make()
                await self.send_due()
                await self._tidy()
            except Exception:
                logger.exception("webhooks could not be worked at; trying again")
            await feed.happens(upcoming, EVERY_S)

    async def make(self) -> None:
        """Put down a delivery for every event that a subscription has not had yet."""
        async with self._database.read() as session:
            tip = await feed.tip(session)
            behind = (
                await session.scalars(
                    select(SubscriptionRow)
                    .where(
                        SubscriptionRow.state == store.ACTIVE,
                        tuple_(SubscriptionRow.block, SubscriptionRow.tx_index) < (tip.block, tip.tx_index),
                    )
                    .order_by(SubscriptionRow.block)
                    .limit(MAX_SUBSCRIPTIONS)
                )
            ).all()
        for row in behind:
            await self._catch_up(row, tip)

    async def _catch_up(self, row: SubscriptionRow, tip: Place) -> None:
        more = True
        while more:
            async with self._database.read() as session:
                owner = await owner_of(session, row)
                if owner is None:
                    return
                batch = await feed.read(session, Place(row.block, row.tx_index), store.filter_of(row), owner)
            more = batch.more
            # Where nothing is left, the end that was known before looking: nothing up to there was overlooked.
            to = batch.seen if more else max(batch.seen, tip)
            now = self._clock()
            rows = [
                store.new_delivery(row.subscription_id, str(event.place), event.type, event.to_json(), now)
                for event in batch.events
            ]
            async with self._database.write() as connection:
                if not await store.move(connection, row, to):
                    return
                await store.add_deliveries(connection, rows)
            row.block, row.tx_index = to.block, to.tx_index

    async def send_due(self) -> None:
        """Everything whose time has come, a bounded number at once."""
        query = (
            select(DeliveryRow, SubscriptionRow)
            .join(SubscriptionRow, SubscriptionRow.subscription_id == DeliveryRow.subscription_id)
            .where(DeliveryRow.next_ms <= self._clock(), SubscriptionRow.state == store.ACTIVE)
            .order_by(DeliveryRow.next_ms)
            .limit(MAX_AT_ONCE)
        )
        async with self._database.read() as session:
            due = (await session.execute(query)).all()
        await asyncio.gather(*(self._send(delivery, subscription) for delivery, subscription in due))

    async def _send(self, delivery: DeliveryRow, subscription: SubscriptionRow) -> None:
        if not await self._claim(delivery):
            return
        now = self._clock()
        attempts = delivery.attempts + 1
        values: dict[str, Any] = {"attempts": attempts, "next_ms": None, "delivered_ms": now, "problem": None}
        try:
            values["status"] = await self._poster.post(
                subscription.url, subscription.secret, delivery.delivery_id, now // 1000, delivery.body.encode()
            )
        except Undelivered as error:
            over = now - delivery.created_ms > GIVE_UP_MS
            values |= {
                "delivered_ms": None,
                "status": error.status,
                "problem": str(error)[:500],
                "next_ms": None if over else now + retry_ms(attempts),
            }
            logger.warning(
                "webhook %s of %s: %s; %s", delivery.delivery_id, subscription.subscription_id, error,
                "given up" if over else "trying again",
            )  # fmt: skip
        async with self._database.write() as connection:
            await connection.execute(_one(delivery).values(**values))

    async def _claim(self, delivery: DeliveryRow) -> bool:
        """Take it, unless another replica has."""
        async with self._database.write() as connection:
            taken = await connection.execute(
                _one(delivery).where(DeliveryRow.next_ms == delivery.next_ms).values(next_ms=self._clock() + LEASE_MS)
            )
        return bool(taken.rowcount)

    async def _tidy(self) -> None:
        now = self._clock()
        if now - self._tidied_ms > TIDY_EVERY_MS:
            self._tidied_ms = now
            async with self._database.write() as connection:
                await store.forget(connection, now - store.KEPT_MS)


async def owner_of(session: AsyncSession, subscription: SubscriptionRow) -> Person | None:
    """Whose subscription it is, with the rights of today; None for a revoked client or a suspended person."""
    owner = subscription.owner
    if owner.startswith(CLIENT):
        client = await session.get(ClientRow, owner)
        return person_of_client(client) if client is not None and client.revoked_ms is None else None
    row = await session.get(PersonRow, owner)
    if row is None or row.state != "active":
        return None
    return Person(row.person_id, row.name, roles_of(row.roles), row.msp_id, "", row.created_ms, 0, "")


def _one(delivery: DeliveryRow) -> Any:
    return update(DeliveryRow).where(DeliveryRow.delivery_id == delivery.delivery_id)
