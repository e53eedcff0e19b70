"""Alerts of a running backend: raised with the mirror's commits, watched for, told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.alerts import store
from wonderland_backend.alerts.deliver import enqueue
from wonderland_backend.alerts.derive import alerts_of, landings_of
from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.subscriber import Subscriber
from wonderland_backend.settings import Settings

STALE_MS: Final = 7 * 86_400_000
"""A ledger that is mirrored anew brings its whole past: what is older than this is history, not news."""
TOLD_MS: Final = 3_600_000
"""Nobody outside is told of what happened longer ago."""


class Alerts(Subscriber[list[dict[str, Any]]]):
    """What follows from the ledger, in the mirror's own database transaction; the live side hears of it after."""

    def __init__(self, settings: Settings, tell: Callable[[dict[str, Any]], None], clock: Callable[[], int]) -> None:
        self._settings = settings
        self._tell = tell
        self._clock = clock

    async def in_transaction(self, connection: AsyncConnection, changes: Changes) -> list[dict[str, Any]]:
        """Raise what these changes call for: the alerts that are new, and news, as they are shown."""
        alerts = [*alerts_of(changes.verdict_writes), *landings_of(changes.landings)]
        if not alerts:
            return []
        now = self._clock()
        raised = await store.raise_all(connection, alerts, now)
        if not raised:
            return []
        await store.end_old(connection, raised, now - STALE_MS, now)
        fresh = [alert for alert in alerts if alert.t_ms > now - TOLD_MS]
        await enqueue(connection, self._settings, fresh, raised, now)
        new = set(raised)
        return [
            store.alert_json(AlertRow(**store.row_of(alert, now)))
            for alert in alerts
            if alert.alert_id in new and alert.t_ms >= now - STALE_MS
        ]

    def after_commit(self, changes: Changes, found: list[dict[str, Any]]) -> None:  # noqa: ARG002
        """Tell the live side."""
        for alert in found:
            self._tell(alert)
