"""The log's chain: each row's hash covers the row and the hash of the row before."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from typing import Any, Final, Protocol

from sqlalchemy import Select, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.proofs import encoding
from wonderland_backend.audit import queries
from wonderland_backend.audit.acts import ACTS
from wonderland_backend.db.tables.audit import AuditRow, AuditStreamRow
from wonderland_backend.db.tables.reported import InstanceRow

START: Final = "0" * 64
"""What the first row has for the hash of the row before."""
READ_AGAIN_MS: Final = 60_000
_LOCK: Final = 0x415544  # "AUD"
_HASHED: Final = ("seq", "t_ms", "person_id", "person", "act", "subject", "detail", "previous_sha256")


class Actor(Protocol):
    """Who does it; `wonderland_backend.person.Person` is one."""

    @property
    def person_id(self) -> str:
        """Identifier of the account or machine that acted."""

    @property
    def name(self) -> str:
        """Name as it stood when they acted; the log keeps it."""


async def record(
    connection: AsyncConnection,
    who: Actor | str,
    act: str,
    subject: str,
    detail: Mapping[str, Any] | None = None,
    tx_id: str | None = None,
    *,
    t_ms: int | None = None,
) -> None:
    """Append a row within the caller's database transaction; do it last, since others wait until that ends.

    `who` is a text where no person acts: the server itself, or somebody who could not sign in. `act` is one of
    `audit.acts`, `subject` what it was done to (``alert/…``), `detail` what is worth to be known besides:
    texts, integers, booleans, lists and objects of these. `t_ms` defaults to now. Times never go back: while a
    clock that was set back is behind, rows are dated like the one before. Raises `ValueError` for another act.
    """
    if act not in ACTS:
        raise ValueError(
            f"{act} is no act that the log knows; add it to backend.audit.acts, and name it in the console"
        )
    await take_turns(connection)
    newest = select(AuditRow.seq, AuditRow.sha256, AuditRow.t_ms).order_by(AuditRow.seq.desc()).limit(1)
    last = (await connection.execute(newest)).first()
    seq, previous, earliest_ms = (1, START, 0) if last is None else (last.seq + 1, last.sha256, last.t_ms)
    row: dict[str, Any] = {
        "seq": seq,
        "t_ms": max(earliest_ms, time.time_ns() // 1_000_000 if t_ms is None else t_ms),
        "person_id": "" if isinstance(who, str) else who.person_id,
        "person": (who if isinstance(who, str) else who.name)[:128],
        "act": act,
        "subject": subject[:256],
        "detail": encoding.encode(dict(detail or {})).decode(),
        "tx_id": tx_id,
        "previous_sha256": previous,
    }
    row["sha256"] = hash_of(row)
    await connection.execute(insert(AuditRow), [row])


async def record_read(
    connection: AsyncConnection,
    who: Actor,
    subject: str,
    detail: Mapping[str, Any] | None = None,
    *,
    act: str = "read_personal_data",
    t_ms: int,
) -> None:
    """The same for a read, which pages repeat by themselves: one row a minute for what one person reads."""
    await take_turns(connection)
    known = recorded(who, act, subject, since_ms=t_ms - READ_AGAIN_MS, t_ms=t_ms)
    if (await connection.execute(known)).first() is None:
        await record(connection, who, act, subject, detail, t_ms=t_ms)


def recorded(who: Actor, act: str, subject: str, *, since_ms: int, t_ms: int) -> Select[Any]:
    """Finds a row about somebody's act in that time."""
    return (
        select(AuditRow.seq)
        .where(AuditRow.subject == subject, AuditRow.act == act, AuditRow.person_id == who.person_id)
        .where(AuditRow.t_ms.between(since_ms, t_ms))
        .limit(1)
    )


async def take_turns(connection: AsyncConnection) -> None:
    """Wait until no other transaction that writes to the log is under way: each row needs the hash of the one before.

    SQLite has one writer anyway.
    """
    if connection.dialect.name == "postgresql":
        await connection.execute(select(func.pg_advisory_xact_lock(_LOCK)))


def hash_of(row: Mapping[str, Any]) -> str:
    """SHA-256 (hexadecimal) over the canonical JSON of a row: every column but the hash itself."""
    content = {name: row[name] for name in _HASHED}
    if row["tx_id"] is not None:
        content["tx_id"] = row["tx_id"]
    return hashlib.sha256(encoding.encode(content)).hexdigest()


async def ensure_instance(connection: AsyncConnection, name: str, now_ms: int) -> str:
    """The installation's name; at the first start it gets this one."""
    known = await queries.instance(connection)
    if known is not None:
        return known
    await connection.execute(insert(InstanceRow), [{"id": 1, "instance": name, "created_ms": now_ms}])
    return name


async def ensure_bus_key(connection: AsyncConnection, new: str) -> str:
    """The key of the backends' bus; at the first start with one it gets this one."""
    known = await queries.bus_key(connection)
    if known is not None:
        return known
    await connection.execute(update(InstanceRow).values(bus_key=new))
    return new


async def note_sent(connection: AsyncConnection, destination: str, seq: int, *, again: bool) -> None:
    """The log was sent there up to this row; `again`: not for the first time."""
    if again:
        known = update(AuditStreamRow).where(AuditStreamRow.destination == destination)
        await connection.execute(known.values(seq=seq))
    else:
        await connection.execute(insert(AuditStreamRow), [{"destination": destination, "seq": seq}])
