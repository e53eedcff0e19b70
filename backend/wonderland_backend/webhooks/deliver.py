"""The work of webhooks: making deliveries of events, and sending what is due until it arrives or is given up."""

from __future__ import annotations

import asyncio
import functools
import logging
from collections.abc import Callable
from typing import Any, Final

from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.clients.machines import person_of_client
from wonderland_backend.clients.store import CLIENT, find_limited
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.db.tables.webhooks import DeliveryRow, SubscriptionRow
from wonderland_backend.events import queries as feed
from wonderland_backend.events.queries import Commits, Place
from wonderland_backend.person import Person, roles_of
from wonderland_backend.webhooks import store
from wonderland_backend.webhooks.post import Poster, Undelivered, retry_ms
from wonderland_backend.webhooks.sealing import SealError, Sealing

logger = logging.getLogger(__name__)

EVERY_S: Final = 2.0
LEASE_MS: Final = 60_000
"""Another replica leaves a delivery alone for so long after one has begun it."""
GIVE_UP_MS: Final = 3 * 86_400_000
AT_ONCE: Final = 4
"""Most that are on their way to one subscription."""
MAX_LANES: Final = 500
MAX_WAITING: Final = 1_000
"""With so many waiting for it, no more are put down for a subscription: later events are read later."""
PORTION: Final = 200
"""Events that are read for one subscription before it is another one's turn."""
MAX_SUBSCRIPTIONS: Final = 5_000
TIDY_EVERY_MS: Final = 3_600_000


class Webhooks:
    """Runs beside the server. `make` and `send_due` once by themselves for tests."""

    def __init__(
        self, database: Database, poster: Poster, sealing: Sealing, commits: Commits, clock: Callable[[], int]
    ) -> None:
        self._database = database
        self._poster = poster
        self._sealing = sealing
        self._commits = commits
        self._clock = clock
        self._tidied_ms = 0
        self._lanes: dict[str, asyncio.Task[None]] = {}
        """Who sends to a subscription just now: each has one of its own, so that none waits for another's receiver."""

    async def run(self) -> None:
        """Send what is due again and again, until cancelled."""
        try:
            while True:
                upcoming, more = self._commits.upcoming, False
                try:
                    more = await self.make()
                    await self._start_due()
                    await self._tidy()
                except Exception:
                    logger.exception("webhooks could not be worked at; trying again")
                await feed.happens(upcoming, 0 if more else EVERY_S)
        finally:
            await self._stop_lanes()

    async def make(self) -> bool:
        """Put down deliveries of the next events that each subscription has not had yet; whether there are more."""
        async with self._database.read() as session:
            tip = await feed.tip(session)
            behind = await store.behind(session, tip, MAX_SUBSCRIPTIONS)
            full = await store.with_waiting(session, MAX_WAITING) if behind else frozenset()
        return any([await self._catch_up(row, tip) for row in behind if row.subscription_id not in full])

    async def _catch_up(self, row: SubscriptionRow, tip: Place) -> bool:
        """One portion, so that a subscription to all of the past holds up no other one; whether there are more."""
        async with self._database.read() as session:
            owner = await owner_of(session, row)
            if owner is None:
                return False
            batch = await feed.read(session, Place(row.block, row.tx_index), store.filter_of(row), owner, PORTION)
        # Where nothing is left, the end that was known before looking: nothing up to there was overlooked.
        to = batch.seen if batch.more else max(batch.seen, tip)
        now = self._clock()
        rows = [
            store.new_delivery(row.subscription_id, str(event.place), event.type, event.to_json(), now)
            for event in batch.events
        ]
        async with self._database.write() as connection:
            if not await store.move(connection, row, to):
                return False
            await store.add_deliveries(connection, rows)
        return batch.more

    async def send_due(self) -> None:
        """Everything whose time has come."""
        await self._start_due()
        await asyncio.gather(*self._lanes.values())

    async def _start_due(self) -> None:
        """Begin to send to each subscription that something is due to, and that is not being sent to."""
        async with self._database.read() as session:
            found = await store.due_subscriptions(session, self._clock(), self._lanes, MAX_LANES - len(self._lanes))
        for subscription_id in found:
            lane = asyncio.create_task(self._send_all(subscription_id), name=f"webhooks of {subscription_id}")
            self._lanes[subscription_id] = lane
            lane.add_done_callback(functools.partial(self._end, subscription_id))

    def _end(self, subscription_id: str, _lane: asyncio.Task[None]) -> None:
        del self._lanes[subscription_id]

    async def _stop_lanes(self) -> None:
        lanes = list(self._lanes.values())
        for lane in lanes:
            lane.cancel()
        await asyncio.gather(*lanes, return_exceptions=True)

    async def _send_all(self, subscription_id: str) -> None:
        """What is due to one subscription, a few at a time, until one of them does not arrive."""
        arrived = True
        try:
            while arrived:
                async with self._database.read() as session:
                    due = await store.due_deliveries(session, subscription_id, self._clock(), AT_ONCE)
                sent = await asyncio.gather(*(self._send(delivery, subscription) for delivery, subscription in due))
                arrived = bool(sent) and all(sent)
        except Exception:
            logger.exception("webhooks of %s could not be sent; trying again", subscription_id)

    async def _send(self, delivery: DeliveryRow, subscription: SubscriptionRow) -> bool:
        """Send one delivery and write down how it went; whether it arrived."""
        if not await self._claim(delivery):
            return False
        now = self._clock()
        attempts = delivery.attempts + 1
        values: dict[str, Any] = {"attempts": attempts, "next_ms": None, "delivered_ms": now, "problem": None}
        try:
            secret = self._sealing.open(subscription.secret, subscription.subscription_id)
            values["status"] = await self._poster.post(
                subscription.url, secret, delivery.delivery_id, now // 1000, delivery.body.encode()
            )
        except (Undelivered, SealError) as error:
            over = now - delivery.created_ms > GIVE_UP_MS
            values |= {
                "delivered_ms": None,
                "status": error.status if isinstance(error, Undelivered) else None,
                "problem": str(error)[:500],
                "next_ms": None if over else now + retry_ms(attempts),
            }
            logger.warning(
                "webhook %s of %s: %s; %s", delivery.delivery_id, subscription.subscription_id, error,
                "given up" if over else "trying again",
            )  # fmt: skip
        async with self._database.write() as connection:
            await store.note_delivery(connection, delivery, values)
        return values["delivered_ms"] is not None

    async def _claim(self, delivery: DeliveryRow) -> bool:
        """Take it, unless another replica has."""
        async with self._database.write() as connection:
            return await store.claim_delivery(connection, delivery, self._clock() + LEASE_MS)

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
        client = await find_limited(session, owner)
        return person_of_client(client) if client is not None and client.revoked_ms is None else None
    row = await session.get(PersonRow, owner)
    if row is None or row.state != "active":
        return None
    return Person(row.person_id, row.name, roles_of(row.roles), row.msp_id, "", row.created_ms, 0, "")
