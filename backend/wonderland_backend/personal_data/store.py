"""Erasing what no proof rests on; the dry run counts what the same conditions mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from sqlalchemy import ColumnElement, Table, and_, delete, func, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.proofs.records.fields import MAX_TIME_MS
from wonderland_backend import audit
from wonderland_backend.db.bulk import table_of
from wonderland_backend.db.tables import exports, flights, numbers, people, reported, signing
from wonderland_backend.db.tables.clients import IdempotencyRow
from wonderland_backend.errors import BackendError
from wonderland_backend.people.store import ACTIVE, SUSPENDED
from wonderland_backend.person import roles_of
from wonderland_backend.personal_data.subjects import Erased, Subject

SERVER: Final = "the server's administrator"
AGAIN: Final = "again, after a restore"
"""The reason of an erasure that was done again; it has no journal of its own."""
STAYS: Final[Mapping[str, tuple[str, ...]]] = {
    "drone": (
        "the ledger (serial number, operator id, commitment, sessions, verdicts): every later block's hash covers it",
        "the commitment: without its salt it opens to nobody",
        "rows that are derived from the ledger: they would return with the next rebuild",
        "reported steps and ends of sessions, alerts and notes on them, requests for proofs: what the proofs rest on",
        "the audit log, which has the serial number and never the registration number",
        "deliveries to webhooks (14 days), records that were refused (finding_retention_h)",
        "this database's backups, exports that were fetched, other members' and receivers' copies: ask there",
        "what a running server has in memory of a drone that is heard now: it comes again while the drone broadcasts",
    ),
    "account": (
        "the account's row, with a neutral name, suspended: the audit log names its id",
        "the audit log: it has the name and the address as they were; its chain would break",
        "certificates and signatures on the ledger, for good; revoke the certificate at the CA",
        "texts that others wrote: notes, reasons; alerts that name who dealt with them",
        "machines that this account registered: they are disabled with it",
        "this database's backups and the audit stream's receiver",
    ),
}
"""What an erasure leaves, and why."""


def neutral_name(person_id: str) -> str:
    """Of an account whose person is not to be named any more."""
    return f"erased-{person_id[:8]}"


async def erase(
    connection: AsyncConnection, erased: Erased, reason: str, now_ms: int, *, dry: bool, again: bool = False
) -> dict[str, int]:
    """Rows by table, deleted or neutralised; `dry`: only counted. Audited. Raises `BackendError`.

    `again`: after a restore, so that what was heard since the erasure stays.
    """
    if erased.subject.kind == "account":
        await _may_go(connection, erased.subject.id)
    found: dict[str, int] = {}
    for table, condition, values in _changes(erased, erased.erased_ms if again else MAX_TIME_MS):
        if dry:
            count = (await connection.execute(select(func.count()).select_from(table).where(condition))).scalar_one()
        elif values is None:
            count = (await connection.execute(delete(table).where(condition))).rowcount
        else:
            count = (await connection.execute(update(table).where(condition).values(values))).rowcount
        found[str(table.name)] = int(count)
    if not dry:
        detail = {"reason": reason, "rows": {name: count for name, count in found.items() if count}}
        await audit.record(connection, SERVER, "erase_personal_data", erased.subject.audited, detail, t_ms=now_ms)
    return found


def _changes(erased: Erased, until_ms: int) -> list[tuple[Table, ColumnElement[bool], dict[str, Any] | None]]:
    """Tables, which rows of them, and what these become; None: they go."""
    return (
        _of_drone(erased, until_ms) if erased.subject.kind == "drone" else _of_account(erased.subject, erased.erased_ms)
    )


def _of_drone(erased: Erased, until_ms: int) -> list[tuple[Table, ColumnElement[bool], dict[str, Any] | None]]:
    """What was heard and stored until then."""
    uav_id = erased.subject.id
    found: list[tuple[Table, ColumnElement[bool], dict[str, Any] | None]] = []
    kept = table_of(numbers.RegistrationNumberRow)
    found.append((kept, and_(kept.c.uav_id == uav_id, kept.c.commitment.in_(erased.commitments)), None))
    for model in (reported.TrackRow, reported.EstimateRow, reported.FindingRow):
        table = table_of(model)
        when = table.c.received_ms if "received_ms" in table.c else table.c.t_ms
        found.append((table, and_(table.c.uav_id == uav_id, when <= until_ms), None))
    for model_ in (reported.LatestTrackRow, reported.BroadcastOperatorRow):
        table = table_of(model_)
        found.append((table, and_(table.c.uav_id == uav_id, table.c.t_ms <= until_ms), None))
    table = table_of(flights.FlightRow)
    found.append((table, and_(table.c.uav_id == uav_id, table.c.start_ms <= until_ms), None))
    table = table_of(reported.IrregularRow)
    its = and_(table.c.agent == "uav", table.c.agent_id == uav_id, table.c.received_ms <= until_ms)
    found.append((table, its, None))
    return found


def _of_account(subject: Subject, erased_ms: int) -> list[tuple[Table, ColumnElement[bool], dict[str, Any] | None]]:
    person_id, name = subject.id, neutral_name(subject.id)
    found: list[tuple[Table, ColumnElement[bool], dict[str, Any] | None]] = []
    for model in (people.PasskeyRow, people.SignInRow, people.LinkRow, exports.ExportRow):
        table = table_of(model)
        found.append((table, table.c.person_id == person_id, None))
    table = table_of(IdempotencyRow)
    found.append((table, table.c.principal == person_id, None))
    table = table_of(signing.SigningKeyRow)
    found.append((table, table.c.person_id == person_id, {"ended_ms": func.coalesce(table.c.ended_ms, erased_ms)}))
    table = table_of(signing.SignedTransactionRow)
    found.append((table, table.c.person_id == person_id, {"person": name}))
    table = table_of(people.PersonRow)
    neutral = {
        "name": name,
        "email": None,
        "issuer": None,
        "subject": None,
        "state": SUSPENDED,
        "changed_ms": erased_ms,
        "revision": table.c.revision + 1,
    }
    found.append(
        (table, and_(table.c.person_id == person_id, or_(table.c.name != name, table.c.email.is_not(None))), neutral)
    )
    return found


async def _may_go(connection: AsyncConnection, person_id: str) -> None:
    row = people.PersonRow
    others = select(row.roles).where(row.state == ACTIVE, row.person_id != person_id)
    mine = (await connection.execute(select(row.roles).where(row.person_id == person_id))).scalar_one_or_none()
    if mine is None or "admin" not in roles_of(mine):
        return
    if not any("admin" in roles_of(text) for text in (await connection.execute(others)).scalars()):
        raise BackendError("this is the last administrator: make somebody else one first")
