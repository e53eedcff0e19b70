"""What was taken from people and machines since a backup is not given back by it.

Nobody is signed in after a restore, and no link that was handed out opens anything. Where the backup takes the place of
what came of it, whoever was suspended, limited or disabled meanwhile stays so, and the audit log keeps its newer rows.
Only ever less: what is there may be why somebody restores.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import psycopg
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.backup import postgres, store
from wonderland_backend.db.bulk import table_of
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.errors import BackendError

Rows = Callable[[str], Sequence[Sequence[Any]]]
"""Reads of what was there before, by a SELECT whose tables stand as ``{}.name``."""
_UNKNOWN: Final = (
    "Whoever was suspended, limited or disabled since then is not any more: look through people, machines and webhooks "
    "before others use it (wonderland backend person list, suspend; wonderland backend client list, revoke)."
)
_AUDIT: Final = tuple(column.name for column in table_of(AuditRow).columns)


def nothing(_: str) -> Sequence[Sequence[Any]]:
    """Of an empty place."""
    return ()


def of_sqlite(path: Path) -> Rows:
    """Of a file; what it has not (tables of another version) is nothing."""

    def rows(query: str) -> Sequence[Sequence[Any]]:
        with contextlib.closing(sqlite3.connect(path)) as opened, contextlib.suppress(sqlite3.OperationalError):
            return opened.execute(query.replace("{}", "main")).fetchall()
        return ()

    return rows


def of_postgres(connection: psycopg.Connection[Any]) -> Rows:
    """Of the schema that was put aside."""

    def rows(query: str) -> Sequence[Sequence[Any]]:
        with contextlib.suppress(psycopg.errors.UndefinedTable, psycopg.errors.UndefinedColumn):
            return connection.execute(query.replace("{}", postgres.KEPT).encode()).fetchall()
        return ()

    return rows


async def take_again(connection: AsyncConnection, before: Rows, now_ms: int) -> list[str]:
    """What was done, in sentences. Raises `BackendError` where it would leave nobody in charge."""
    ended = await store.end_sign_ins(connection)
    said = [f"Nobody is signed in any more, and no link opens anything ({ended} ended)."]
    people = {each[0]: (each[1], each[2]) for each in before("SELECT person_id, state, roles FROM {}.people")}
    if not await store.has_any_person(connection, people):
        return [*said, _UNKNOWN]  # an empty place, or another deployment's
    passkeys = {each[0] for each in before("SELECT credential_id FROM {}.passkeys")}
    revoked = {each[0] for each in before("SELECT client_id FROM {}.clients WHERE revoked_ms IS NOT NULL")}
    wanted = {each[0] for each in before("SELECT subscription_id FROM {}.subscriptions WHERE state = 'active'")}
    ended_keys = before("SELECT certificate_sha256, ended_ms FROM {}.signing_keys WHERE ended_ms IS NOT NULL")
    done = {
        "accounts suspended or limited": await store.limit_people(connection, people, now_ms),
        "passkeys removed": await store.remove_passkeys(connection, people, passkeys),
        "machines disabled": await store.disable_clients(connection, revoked, now_ms),
        "webhooks paused": await store.pause_subscriptions(connection, wanted),
        "signing keys ended": await store.end_keys(connection, {each[0]: each[1] for each in ended_keys}),
        "rows of the audit log kept": await _keep_audit(connection, before),
    }
    if not await store.has_administrator(connection):
        raise BackendError(
            "no administrator of the backup is one still, so that nobody could let others in: restore it into an empty "
            "database, and look through the accounts there"
        )
    return [*said, *(f"As it was before the restore: {count} {what}." for what, count in done.items() if count)]


async def _keep_audit(connection: AsyncConnection, before: Rows) -> int:
    """Rows that follow on the last one of the backup; none where the logs differ."""
    last = await store.last_audited(connection)
    if last is None:
        return 0
    seq, sha256 = last
    # Numbers and names of our own: nothing that somebody else wrote is part of these.
    same = before(f"SELECT sha256 FROM {{}}.audit_log WHERE seq = {seq:d}")  # noqa: S608
    if [each[0] for each in same] != [sha256]:
        return 0
    newer = before(f"SELECT {', '.join(_AUDIT)} FROM {{}}.audit_log WHERE seq > {seq:d} ORDER BY seq")  # noqa: S608
    return await store.add_audited(connection, [dict(zip(_AUDIT, each, strict=True)) for each in newer])
