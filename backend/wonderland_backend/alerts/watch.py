"""Alerts that follow from watching: pads that fall silent or drift, a ledger that stops, certificates, permissions.

`conditions` says what is wrong now; the watch raises what is new, and ends what is no longer so. Only the backend
that mirrors watches, so that two never raise the same.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import Any, Final

import orjson

from wonderland_backend.agents.connected import Agents
from wonderland_backend.alerts import certificates, oddities, queries, store
from wonderland_backend.alerts.conditions import Condition
from wonderland_backend.alerts.deliver import enqueue
from wonderland_backend.context import Context
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.zones.differing import Differing

logger = logging.getLogger(__name__)

EVERY_S: Final = 5.0
SILENT_MS: Final = 60_000
"""Pads report every few seconds; a minute is more than a restart takes."""
AWAY_MS: Final = 30_000
CLOSURES_MS: Final = 3 * 86_400_000
"""So long before they run out the closures of a pad should be published anew."""


CONDITIONS: Final = (
    "pad_silent",
    "pad_drifting",
    "ledger_halted",
    "rows_differ",
    "ledger_away",
    "ledger_alone",
    "certificate_expiring",
    "closures_ending",
    "closures_differ",
    "identity_odd",
    "broadcast_odd",
    "broadcasts_flooded",
)


def pad_conditions(
    pads: Iterable[tuple[str, int, str]], connected: Callable[[str], bool], now_ms: int
) -> Iterable[Condition]:
    """`pads`: (pad_id, last health report's time, its body) of commissioned pads that have ever reported."""
    for pad_id, t_ms, body in pads:
        if now_ms - t_ms > SILENT_MS and not connected(pad_id):
            yield Condition("pad_silent", pad_id, t_ms, pad_id, {"since_ms": t_ms})
            continue
        drift = orjson.loads(body).get("drift")
        if isinstance(drift, dict) and drift.get("state", "ok") != "ok":
            yield Condition("pad_drifting", pad_id, t_ms, pad_id, _drift(drift))


def _drift(drift: dict[str, Any]) -> dict[str, Any]:
    """What a pad's health says of anchors that no longer measure as commissioned (`wonderland.telemetry.Drift`)."""
    anchor, off_mm, extra_mm = (drift.get(name) for name in ("anchor_id", "off_mm", "extra_sigma_mm"))
    state = "drifting"
    if drift["state"] == "moved" and anchor is not None and off_mm is not None:
        state = "moved"
    elif extra_mm:
        state = "widened"
    return {"state": state, "anchor_id": anchor or "all", "off_mm": off_mm or 0, "extra_sigma_mm": extra_mm or 0}


def ledger_conditions(mirror: MirrorStatus, now_ms: int) -> Iterable[Condition]:
    """The mirror halted, or not level for long because the ledger is away."""
    if mirror.halted is not None:
        yield Condition(
            "ledger_halted", mirror.channel, mirror.halted_since_ms or now_ms, None, {"why": mirror.halted[:500]}
        )
    elif not mirror.connected and mirror.lag_ms(now_ms) > AWAY_MS:
        state = "problem" if mirror.problem else "no_answer"
        facts = {"state": state, "why": (mirror.problem or "")[:500]}
        yield Condition("ledger_away", mirror.channel, now_ms - mirror.lag_ms(now_ms), None, facts)


def row_conditions(mirror: MirrorStatus, now_ms: int) -> Iterable[Condition]:
    """Somebody changed what this database says of the ledger."""
    for row in mirror.rows_differ:
        yield Condition("rows_differ", row, mirror.rows_checked_ms or now_ms, None, {"row": row})


def alone_conditions(mirror: MirrorStatus, now_ms: int) -> Iterable[Condition]:
    """No other organisation's peer has confirmed for long what this one's passes on."""
    since_ms = mirror.alone_since_ms
    if since_ms is not None and now_ms - since_ms > AWAY_MS:
        yield Condition("ledger_alone", mirror.channel, since_ms, None, {})


def closure_conditions(closures: Iterable[tuple[str, int]], now_ms: int) -> Iterable[Condition]:
    """`closures`: pads in service, and until when their closures by zones are published."""
    for pad_id, until_ms in closures:
        if until_ms - now_ms < CLOSURES_MS:
            yield Condition("closures_ending", f"{pad_id}/{until_ms}", now_ms, pad_id, {"until_ms": until_ms})


def differing_conditions(pads: Iterable[tuple[str, str]], now_ms: int) -> Iterable[Condition]:
    """`pads`: whose closures on the ledger are not what today's zones ask for, and how (`zones.pads`)."""
    for pad_id, state in pads:
        yield Condition("closures_differ", pad_id, now_ms, pad_id, {"state": state})


class Watch:
    """Looks every few seconds; `look` once by itself for tests."""

    def __init__(
        self, context: Context, mirror: MirrorStatus, agents: Agents, tell: Callable[[dict[str, Any]], None]
    ) -> None:
        self._context = context
        self._mirror = mirror
        self._agents = agents
        self._tell = tell
        self._differing = Differing()

    async def run(self) -> None:
        """Until cancelled. What goes wrong in one look is said, and the next look follows."""
        while True:
            await asyncio.sleep(EVERY_S)
            try:
                await self.look_once()
            except Exception:
                logger.exception("the watch for alerts failed; trying again")

    async def look_once(self) -> None:
        """Raise what is new, end what is over, and tell the live side."""
        now = self._context.clock()
        async with self._context.database.read() as session:
            pads = await queries.health_of_pads(session)
            closures = await queries.closures_of_pads(session)
            lasting = await queries.lasting(session, CONDITIONS)
            found = [
                *closure_conditions(closures, now),
                *pad_conditions(pads, self._agents.is_connected, now),
                *ledger_conditions(self._mirror, now),
                *alone_conditions(self._mirror, now),
                *row_conditions(self._mirror, now),
                *await certificates.conditions(session, self._agents, lasting, now),
                *differing_conditions(await self._differing.look_at_pads(session, now), now),
                *oddities.conditions(await queries.recent_oddities(session, now)),
            ]
            known = {(row.kind, row.source.rpartition("@")[0]): row.alert_id for row in lasting}
            kept_ms = int(self._context.settings.track_retention_h * 3_600_000)
            unmatched = await queries.unmatched_permissions(session, now, kept_ms)
        holds = {(each.kind, each.key) for each in found}
        new = [each.alert(now) for each in found if (each.kind, each.key) not in known]
        over = [alert_id for key, alert_id in known.items() if key not in holds]
        if not new and not over and not unmatched:
            return
        async with self._context.database.write() as connection:
            raised = await store.raise_all(connection, [*new, *unmatched], now)
            await enqueue(connection, self._context.settings, [*new, *unmatched], raised, now)
            ended = await store.end(connection, over, now)
        async with self._context.database.read() as session:
            for row in await store.by_ids(session, [*raised, *ended]):
                self._tell(store.alert_json(row))
