"""Trying a webhook: one signed event by which nothing has happened, and what the receiver made of it."""

from __future__ import annotations

from typing import Any, Final

import orjson

from wonderland_backend.context import Context
from wonderland_backend.db.tables.webhooks import SubscriptionRow
from wonderland_backend.webhooks import signing
from wonderland_backend.webhooks.post import Poster, Undelivered
from wonderland_backend.webhooks.sealing import SealError, Sealing

TYPE: Final = "webhook.test"


async def try_out(context: Context, poster: Poster, sealing: Sealing, row: SubscriptionRow) -> dict[str, Any]:
    """Send it, once; returns the WebhookTest of the interface."""
    message_id, now_ms = context.randomness(16).hex(), context.clock()
    record = {"subscription_id": row.subscription_id}
    body = orjson.dumps({"id": message_id, "type": TYPE, "t_ms": now_ms, "record": record})
    told: dict[str, Any] = {"arrived": False, "took_ms": 0, "url": row.url, "body": body.decode()}
    try:
        secret = sealing.open(row.secret, row.subscription_id)
        told["headers"] = signing.headers(secret, message_id, now_ms // 1000, body)
        told["status"] = await poster.post(row.url, secret, message_id, now_ms // 1000, body)
        told["arrived"] = True
    except SealError as error:
        told["problem"] = str(error)
    except Undelivered as error:
        told["problem"] = str(error)[:500]
        if error.status is not None:
            told["status"] = error.status
    return told | {"took_ms": max(0, context.clock() - now_ms)}
