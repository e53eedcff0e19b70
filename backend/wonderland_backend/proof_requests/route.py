"""Bringing a request to the drone: to its agent where that is connected and takes requests, and to subscribers."""

from __future__ import annotations

from typing import Any, Final, cast

from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.telemetry import Action, Answer, PleaseProve
from wonderland_backend.agents.connected import UAV, Agent, Agents
from wonderland_backend.context import Context
from wonderland_backend.events.queries import Event, Place, visible
from wonderland_backend.proof_requests import store
from wonderland_backend.webhooks import store as webhooks
from wonderland_backend.webhooks.deliver import owner_of

CREATED: Final = "proof_request.created"
"""Not of the ledger, so never part of a stream: only subscriptions that name it get it."""
_PUBLIC: Final = ("request_id", "uav_id", "pad_id", "action", "note", "created_ms", "expires_ms")


async def tell_agent(context: Context, agents: Agents, uav_id: str, *, again: bool = False) -> None:
    """Send the drone's agent what it has not been told yet; `again`: and what it has not answered."""
    agent = agents.find_agent(UAV, uav_id)
    if agent is None or agent.outbox is None:
        return
    now = context.clock()
    async with context.database.read() as database:
        waiting = await store.unanswered(database, uav_id, now)
    for row in waiting:
        if row.told_ms is not None and not again:
            continue
        if agent.outbox.full():
            return  # It reads nothing; what it has not answered is sent again when it comes back.
        agent.outbox.put_nowait(
            PleaseProve(
                request_id=row.request_id,
                pad_id=row.pad_id,
                action=cast("Action", row.action),  # checked when the row was written
                expires_ms=row.expires_ms,
            )
        )
        async with context.database.write() as connection:
            await store.change(connection, row.request_id, uav_id, told_ms=now)


async def answered(context: Context, agent: Agent, answer: Answer) -> None:
    """The drone's agent says whether it will."""
    async with context.database.write() as connection:
        values = {"accepted": answer.accepted, "answer": answer.text or None}
        await store.change(connection, answer.request_id, agent.id, **values)


async def deliveries_of(database: AsyncSession, row: dict[str, Any], now_ms: int) -> list[dict[str, Any]]:
    """A delivery for each active subscription that names this type, and whose owner may see the drone or the pad."""
    record = {name: row[name] for name in _PUBLIC}
    event = Event(Place(0, 0), CREATED, row["created_ms"], "", record)
    content = {"id": row["request_id"], "type": CREATED, "t_ms": row["created_ms"], "record": record}
    found = []
    for subscription in await webhooks.naming(database, CREATED):
        wanted = webhooks.filter_of(subscription)
        owner = await owner_of(database, subscription)
        if CREATED not in wanted.types or not wanted.passes(CREATED, record) or owner is None:
            continue
        if await visible(database, [event], owner):
            found.append(
                webhooks.new_delivery(subscription.subscription_id, row["request_id"], CREATED, content, now_ms)
            )
    return found
