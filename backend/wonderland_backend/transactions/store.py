"""Transactions on their way, in the database; each step moves a row on only from where it was."""

from __future__ import annotations

from base64 import urlsafe_b64encode
from collections.abc import Sequence
from typing import Any, Final

import orjson
from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland.messages import Language
from wonderland_backend.db.tables.signing import SignedTransactionRow as Row
from wonderland_backend.db.tables.signing import SigningKeyRow
from wonderland_backend.numbers import store as numbers
from wonderland_backend.transactions import problems

PROPOSED, ENDORSED, SUBMITTED, UNKNOWN = "proposed", "endorsed", "submitted", "unknown"
VALID, INVALID, REFUSED, EXPIRED = "valid", "invalid", "refused", "expired"
WAITING: Final = (PROPOSED, ENDORSED)
"""For a signature."""
ENDED: Final = (INVALID, REFUSED, EXPIRED)
"""And came to nothing."""
UNDER_WAY: Final = (SUBMITTED, UNKNOWN)
"""With the ledger."""
KEEP_MS: Final = 30 * 86_400_000
"""The ledger and the audit log keep what was done; here it need not stay."""


def transaction_json(row: Row, language: Language, *, to_sign: bytes | None = None) -> dict[str, Any]:
    """The SignedTransaction of a row, in the language of whoever asks."""
    content: dict[str, Any] = {
        "tx_id": row.tx_id,
        "function": row.function,
        "subject": row.subject,
        "argument": orjson.Fragment(row.argument),
        "state": row.state,
        "certificate_sha256": row.certificate_sha256,
        "endorsers": row.endorsers.split(",") if row.endorsers else [],
        "created_ms": row.created_ms,
        "changed_ms": row.changed_ms,
    }
    if to_sign is not None:
        content["to_sign"] = urlsafe_b64encode(to_sign).rstrip(b"=").decode()
    if row.problem is not None:
        content["problem"] = problems.in_words(orjson.loads(row.problem), language)
    return content | {name: getattr(row, name) for name in ("block", "validation") if getattr(row, name) is not None}


async def add(connection: AsyncConnection, row: dict[str, Any]) -> None:
    """A new one; those of long ago go."""
    await connection.execute(
        delete(Row).where(Row.changed_ms < row["created_ms"] - KEEP_MS, Row.state.not_in(UNDER_WAY))
    )
    await connection.execute(insert(Row), [row])


async def count_since(database: AsyncSession, person_id: str, since_ms: int) -> int:
    """How many somebody has begun since."""
    query = select(func.count()).select_from(Row).where(Row.person_id == person_id, Row.created_ms > since_ms)
    return int((await database.execute(query)).scalar_one())


async def find_transaction(database: AsyncSession, tx_id: str) -> Row | None:
    """The transaction with this id; None where there is none."""
    return await database.get(Row, tx_id)


async def latest(database: AsyncSession, person_id: str, limit: int) -> Sequence[Row]:
    """Somebody's transactions, newest first, at most `limit`."""
    query = select(Row).where(Row.person_id == person_id).order_by(Row.created_ms.desc(), Row.tx_id).limit(limit)
    return (await database.scalars(query)).all()


async def under_way(database: AsyncSession) -> Sequence[str]:
    """Ids of those that the ledger has, or may have, and whose outcome nobody has told."""
    return (await database.scalars(select(Row.tx_id).where(Row.state.in_(UNDER_WAY)))).all()


async def move(connection: AsyncConnection, tx_id: str, before: tuple[str, ...], **values: Any) -> bool:
    """Change a row, if it still is in one of these states; whether it was. With its end a number stays, or goes."""
    moved = await connection.execute(update(Row).where(Row.tx_id == tx_id, Row.state.in_(before)).values(**values))
    if moved.rowcount == 1 and values.get("state") in (VALID, *ENDED):
        await numbers.settle(connection, tx_id, valid=values["state"] == VALID)
    return moved.rowcount == 1


async def sweep(connection: AsyncConnection, before_ms: int) -> None:
    """Delete numbers whose transaction came to nothing: those begun before this and never signed among them."""
    await numbers.sweep(connection, ended=ENDED, waiting=WAITING, before_ms=before_ms)


async def owner_of_key(connection: AsyncConnection, certificate_sha256: str) -> str | None:
    """Whose signing key it is or was; None for a new one."""
    query = select(SigningKeyRow.person_id).where(SigningKeyRow.certificate_sha256 == certificate_sha256)
    owner: str | None = (await connection.execute(query)).scalar_one_or_none()
    return owner


async def add_key(connection: AsyncConnection, row: dict[str, Any]) -> None:
    """A new signing key."""
    await connection.execute(insert(SigningKeyRow), [row])


async def take_key_up_again(connection: AsyncConnection, certificate_sha256: str) -> None:
    """One that its person had taken off."""
    await connection.execute(
        update(SigningKeyRow).where(SigningKeyRow.certificate_sha256 == certificate_sha256).values(ended_ms=None)
    )


async def end_key(connection: AsyncConnection, person_id: str, certificate_sha256: str, now_ms: int) -> bool:
    """Take it off; False where it is not theirs, or was taken off before."""
    ended = await connection.execute(
        update(SigningKeyRow)
        .where(
            SigningKeyRow.certificate_sha256 == certificate_sha256,
            SigningKeyRow.person_id == person_id,
            SigningKeyRow.ended_ms.is_(None),
        )
        .values(ended_ms=now_ms)
    )
    return ended.rowcount == 1


async def keys_of(session: AsyncSession, person_id: str) -> Sequence[SigningKeyRow]:
    """Somebody's signing keys, newest first."""
    query = (
        select(SigningKeyRow)
        .where(SigningKeyRow.person_id == person_id, SigningKeyRow.ended_ms.is_(None))
        .order_by(SigningKeyRow.bound_ms.desc())
    )
    return (await session.scalars(query)).all()
