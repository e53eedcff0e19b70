"""What a board begins with: the present as the database has it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.records.reservations import Reservations
from wonderland.proofs.records.sessions import Session
from wonderland_backend.alerts import store as alerts
from wonderland_backend.db.tables.ledger import DroneRow, PadRow, SessionRow, VerdictRow
from wonderland_backend.db.tables.reported import HealthRow, LatestTrackRow
from wonderland_backend.filters import SessionQuery, VerdictQuery
from wonderland_backend.pads import queries as pads
from wonderland_backend.sessions import queries as sessions
from wonderland_backend.sessions.state import SessionView
from wonderland_backend.verdicts import queries as verdicts

LAST_VERDICTS: Final = 200
RECENT_SESSIONS: Final = 500
MAX_TRACKS: Final = 20_000


@dataclass
class Contents:
    """What a board shows. Lists are oldest first; texts are JSON."""

    pads: list[tuple[str, str, str, str | None]] = field(default_factory=list)
    """Pad's id, whose it is, its record, its agent's last health report."""
    drones: set[str] = field(default_factory=set)
    owners: dict[str, str] = field(default_factory=dict)
    """Whose a drone is, where the board is asked."""
    tracks: list[tuple[str, int, str]] = field(default_factory=list)
    """Drone, time (ms), the Track."""
    sessions: list[SessionView] = field(default_factory=list)
    estimates: list[tuple[str, str, str]] = field(default_factory=list)
    """Drone, session, the Estimate."""
    verdicts: list[Any] = field(default_factory=list)
    alerts: list[dict[str, Any]] = field(default_factory=list)
    queueing: tuple[list[Session], frozenset[str]] = ([], frozenset())
    """What pads' queues depend on: sessions in the order of their requests, and the ids of those that are permitted."""
    reservations: dict[str, Reservations] = field(default_factory=dict)
    """By pad."""
    counts: dict[str, int] = field(default_factory=dict)
    """Of sessions, and of verdicts by outcome."""


async def contents_now(database: AsyncSession, now_ms: int) -> Contents:
    """What a client is shown first: pads, drones, sessions under way, the newest verdicts and alerts."""
    found = Contents()
    health = {row.agent_id: row.body for row in await database.scalars(select(HealthRow)) if row.agent == "pad"}
    for pad in await database.scalars(select(PadRow)):
        found.pads.append((pad.pad_id, pad.msp_id, pad.record, health.get(pad.pad_id)))
    drones = await database.execute(select(DroneRow.uav_id, DroneRow.msp_id))
    found.owners = {uav_id: msp_id for uav_id, msp_id in drones}  # noqa: C416 - rows are no pairs
    found.drones = set(found.owners)
    recent = select(LatestTrackRow).order_by(LatestTrackRow.t_ms.desc()).limit(MAX_TRACKS)
    for track in reversed((await database.scalars(recent)).all()):
        found.tracks.append((track.uav_id, track.t_ms, track.body))
    found.sessions = await sessions.listing(database, SessionQuery(limit=RECENT_SESSIONS))
    found.sessions.reverse()
    newest = await verdicts.listing(database, VerdictQuery(limit=LAST_VERDICTS))
    found.verdicts = [verdicts.verdict_json(row) for row in reversed(newest)]
    found.alerts = [alerts.alert_json(row) for row in await alerts.current(database)]
    found.queueing = await pads.queueing(database, now_ms)
    found.reservations = await pads.reservations(database)
    found.counts["sessions"] = (await database.execute(select(func.count()).select_from(SessionRow))).scalar_one()
    outcomes = select(VerdictRow.outcome, func.count()).group_by(VerdictRow.outcome)
    for outcome, count in await database.execute(outcomes):
        found.counts[outcome] = count
    return found
