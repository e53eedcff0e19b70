"""Counting verdicts in the database; step times from the evidence of the newest sessions."""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, Final

import orjson
from sqlalchemy import JSON, ColumnElement, case, func, literal, select
from sqlalchemy.ext.asyncio import AsyncSession
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.visitors import InternalTraversal

from wonderland_backend.db.tables.ledger import DroneRow, EvidenceRow, SessionRow, VerdictRow
from wonderland_backend.narrowing import drones_of
from wonderland_backend.person import AUTHORITY, Person, Scope
from wonderland_backend.statistics.schemas import ERROR_EDGES_MM, LIKELIHOOD_BINS, StatisticsQuery

MAX_SESSIONS: Final = 20_000
"""Step times are those of at most so many sessions, the newest."""
HOUR_MS: Final = 3_600_000
STEPS: Final = ("request", "poll", "match", "reply", "range", "confirm", "verdict", "permission")
_OUTCOMES: Final = ("verified", "refuted", "inconclusive")

Row = dict[str, Any]


async def statistics(database: AsyncSession, wanted: StatisticsQuery, person: Person) -> Row:
    """The Statistics of a span, of what this person sees."""
    scope = person.scope
    total = (await _grouped(database, wanted, scope, literal("all")))[:1]
    bins = await _grouped(database, wanted, scope, _bin(wanted.bin_ms))
    hours = await _grouped(database, wanted, scope, _bin(HOUR_MS))
    operator = _field(DroneRow.record, "operator_id").as_string()
    theirs = case((DroneRow.msp_id == (person.msp_id if person.has("fleet_operator") else ""), operator))
    counts = total[0] if total else _none()
    count = sum(counts[name] for name in _OUTCOMES)
    span_h = (wanted.until_ms - wanted.since_ms) / HOUR_MS
    return {
        "total": {name: counts[name] for name in (*_OUTCOMES, "granted")},
        "bins": _filled(bins, wanted),
        "pads": await _groups(database, wanted, scope, VerdictRow.pad_id),
        # Whoever does not learn whose a drone is does not learn it from counts either.
        "operators": await _groups(database, wanted, scope, operator if person.has(*AUTHORITY) else theirs),
        "actions": await _groups(database, wanted, scope, VerdictRow.action),
        "likelihood": await _likelihood(database, wanted, scope),
        "error": await _error(database, wanted, scope),
        **await _step_times(database, wanted, scope),
        "proofs_per_hour": round(count / span_h, 3),
        "busiest_hour": max((sum(each[name] for name in _OUTCOMES) for each in hours), default=0),
    }


class _AsJson(ColumnElement[Any]):
    """A text column read as JSON: PostgreSQL wants a cast, which to SQLite would mean a number."""

    inherit_cache = True
    _traverse_internals = [("column", InternalTraversal.dp_clauseelement)]  # noqa: RUF012 - declared so by SQLAlchemy

    def __init__(self, column: Any) -> None:
        self.column = column
        self.type = JSON()


@compiles(_AsJson)
def _sqlite_json(element: _AsJson, compiler: Any, **options: Any) -> str:
    return str(compiler.process(element.column, **options))


@compiles(_AsJson, "postgresql")
def _postgresql_json(element: _AsJson, compiler: Any, **options: Any) -> str:
    return f"CAST({compiler.process(element.column, **options)} AS JSON)"


def _field(column: Any, *path: str) -> Any:
    """A field within a record's text."""
    return _AsJson(column)[path]


def _none() -> Row:
    return dict.fromkeys((*_OUTCOMES, "granted"), 0)


def _chosen(query: Any, wanted: StatisticsQuery, scope: Scope) -> Any:
    """The query, narrowed to what is asked for; drones are joined, so that an operator may be asked for."""
    query = query.outerjoin(DroneRow, DroneRow.uav_id == VerdictRow.uav_id).where(
        VerdictRow.decided_ms >= wanted.since_ms, VerdictRow.decided_ms < wanted.until_ms
    )
    query = scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    if wanted.pad is not None:
        query = query.where(VerdictRow.pad_id == wanted.pad)
    if wanted.action is not None:
        query = query.where(VerdictRow.action == wanted.action)
    if wanted.operator is not None:
        query = query.where(VerdictRow.uav_id.in_(drones_of(wanted.operator, scope)))
    return query


def _bin(width_ms: int) -> ColumnElement[Any]:
    return VerdictRow.decided_ms - VerdictRow.decided_ms % literal(width_ms)


async def _grouped(database: AsyncSession, wanted: StatisticsQuery, scope: Scope, key: ColumnElement[Any]) -> list[Row]:
    """Counts of each outcome by a key, in the key's order."""
    name = key.label("key")
    columns = [func.sum(case((VerdictRow.outcome == each, 1), else_=0)).label(each) for each in _OUTCOMES]
    granted = func.sum(case((VerdictRow.permission == "granted", 1), else_=0)).label("granted")
    query = (
        _chosen(select(name, *columns, granted).select_from(VerdictRow), wanted, scope).group_by(name).order_by(name)
    )
    return [
        {each: int(row[each]) for each in (*_OUTCOMES, "granted")} | {"key": row["key"]}
        for row in (await database.execute(query)).mappings()
        if row["key"] is not None
    ]


