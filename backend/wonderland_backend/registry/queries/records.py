"""Reading the registry from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import orjson
from sqlalchemy import JSON, ColumnElement, and_, cast, func, or_, select, tuple_, type_coerce
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.records import keys
from wonderland.proofs.records.policies import Policy
from wonderland_backend.db.tables.ledger import (
    AuthorisationRow,
    DroneRow,
    PadRow,
    PolicyRow,
    RecordVersionRow,
    TransactionRow,
)
from wonderland_backend.masking import shown_uav
from wonderland_backend.numbers.store import Number
from wonderland_backend.person import Person
from wonderland_backend.registry.schemas import DroneQuery, PadQuery
from wonderland_backend.responses import record

Place = tuple[Any, ...] | None
ACTIONS: Final = ("*", "land", "takeoff", "dock")
_KINDS: Final = {
    keys.UAV: "drone",
    keys.PAD: "pad",
    keys.AUTHORISATION: "authorisation",
    keys.POLICY: "policy",
    keys.CLOSURES: "closures",
}


def version(row: DroneRow | PadRow | AuthorisationRow | PolicyRow) -> dict[str, int]:
    """The Version of a row."""
    return {"block": row.block, "tx_index": row.tx_index}


async def drones(database: AsyncSession, person: Person, filters: DroneQuery, place: Place) -> Sequence[DroneRow]:
    """Drones that fit; one more than asked for where there are more."""
    query = person.scope.narrow(select(DroneRow), drone=DroneRow.uav_id)
    if filters.q is not None:
        named = [_contains(_field(database, DroneRow.record, "model"), filters.q)]
        if person.has("admin", "inspector") or not person.scope.everything:
            named.append(_contains(_field(database, DroneRow.record, "operator_id"), filters.q))
        query = query.where(or_(_contains(DroneRow.uav_id, filters.q), *named))
    query = _filtered(query, DroneRow, DroneRow.uav_id, filters, place)
    return (await database.scalars(query)).all()


async def pads(database: AsyncSession, person: Person, filters: PadQuery, place: Place) -> Sequence[PadRow]:
    """Pads that fit, likewise."""
    query = person.scope.narrow(select(PadRow), pad=PadRow.pad_id)
    if filters.q is not None:
        names = [_contains(_field(database, PadRow.record, name), filters.q) for name in ("name", "operator_id")]
        query = query.where(or_(_contains(PadRow.pad_id, filters.q), *names))
    query = _filtered(query, PadRow, PadRow.pad_id, filters, place)
    return (await database.scalars(query)).all()


async def in_force(database: AsyncSession, uav_ids: Sequence[str], now_ms: int) -> dict[str, int]:
    """How many authorisations of each of these drones hold now."""
    query = select(AuthorisationRow.uav_id, AuthorisationRow.record).where(AuthorisationRow.uav_id.in_(uav_ids))
    counts = dict.fromkeys(uav_ids, 0)
    for uav_id, text in await database.execute(query):
        its = orjson.loads(text)
        if not its.get("revoked") and its.get("valid_from_ms", 0) <= now_ms < its.get("valid_until_ms", 0):
            counts[uav_id] += 1
    return counts


def shown_drone(row: DroneRow, person: Person, number: Number, in_force_now: int) -> dict[str, Any]:
    """The RegistryDrone of a row."""
    return {
        "record": record(shown_uav(row.record, person)),
        "registration": number.shown(person),
        "version": version(row),
        "in_force": in_force_now,
    }


async def drone(database: AsyncSession, person: Person, uav_id: str) -> DroneRow | None:
    """One drone, where the person may see it."""
    query = person.scope.narrow(select(DroneRow).where(DroneRow.uav_id == uav_id), drone=DroneRow.uav_id)
    return (await database.scalars(query)).first()


async def authorisations(database: AsyncSession, uav_id: str) -> list[dict[str, Any]]:
    """The RegistryAuthorisations of a drone, those that end last first."""
    query = select(AuthorisationRow).where(AuthorisationRow.uav_id == uav_id)
    rows = (await database.scalars(query)).all()
    found = sorted(rows, key=lambda row: orjson.loads(row.record).get("valid_until_ms", 0), reverse=True)
    return [{"record": record(row.record), "version": version(row)} for row in found]


async def calibrations(database: AsyncSession, row: DroneRow, now_ms: int) -> list[dict[str, Any]]:
    """The RegistryCalibrations of a drone, by pad."""
    found: list[dict[str, Any]] = orjson.loads(row.record).get("calibrations", [])
    query = select(PadRow).where(PadRow.pad_id.in_([each["pad_id"] for each in found]))
    pads = {pad.pad_id: orjson.loads(pad.record).get("commissioning_sha256") for pad in await database.scalars(query)}
    return [{"record": each, "state": _state(each, pads.get(each["pad_id"]), now_ms)} for each in found]


def _state(calibration: dict[str, Any], commissioning_sha256: str | None, now_ms: int) -> str:
    """As the contract has it (``calibrations.in_force``)."""
    if "withdrawn" in calibration:
        return "withdrawn"
    if calibration["commissioning_sha256"] != commissioning_sha256:
        return "pad_changed"
    return "holds" if now_ms < calibration["valid_until_ms"] else "over"


async def pad(database: AsyncSession, person: Person, pad_id: str) -> PadRow | None:
    """One pad, where the person may see it."""
    query = person.scope.narrow(select(PadRow).where(PadRow.pad_id == pad_id), pad=PadRow.pad_id)
    return (await database.scalars(query)).first()


async def policies(database: AsyncSession, pad_id: str) -> list[dict[str, Any]]:
    """The RegistryPolicies of a pad (or of *): for each action the most specific one, as the contract takes it."""
    rows = await database.scalars(select(PolicyRow).where(PolicyRow.pad_id.in_((pad_id, "*"))))
    there = {(row.pad_id, row.action): row for row in rows}
    found = []
    for action in ACTIONS:
        scopes = ((pad_id, action), (pad_id, "*"), ("*", action), ("*", "*"))
        holding = next((scope for scope in scopes if scope in there), None)
        own = there.get((pad_id, action))
        found.append(
            {
                "action": action,
                "policy": record(there[holding].record) if holding is not None else Policy().to_json(),
                "set_for": "/".join(holding) if holding is not None else "",
                "own": own is not None,
            }
            | ({"version": version(own)} if own is not None else {})
        )
    return found


async def known(database: AsyncSession, kind: str, ids: Sequence[str]) -> set[str]:
    """Which of a list's lines are on the ledger already."""
    found: set[str] = set()
    for start in range(0, len(ids), 500):
        some = ids[start : start + 500]
        if kind == "authorisations":
            pairs = [tuple(each.split("/", 1)) for each in some]
            columns = (AuthorisationRow.uav_id, AuthorisationRow.authorisation_id)
            rows = await database.execute(select(*columns).where(tuple_(*columns).in_(pairs)))
            found |= {f"{uav_id}/{authorisation_id}" for uav_id, authorisation_id in rows}
        else:
            column = DroneRow.uav_id if kind == "drones" else PadRow.pad_id
            found |= set(await database.scalars(select(column).where(column.in_(some))))
    return found


