"""Telling people outside: e-mail and signed webhooks, tried again until they arrive or a day has passed.

Webhooks are those of `wonderland_backend.webhooks`: signed by the Standard Webhooks specification; `webhook-id` is the
alert's id.
"""

from __future__ import annotations

import asyncio
import logging
import smtplib
import ssl
from collections.abc import Callable, Sequence
from email.message import EmailMessage
from typing import Any, Final
from urllib.parse import urlsplit

import orjson
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland import messages
from wonderland_backend.alerts import store
from wonderland_backend.alerts.kinds import Alert, plain_text
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.alerts import AlertDeliveryRow, AlertRow
from wonderland_backend.settings import Settings
from wonderland_backend.webhooks.post import Poster, Undelivered, poster_of, retry_ms

logger = logging.getLogger(__name__)

EVERY_S: Final = 2.0
TIMEOUT_S: Final = 10.0
LEASE_MS: Final = 60_000
"""Another replica leaves a delivery alone for so long after one has begun it."""
GIVE_UP_MS: Final = 86_400_000
MAX_AT_ONCE: Final = 50
_RANK: Final = {"critical": 0, "warning": 1, "notice": 2}


async def enqueue(
    connection: AsyncConnection, settings: Settings, alerts: Sequence[Alert], raised: Sequence[str], now_ms: int
) -> None:
    """Put the new ones down for every target, in the same database transaction that raises them."""
    new = set(raised)
    least = _RANK[settings.alert_severity]
    rows = [
        {
            "alert_id": alert.alert_id,
            "target": target,
            "attempts": 0,
            "next_ms": now_ms,
            "delivered_ms": None,
            "problem": None,
        }
        for alert in alerts
        if alert.alert_id in new and _RANK[alert.severity] <= least
        for target in (*settings.alert_emails, *settings.alert_webhooks)
    ]
    if rows:
        await store.add_deliveries(connection, rows)


class Delivery:
    """Sends what is due."""

    def __init__(
        self, database: Database, settings: Settings, clock: Callable[[], int], poster: Poster | None = None
    ) -> None:
        self._database = database
        self._settings = settings
        self._clock = clock
        # Whoever writes a host into the settings allows it by name.
        self._poster = poster or poster_of(settings, (urlsplit(url).hostname or "" for url in settings.alert_webhooks))

    async def run(self) -> None:
        """Send what is due every two seconds, until cancelled."""
        try:
            while True:
                try:
                    await self.send_due()
                except Exception:
                    logger.exception("alerts could not be sent; trying again")
                await asyncio.sleep(EVERY_S)
        finally:
            await self._poster.close()

    async def send_due(self) -> None:
        """Everything whose time has come, a bounded number at once."""
        now = self._clock()
        async with self._database.read() as session:
            due = await store.due_deliveries(session, now, MAX_AT_ONCE)
        await asyncio.gather(*(self._send(delivery, alert) for delivery, alert in due))

    async def _send(self, delivery: AlertDeliveryRow, alert: AlertRow) -> None:
        if not await self._claim(delivery):
            return
        attempts = delivery.attempts + 1
        now = self._clock()
        values: dict[str, Any] = {"attempts": attempts, "next_ms": None, "delivered_ms": now, "problem": None}
        try:
            async with asyncio.timeout(3 * TIMEOUT_S):
                if delivery.target.startswith("mailto:"):
                    await asyncio.to_thread(self._mail, delivery.target.removeprefix("mailto:"), alert)
                else:
                    await self._post(delivery.target, alert)
        except (Undelivered, TimeoutError) as error:
            problem = str(error) or "it did not answer in time"
            over = now - alert.changed_ms > GIVE_UP_MS
            values |= {"delivered_ms": None, "problem": problem[:500], "next_ms": now + retry_ms(attempts)}
            if over:
                values["next_ms"] = None
            logger.warning(
                "alert %s to %s: %s; %s", alert.alert_id, _shown(delivery.target), problem,
                "given up" if over else "trying again",
            )  # fmt: skip
        async with self._database.write() as connection:
            await store.note_delivery(connection, delivery, values)

    async def _claim(self, delivery: AlertDeliveryRow) -> bool:
        """Take it, unless another replica has."""
        async with self._database.write() as connection:
            return await store.claim_delivery(connection, delivery, self._clock() + LEASE_MS)

    async def _post(self, url: str, alert: AlertRow) -> None:
        secret = self._settings.alert_webhook_secret
        assert secret is not None
        body = orjson.dumps({"type": "alert", "alert": store.alert_json(alert), "text": self._text(alert)})
        await self._poster.post(url, secret, alert.alert_id, self._clock() // 1000, body)

    def _text(self, alert: AlertRow) -> str:
        facts = orjson.loads(alert.facts)
        return plain_text(alert.kind, alert.pad_id, alert.uav_id, facts, self._settings.alert_language)

    def _mail(self, to: str, alert: AlertRow) -> None:
        settings = self._settings
        assert settings.smtp is not None
        server = urlsplit(settings.smtp)
        message = EmailMessage()
        text = self._text(alert)
        facts = {"severity": alert.severity, "text": text}
        subject = messages.text("emails", "alert_subject", facts, settings.alert_language)
        message["Subject"] = subject[:200].replace("\n", " ")
        message["From"] = settings.smtp_from or to
        message["To"] = to
        link = f"{settings.public_url.rstrip('/')}/#/alerts/{alert.alert_id}" if settings.public_url else ""
        message.set_content(f"{text}\n\n{link}\n".strip() + "\n")
        try:
            context = ssl.create_default_context()
            if server.scheme == "smtps":
                smtp: smtplib.SMTP = smtplib.SMTP_SSL(
                    server.hostname or "", server.port or 465, timeout=TIMEOUT_S, context=context
                )
            else:
                smtp = smtplib.SMTP(server.hostname or "", server.port or 25, timeout=TIMEOUT_S)
            with smtp:
                if server.scheme == "smtp+starttls":
                    smtp.starttls(context=context)
                if server.username and settings.smtp_password:
                    smtp.login(server.username, settings.smtp_password)
                smtp.send_message(message)
        except (OSError, smtplib.SMTPException) as error:
            raise Undelivered(f"{type(error).__name__}: {error}") from error


def _shown(target: str) -> str:
    """A target for the log: a webhook's path may be a secret."""
    parts = urlsplit(target)
    return f"{parts.scheme}://{parts.netloc}" if parts.netloc else target
