"""What alerts are found in: pads' health, closures, certificates, broadcasts, permissions that nothing followed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.alerts import store
from wonderland_backend.alerts.kinds import Alert
from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.db.tables.ledger import CertificateRow, ClosuresRow, PadRow, VerdictRow
from wonderland_backend.db.tables.reported import FindingRow, HealthRow, TrackRow
from wonderland_backend.db.tables.signing import SigningKeyRow

MATCH_AFTER_MS: Final = 60_000
"""A drone that got permission is heard within this, at a pad that hears drones at all."""
MATCH_BEFORE_MS: Final = 10_000
MATCH_LOOK_BACK_MS: Final = 15 * 60_000
HEARS_MS: Final = 10 * 60_000
LASTS_MS: Final = 10 * 60_000
"""So long what receivers found odd is so."""
_READ: Final = 2_000


class Odd(NamedTuple):
    """One kind of oddity of one drone at one pad, within the last minutes."""

    pad_id: str
    uav_id: str
    kind: str
    t_ms: int
    body: str


async def recent_oddities(database: AsyncSession, now_ms: int) -> list[Odd]:
    """The newest finding of each drone, pad and kind, in the order in which they began."""
    last = (
        select(func.max(FindingRow.id).label("id"), func.min(FindingRow.id).label("first"))
        .where(FindingRow.t_ms.between(now_ms - LASTS_MS, now_ms + LASTS_MS))
        .group_by(FindingRow.pad_id, FindingRow.uav_id, FindingRow.kind)
        .order_by(func.min(FindingRow.id))
        .limit(_READ)
        .subquery()
    )
    rows = await database.execute(
        select(FindingRow.pad_id, FindingRow.uav_id, FindingRow.kind, FindingRow.t_ms, FindingRow.body)
        .join(last, last.c.id == FindingRow.id)
        .order_by(last.c.first)
    )
    return [Odd(*row) for row in rows]


async def health_of_pads(session: AsyncSession) -> list[tuple[str, int, str]]:
    """Of commissioned pads that have ever reported: id, time and body of the last report."""
    rows = await session.execute(
        select(HealthRow.agent_id, HealthRow.t_ms, HealthRow.body)
        .join(PadRow, PadRow.pad_id == HealthRow.agent_id)
        .where(HealthRow.agent == "pad", PadRow.status == "commissioned")
    )
    return [(row[0], row[1], row[2]) for row in rows]


async def closures_of_pads(session: AsyncSession) -> list[tuple[str, int]]:
    """Pads in service, and until when (Unix, ms) their closures by zones are published."""
    rows = await session.execute(
        select(ClosuresRow.pad_id, ClosuresRow.valid_until_ms)
        .join(PadRow, PadRow.pad_id == ClosuresRow.pad_id)
        .where(PadRow.status != "retired")
    )
    return [(row[0], row[1]) for row in rows]


async def lasting(session: AsyncSession, kinds: Sequence[str]) -> Sequence[AlertRow]:
    """Alerts of these kinds that are not over."""
    query = select(AlertRow).where(AlertRow.state.in_(store.LASTING), AlertRow.kind.in_(kinds))
    return (await session.scalars(query)).all()


async def certificates_on_ledger(session: AsyncSession, which: ColumnElement[bool]) -> list[tuple[str, str, str, int]]:
    """Organisation, name, serial number (hexadecimal) and end (Unix, ms) of certificates seen on the chain."""
    columns = (CertificateRow.msp_id, CertificateRow.name, CertificateRow.serial, CertificateRow.not_after_ms)
    return [(row[0], row[1], row[2], row[3]) for row in await session.execute(select(*columns).where(which))]


async def keys_of_people(session: AsyncSession) -> list[tuple[str, str, str]]:
    """Organisation, name and certificate (PEM) of what people sign with, also before they first do."""
    columns = (SigningKeyRow.msp_id, SigningKeyRow.name, SigningKeyRow.certificate)
    rows = await session.execute(select(*columns).where(SigningKeyRow.ended_ms.is_(None)))
    return [(row[0], row[1], row[2]) for row in rows]


async def unmatched_permissions(session: AsyncSession, now: int, kept_ms: int) -> list[Alert]:
    """Permissions that no broadcast followed, at pads that hear broadcasts.

    ``kept_ms``: for how long broadcasts are kept. Of what is not kept any more, or was erased at a person's request,
    nobody can say that it was not heard.
    """
    first_ms = now - min(MATCH_LOOK_BACK_MS, kept_ms - MATCH_BEFORE_MS)
    erased = select(AuditRow.seq).where(
        AuditRow.act == "erase_personal_data",
        AuditRow.subject == "drone/" + VerdictRow.uav_id,
        AuditRow.t_ms >= VerdictRow.decided_ms - MATCH_BEFORE_MS,
    )
    granted = await session.scalars(
        select(VerdictRow).where(
            VerdictRow.permission == "granted",
            VerdictRow.decided_ms.between(first_ms, now - MATCH_AFTER_MS),
            ~erased.exists(),
        )
    )
    alerts = []
    for verdict in granted:
        heard = select(TrackRow.id).limit(1)
        of_drone = heard.where(
            TrackRow.uav_id == verdict.uav_id,
            TrackRow.t_ms.between(verdict.decided_ms - MATCH_BEFORE_MS, verdict.decided_ms + MATCH_AFTER_MS),
        )
        of_pad = heard.where(TrackRow.pad_id == verdict.pad_id, TrackRow.received_ms > verdict.decided_ms - HEARS_MS)
        if await session.scalar(of_drone) is None and await session.scalar(of_pad) is not None:
            place = {"pad_id": verdict.pad_id, "uav_id": verdict.uav_id, "session_id": verdict.session_id}
            facts = {"action": verdict.action}
            alerts.append(
                Alert(
                    "permission_unmatched", verdict.session_id, verdict.decided_ms, **place,
                    tx_id=verdict.tx_id, facts=facts,
                )
            )  # fmt: skip
    return alerts