async def _groups(database: AsyncSession, wanted: StatisticsQuery, scope: Scope, key: Any) -> list[Row]:
    """The same with the key as `id`, the busiest first."""
    found = await _grouped(database, wanted, scope, key)
    shown = [{"id": str(each.pop("key")), **each} for each in found]
    return sorted(shown, key=lambda each: (-sum(each[name] for name in _OUTCOMES), each["id"]))


def _filled(bins: Iterable[Row], wanted: StatisticsQuery) -> list[Row]:
    """Bins without a verdict are bins, too."""
    known = {int(each["key"]): each for each in bins}
    first = wanted.since_ms - wanted.since_ms % wanted.bin_ms
    return [
        {"start_ms": start, **{name: known.get(start, _none())[name] for name in (*_OUTCOMES, "granted")}}
        for start in range(first, wanted.until_ms, wanted.bin_ms)
    ]


async def _likelihood(database: AsyncSession, wanted: StatisticsQuery, scope: Scope) -> list[int]:
    ppm = _field(VerdictRow.record, "signed", "likelihood_ppm").as_integer()
    place = (ppm * LIKELIHOOD_BINS // 1_000_000).label("place")
    query = _chosen(select(place, func.count()).select_from(VerdictRow), wanted, scope).where(ppm.is_not(None))
    counts = [0] * LIKELIHOOD_BINS
    for found, count in await database.execute(query.group_by(place)):
        counts[min(int(found), LIKELIHOOD_BINS - 1)] += count
    return counts


async def _error(database: AsyncSession, wanted: StatisticsQuery, scope: Scope) -> list[Row]:
    error_mm = _field(VerdictRow.record, "signed", "error_mm").as_integer()
    place = case(
        *((error_mm <= edge, index) for index, edge in enumerate(ERROR_EDGES_MM)), else_=len(ERROR_EDGES_MM)
    ).label("place")
    query = _chosen(select(place, func.count()).select_from(VerdictRow), wanted, scope).where(error_mm.is_not(None))
    counts = [0] * (len(ERROR_EDGES_MM) + 1)
    for found, count in await database.execute(query.group_by(place)):
        counts[int(found)] = count
    shown: list[Row] = [{"up_to_mm": edge, "count": counts[index]} for index, edge in enumerate(ERROR_EDGES_MM)]
    return [*shown, {"count": counts[-1]}]


async def _step_times(database: AsyncSession, wanted: StatisticsQuery, scope: Scope) -> Row:
    """The median and the 95th percentile of each step's time after the one before it: by bin, and of all the span."""
    query = _chosen(
        select(SessionRow.requested_ms, VerdictRow.decided_ms, EvidenceRow.steps).select_from(VerdictRow), wanted, scope
    )
    query = (
        query.join(SessionRow, SessionRow.session_id == VerdictRow.session_id)
        .join(EvidenceRow, EvidenceRow.session_id == VerdictRow.session_id)
        .order_by(VerdictRow.decided_ms.desc())
        .limit(MAX_SESSIONS)
    )
    times: dict[tuple[int, str], list[int]] = defaultdict(list)
    overall: dict[str, list[int]] = defaultdict(list)
    for requested_ms, decided_ms, steps in await database.execute(query):
        start = decided_ms - decided_ms % wanted.bin_ms
        for step, took_ms in step_times(requested_ms, decided_ms, orjson.loads(steps)):
            bisect.insort(times[start, step], took_ms)
            overall[step].append(took_ms)
    by_bin = sorted(times.items(), key=lambda each: (each[0][0], STEPS.index(each[0][1])))
    return {
        "steps": [{"start_ms": start, **_took(step, found)} for (start, step), found in by_bin],
        "step_totals": [_took(step, sorted(overall[step])) for step in STEPS if step in overall],
    }


def _took(step: str, found: Sequence[int]) -> Row:
    return {"step": step, "p50_ms": percentile(found, 50), "p95_ms": percentile(found, 95), "count": len(found)}


def step_times(requested_ms: int, decided_ms: int, steps: Sequence[Row]) -> list[tuple[str, int]]:
    """(step, milliseconds after the one before it) in the order of the proof. Clocks differ: never less than 0."""
    known = {each["step"]: each["t_ms"] for each in steps if each.get("step") in STEPS}
    known |= {"request": requested_ms, "verdict": decided_ms}
    found = []
    before: int | None = None
    for step in STEPS:
        t_ms = known.get(step)
        if t_ms is None:
            continue
        if before is not None:
            found.append((step, max(0, t_ms - before)))
        before = t_ms
    return found


def percentile(values: Sequence[int], percent: int) -> int:
    """Of sorted values, the smallest that is not below so many percent of them (nearest rank)."""
    return values[max(0, -(-len(values) * percent // 100) - 1)]
