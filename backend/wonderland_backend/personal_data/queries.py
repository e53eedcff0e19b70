"""Everything that the database has about one drone or one account, table by table."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import AsyncIterator, Iterator
from typing import Any, Final

from sqlalchemy import ColumnElement, Table, or_, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.records import keys
from wonderland_backend.db.tables import Base
from wonderland_backend.db.tables.ledger import DroneRow, SessionRow
from wonderland_backend.db.tables.numbers import RegistrationNumberRow
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.personal_data.subjects import Subject

DRONE_COLUMNS: Final = ("uav_id",)
ACCOUNT_COLUMNS: Final = ("person_id", "owner_id", "created_by", "requested_by", "owner", "principal", "stored_by")
SECRET: Final = frozenset({"salt", "token_sha256", "cookie_sha256", "secret_sha256", "secret", "ceremony_sha256"})
"""Columns that open something for whoever has them; a person's access is not a key."""


def _of_drone(table: Table, uav_id: str) -> ColumnElement[bool] | None:
    columns = table.c
    found: list[ColumnElement[bool]] = [columns[name] == uav_id for name in DRONE_COLUMNS if name in columns]
    if "agent_id" in columns and "agent" in columns:
        found.append((columns.agent == "uav") & (columns.agent_id == uav_id))
    if table.name in {"evidence", "reported_ends"}:
        found.append(columns.session_id.in_(select(SessionRow.session_id).where(SessionRow.uav_id == uav_id)))
    if table.name == "record_versions":
        authorisations = columns.key.startswith(f"{uav_id}/", autoescape=True)
        found += [
            (columns.kind == keys.UAV) & (columns.key == uav_id),
            (columns.kind == keys.AUTHORISATION) & authorisations,
        ]
    if table.name in {"audit_log", "signed_transactions"}:
        found.append(columns.subject == f"drone/{uav_id}")
    if table.name == "events":
        found.append(columns.payload.contains(json.dumps(uav_id), autoescape=True))
    return or_(*found) if found else None


def _of_account(table: Table, person_id: str) -> ColumnElement[bool] | None:
    columns = table.c
    found: list[ColumnElement[bool]] = [columns[name] == person_id for name in ACCOUNT_COLUMNS if name in columns]
    if table.name == "audit_log":
        found.append(columns.subject == f"person/{person_id}")
    return or_(*found) if found else None


def parts(subject: Subject) -> Iterator[tuple[Table, ColumnElement[bool]]]:
    """Which tables have something about it, and which of their rows."""
    of = _of_drone if subject.kind == "drone" else _of_account
    for table in Base.metadata.sorted_tables:
        condition = of(table, subject.id)
        if condition is not None:
            yield table, condition


async def rows(database: AsyncSession, table: Table, condition: ColumnElement[bool]) -> AsyncIterator[dict[str, Any]]:
    """The rows, one after the other, without what opens something; bytes as base64."""
    shown = [column for column in table.c if column.name not in SECRET]
    found = await database.stream(select(*shown).where(condition))
    async for row in found.mappings():
        yield {
            str(name): b64encode(value).decode() if isinstance(value, bytes) else value
            for name, value in row.items()
            if value is not None
        }


async def is_known(database: AsyncSession, subject: Subject) -> bool:
    """Whether there is such an account; of drones, whether anything is kept under that serial number."""
    if subject.kind == "account":
        return await database.get(PersonRow, subject.id) is not None
    for table, condition in parts(subject):
        if (await database.execute(select(*table.primary_key).where(condition).limit(1))).first() is not None:
            return True
    return False


async def record_of(database: AsyncSession, uav_id: str) -> str | None:
    """The drone's record as the mirror has it (JSON)."""
    return (await database.execute(select(DroneRow.record).where(DroneRow.uav_id == uav_id))).scalar_one_or_none()


async def commitments_of(database: AsyncSession, uav_id: str) -> tuple[str, ...]:
    """The commitments whose numbers are kept for a drone."""
    query = select(RegistrationNumberRow.commitment).where(RegistrationNumberRow.uav_id == uav_id)
    return tuple((await database.scalars(query.order_by(RegistrationNumberRow.commitment))).all())