async def landing_policy(database: AsyncSession, pad_id: str) -> str:
    """The policy that holds for landing there, as JSON."""
    landing = next(each for each in await policies(database, pad_id) if each["action"] == "land")
    return orjson.dumps(landing["policy"]).decode()


async def history(
    database: AsyncSession, person: Person, kind: str, name: str, place: Place, limit: int
) -> tuple[list[RecordVersionRow], list[dict[str, Any]]]:
    """Versions of a drone and its authorisations, or of a pad, its policies and its closures, newest first.

    Rows and shapes.
    """
    part, whole = (keys.AUTHORISATION, keys.UAV) if kind == "drone" else (keys.POLICY, keys.PAD)
    below = (f"{name}/", f"{name}0")  # "0" is what follows "/"
    mine = or_(
        and_(RecordVersionRow.kind == whole, RecordVersionRow.key == name),
        and_(RecordVersionRow.kind == part, RecordVersionRow.key >= below[0], RecordVersionRow.key < below[1]),
    )
    if kind == "pad":
        mine = or_(mine, and_(RecordVersionRow.kind == keys.CLOSURES, RecordVersionRow.key == name))
    order = (RecordVersionRow.block, RecordVersionRow.tx_index, RecordVersionRow.kind, RecordVersionRow.key)
    query = select(RecordVersionRow).where(mine)
    if place is not None:
        query = query.where(tuple_(*order) < place)
    rows = list(await database.scalars(query.order_by(*(each.desc() for each in order)).limit(limit)))
    signers = await _transactions(database, rows)
    return rows, [await _change(database, person, row, signers) for row in rows]


