"""Passkeys as they are kept."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Row, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.auth.store.sign_ins import ACTIVE
from wonderland_backend.db.tables.people import PasskeyRow, PersonRow


async def ids_of(connection: AsyncConnection, person_id: str) -> list[str]:
    """The credentials of a person."""
    query = select(PasskeyRow.credential_id).where(PasskeyRow.person_id == person_id)
    return list((await connection.execute(query)).scalars())


async def is_known(connection: AsyncConnection, credential_id: str) -> bool:
    """Whether somebody has this credential."""
    query = select(PasskeyRow.person_id).where(PasskeyRow.credential_id == credential_id)
    return (await connection.execute(query)).first() is not None


async def add(connection: AsyncConnection, row: dict[str, Any]) -> None:
    """Insert a passkey, whose credential nobody has yet (`is_known`)."""
    await connection.execute(insert(PasskeyRow), [row])


async def of_active_person(connection: AsyncConnection, credential_id: str) -> Row[str, str, str, int] | None:
    """Its id, person, public key and use count; None where there is none, or its person is not active."""
    found = await connection.execute(
        select(PasskeyRow.credential_id, PasskeyRow.person_id, PasskeyRow.public_key, PasskeyRow.sign_count)
        .join_from(PasskeyRow, PersonRow)
        .where(PasskeyRow.credential_id == credential_id, PersonRow.state == ACTIVE)
    )
    return found.first()


async def note_use(connection: AsyncConnection, credential_id: str, sign_count: int, now_ms: int) -> None:
    """It signed somebody in."""
    await connection.execute(
        update(PasskeyRow)
        .where(PasskeyRow.credential_id == credential_id)
        .values(sign_count=sign_count, last_used_ms=now_ms)
    )
