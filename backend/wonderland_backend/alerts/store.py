"""Alerts in the database: raised once, acted upon one after the other, ended when their cause ends."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import orjson
from sqlalchemy import ColumnElement, Update, and_, case, func, insert, or_, select, tuple_, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.alerts.kinds import Alert
from wonderland_backend.alerts.schemas import Act, AlertQuery
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.alerts import AlertActRow, AlertDeliveryRow, AlertRow
from wonderland_backend.errors import Conflict, NotFound
from wonderland_backend.narrowing import narrowed
from wonderland_backend.person import Person, Scope

OPEN: Final = "open"
ACKNOWLEDGED: Final = "acknowledged"
RETURNED: Final = "returned"
"""Its cause ended by itself before anybody had acknowledged it; it stays until somebody does."""
OVER: Final = "over"
WAITING: Final = (OPEN, RETURNED)
"""These want somebody; what is asleep does so later."""
LASTING: Final = (OPEN, ACKNOWLEDGED)
"""Their cause goes on."""
MAX_OPEN: Final = 500
"""Open alerts that a snapshot holds; REST has the rest."""

Row = dict[str, Any]


def row_of(alert: Alert, now_ms: int) -> Row:
    """An alert as it is written when it is raised: open, with nobody assigned."""
    return {
        "alert_id": alert.alert_id,
        "kind": alert.kind,
        "severity": alert.severity,
        "source": alert.source,
        "t_ms": alert.t_ms,
        "raised_ms": now_ms,
        "pad_id": alert.pad_id,
        "uav_id": alert.uav_id,
        "session_id": alert.session_id,
        "tx_id": alert.tx_id,
        "facts": orjson.dumps(dict(alert.facts)).decode(),
        "state": OPEN,
        "revision": 0,
        "changed_ms": now_ms,
        "acknowledged_by": None,
        "assigned_to": None,
        "snoozed_until_ms": None,
        "over_ms": None,
    }


async def raise_all(connection: AsyncConnection, alerts: Iterable[Alert], now_ms: int) -> list[str]:
    """Insert those that are not there yet. Returns the ids of the new ones, in order."""
    rows = {alert.alert_id: row_of(alert, now_ms) for alert in alerts}
    if not rows:
        return []
    known = set(
        (await connection.execute(select(AlertRow.alert_id).where(AlertRow.alert_id.in_(list(rows))))).scalars()
    )
    new = [alert_id for alert_id in rows if alert_id not in known]
    if new:
        dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
        statement = dialect.insert(AlertRow).on_conflict_do_nothing(index_elements=["alert_id"])
        await connection.execute(statement, [rows[alert_id] for alert_id in new])
    return new


async def end(connection: AsyncConnection, alert_ids: Sequence[str], now_ms: int) -> list[str]:
    """The cause of these has ended by itself. Returns the ids of those whose cause went on until now.

    What was more than a notice and nobody has acknowledged stays visible (ISA-18.2: returned, unacknowledged).
    """
    unseen = and_(AlertRow.state == OPEN, AlertRow.severity != "notice")
    ended = []
    for alert_id in alert_ids:
        done = await connection.execute(
            update(AlertRow)
            .where(AlertRow.alert_id == alert_id, AlertRow.state.in_(LASTING))
            .values(
                state=case((unseen, RETURNED), else_=OVER),
                over_ms=now_ms,
                changed_ms=now_ms,
                revision=AlertRow.revision + 1,
            )
        )
        if done.rowcount:
            ended.append(alert_id)
    return ended


async def find_alert(database: AsyncSession, scope: Scope, alert_id: str) -> AlertRow:
    """One alert. Raises `NotFound`."""
    query = scope.narrow(
        select(AlertRow).where(AlertRow.alert_id == alert_id), pad=AlertRow.pad_id, drone=AlertRow.uav_id
    )
    row = (await database.scalars(query)).first()
    if row is None:
        raise NotFound(said("no_such_alert"))
    assert isinstance(row, AlertRow)
    return row


async def act(database: Database, alert_id: str, who: Person, wanted: Act, now_ms: int) -> AlertRow:
    """Do it, if nobody has done something else since. Raises `NotFound`, `Conflict`."""
    by = who.name
    values: Row = {"changed_ms": now_ms, "revision": wanted.revision + 1}
    detail: str | None = None
    match wanted.act:
        case "acknowledge":
            ended = AlertRow.state.in_((RETURNED, OVER))
            values |= {
                "state": case((ended, OVER), else_=ACKNOWLEDGED),
                "acknowledged_by": by,
                "snoozed_until_ms": None,
            }
        case "reopen":
            values |= {"state": OPEN, "acknowledged_by": None, "snoozed_until_ms": None}
        case "assign":
            detail = wanted.assignee or by
            values |= {"assigned_to": detail}
        case "snooze":
            detail = str(wanted.until_ms)
            values |= {"snoozed_until_ms": wanted.until_ms}
        case "note":
            pass
    async with database.write() as connection:
        done = await connection.execute(
            update(AlertRow).where(AlertRow.alert_id == alert_id, AlertRow.revision == wanted.revision).values(**values)
        )
        if done.rowcount != 1:
            raise Conflict(said("alert_changed"))
        row = {
            "alert_id": alert_id,
            "revision": wanted.revision + 1,
            "t_ms": now_ms,
            "person": by,
            "act": wanted.act,
            "detail": detail,
            "note": wanted.note,
        }
        await connection.execute(insert(AlertActRow), [row])
        told = {name: row[name] for name in ("detail", "note") if row[name] is not None}
        await audit.record(connection, who, wanted.act, f"alert/{alert_id}", told, t_ms=now_ms)
    async with database.read() as session:
        found = await session.get(AlertRow, alert_id)
    assert found is not None
    return found


def alert_json(row: AlertRow) -> Row:
    """The Alert of a row."""
    content: Row = {
        "alert_id": row.alert_id,
        "kind": row.kind,
        "severity": row.severity,
        "t_ms": row.t_ms,
        "facts": orjson.loads(row.facts),
        "state": row.state,
        "revision": row.revision,
        "changed_ms": row.changed_ms,
    }
    for name in (
        "pad_id", "uav_id", "session_id", "tx_id", "acknowledged_by", "assigned_to", "snoozed_until_ms", "over_ms",
    ):  # fmt: skip
        value = getattr(row, name)
        if value is not None:
            content[name] = value
    return content


async def by_ids(database: AsyncSession, alert_ids: Sequence[str]) -> list[AlertRow]:
    """These alerts, oldest first."""
    query = select(AlertRow).where(AlertRow.alert_id.in_(alert_ids)).order_by(AlertRow.t_ms, AlertRow.alert_id)
    return list((await database.scalars(query)).all())


async def acts_of(database: AsyncSession, alert_id: str) -> list[Row]:
    """What was done about an alert, in order."""
    query = select(AlertActRow).where(AlertActRow.alert_id == alert_id).order_by(AlertActRow.revision)
    found = []
    for each in await database.scalars(query):
        shown_act: Row = {"t_ms": each.t_ms, "person": each.person, "act": each.act}
        if each.detail is not None:
            shown_act["detail"] = each.detail
        if each.note is not None:
            shown_act["note"] = each.note
        found.append(shown_act)
    return found


async def deliveries_of(database: AsyncSession, alert_id: str) -> Sequence[AlertDeliveryRow]:
    """Who is told of it, and how far that is."""
    query = select(AlertDeliveryRow).where(AlertDeliveryRow.alert_id == alert_id).order_by(AlertDeliveryRow.target)
    return (await database.scalars(query)).all()


async def current(database: AsyncSession) -> list[AlertRow]:
    """The newest of those that want somebody, oldest first."""
    query = select(AlertRow).where(AlertRow.state.in_(WAITING)).order_by(AlertRow.t_ms.desc()).limit(MAX_OPEN)
    return list(reversed((await database.scalars(query)).all()))


def _in_inbox(now_ms: int) -> ColumnElement[bool]:
    awake = or_(AlertRow.snoozed_until_ms.is_(None), AlertRow.snoozed_until_ms <= now_ms)
    return and_(AlertRow.state.in_(WAITING), awake)


async def inbox_size(database: AsyncSession, scope: Scope, now_ms: int) -> int:
    """How many wait for somebody."""
    query = select(func.count()).select_from(AlertRow).where(_in_inbox(now_ms))
    query = scope.narrow(query, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    return int((await database.execute(query)).scalar_one())


async def listing(
    database: AsyncSession, filters: AlertQuery, scope: Scope, *, position: tuple[int, str] | None, now_ms: int
) -> Sequence[AlertRow]:
    """Alerts, newest first, one more than `filters.limit`. Raises `BadRequest` as `narrowed` does."""
    query = select(AlertRow).order_by(AlertRow.t_ms.desc(), AlertRow.alert_id.desc()).limit(filters.limit + 1)
    query = scope.narrow(query, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    if position is not None:
        query = query.where(tuple_(AlertRow.t_ms, AlertRow.alert_id) < position)
    query = await narrowed(database, query, filters, scope, pad=AlertRow.pad_id, drone=AlertRow.uav_id)
    asleep = and_(AlertRow.snoozed_until_ms.is_not(None), AlertRow.snoozed_until_ms > now_ms)
    if filters.state == "inbox":
        query = query.where(_in_inbox(now_ms))
    elif filters.state == "snoozed":
        query = query.where(AlertRow.state.in_(WAITING), asleep)
    elif filters.state is not None:
        query = query.where(AlertRow.state == filters.state)
    for column, value in (
        (AlertRow.kind, filters.kind),
        (AlertRow.severity, filters.severity),
        (AlertRow.session_id, filters.session),
    ):
        if value is not None:
            query = query.where(column == value)
    if filters.since_ms is not None:
        query = query.where(AlertRow.t_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(AlertRow.t_ms <= filters.until_ms)
    return (await database.scalars(query)).all()


async def end_old(connection: AsyncConnection, alert_ids: Sequence[str], before_ms: int, now_ms: int) -> None:
    """What began before that is history: over as soon as it is known."""
    await connection.execute(
        update(AlertRow)
        .where(AlertRow.alert_id.in_(alert_ids), AlertRow.t_ms < before_ms)
        .values(state=OVER, over_ms=now_ms)
    )


async def add_deliveries(connection: AsyncConnection, rows: list[dict[str, Any]]) -> None:
    """Alerts to be told, each to one target."""
    await connection.execute(insert(AlertDeliveryRow), rows)


async def due_deliveries(session: AsyncSession, now_ms: int, limit: int) -> list[tuple[AlertDeliveryRow, AlertRow]]:
    """Those whose time has come, and what they tell."""
    rows = await session.execute(
        select(AlertDeliveryRow, AlertRow)
        .join(AlertRow, AlertRow.alert_id == AlertDeliveryRow.alert_id)
        .where(AlertDeliveryRow.next_ms <= now_ms)
        .order_by(AlertDeliveryRow.next_ms)
        .limit(limit)
    )
    return [(row[0], row[1]) for row in rows]


async def claim_delivery(connection: AsyncConnection, delivery: AlertDeliveryRow, until_ms: int) -> bool:
    """Whether it is ours until then; False where another replica has taken it."""
    taken = await connection.execute(
        _one(delivery).where(AlertDeliveryRow.next_ms == delivery.next_ms).values(next_ms=until_ms)
    )
    return taken.rowcount == 1


async def note_delivery(connection: AsyncConnection, delivery: AlertDeliveryRow, values: dict[str, Any]) -> None:
    """Set columns of a delivery after an attempt: when it arrived, or what went wrong and when it is tried again."""
    await connection.execute(_one(delivery).values(**values))


def _one(delivery: AlertDeliveryRow) -> Update:
    return update(AlertDeliveryRow).where(
        AlertDeliveryRow.alert_id == delivery.alert_id, AlertDeliveryRow.target == delivery.target
    )