async def _transactions(
    database: AsyncSession, rows: Sequence[RecordVersionRow]
) -> dict[tuple[int, int], TransactionRow]:
    if not rows:
        return {}
    places = {(row.block, row.tx_index) for row in rows}
    query = select(TransactionRow).where(tuple_(TransactionRow.block, TransactionRow.tx_index).in_(places))
    return {(row.block, row.tx_index): row for row in await database.scalars(query)}


async def _change(
    database: AsyncSession,
    person: Person,
    row: RecordVersionRow,
    signers: dict[tuple[int, int], TransactionRow],
) -> dict[str, Any]:
    earlier = select(RecordVersionRow.record).where(
        RecordVersionRow.kind == row.kind,
        RecordVersionRow.key == row.key,
        tuple_(RecordVersionRow.block, RecordVersionRow.tx_index) < (row.block, row.tx_index),
    )
    order = (RecordVersionRow.block.desc(), RecordVersionRow.tx_index.desc())
    before = (await database.execute(earlier.order_by(*order).limit(1))).scalar_one_or_none()
    signer = signers[row.block, row.tx_index]
    clear = shown_uav if row.kind == keys.UAV else lambda text, _: text
    change: dict[str, Any] = {
        "kind": _KINDS[row.kind],
        "id": row.key,
        "record": record(clear(row.record, person)),
        "tx_id": signer.tx_id,
        "block": row.block,
        "t_ms": signer.t_ms,
        "function": signer.function,
        "by": {
            "msp_id": signer.creator_msp,
            "name": signer.creator_name,
            "certificate_sha256": signer.creator_certificate_sha256,
        },
    }
    return change | ({"before": record(clear(before, person))} if before is not None else {})


def _filtered(query: Any, table: Any, key: Any, filters: DroneQuery | PadQuery, place: Place) -> Any:
    if filters.msp is not None:
        query = query.where(table.msp_id == filters.msp)
    if filters.status is not None:
        query = query.where(table.status == filters.status)
    if filters.sort == "changed":
        order = (table.block, table.tx_index, key)
        query = query if place is None else query.where(tuple_(*order) < place)
        query = query.order_by(*(each.desc() for each in order))
    else:
        query = query if place is None else query.where(key > place[0])
        query = query.order_by(key)
    return query.limit(filters.limit + 1)


def _contains(column: Any, text: str) -> ColumnElement[bool]:
    """Any part, whatever the case."""
    return func.lower(column).contains(text.lower(), autoescape=True)


def _field(database: AsyncSession, column: Any, name: str) -> Any:
    """A text of a record: both databases read JSON, each in its way."""
    if database.get_bind().dialect.name == "postgresql":
        return cast(column, JSON)[name].as_string()
    return type_coerce(column, JSON)[name].as_string()
