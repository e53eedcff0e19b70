"""What a restore writes besides what was backed up."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

from sqlalchemy import delete, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.bulk import table_of
from wonderland_backend.db.tables import people
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.db.tables.clients import ClientRow
from wonderland_backend.db.tables.signing import SigningKeyRow
from wonderland_backend.db.tables.webhooks import SubscriptionRow
from wonderland_backend.people.store import ACTIVE, SUSPENDED

_PEOPLE: Final = table_of(people.PersonRow)
_PASSKEYS: Final = table_of(people.PasskeyRow)
_CLIENTS: Final = table_of(ClientRow)
_SUBSCRIPTIONS: Final = table_of(SubscriptionRow)
_KEYS: Final = table_of(SigningKeyRow)
_AUDIT: Final = table_of(AuditRow)


async def end_sign_ins(connection: AsyncConnection) -> int:
    """Browsers that are signed in, links that were handed out, ceremonies under way."""
    tables = (people.SignInRow, people.LinkRow, people.CeremonyRow)
    return sum([(await connection.execute(delete(table_of(each)))).rowcount for each in tables])


async def has_any_person(connection: AsyncConnection, person_ids: Collection[str]) -> bool:
    """Whether one of these is known here."""
    known = set((await connection.execute(select(_PEOPLE.c.person_id))).scalars())
    return not known.isdisjoint(person_ids)


async def has_administrator(connection: AsyncConnection) -> bool:
    """Whether somebody may let others in."""
    active = select(_PEOPLE.c.roles).where(_PEOPLE.c.state == ACTIVE)
    return any("admin" in roles.split() for roles in (await connection.execute(active)).scalars())


async def limit_people(connection: AsyncConnection, were: Mapping[str, tuple[str, str]], now_ms: int) -> int:
    """Suspended as they were, and with no role that they had not any more."""
    changed = 0
    for row in (await connection.execute(select(_PEOPLE))).all():
        if row.person_id not in were:
            continue
        state, roles = were[row.person_id]
        left = " ".join(each for each in row.roles.split() if each in roles.split())
        suspended = row.state == ACTIVE and (state == SUSPENDED or not left)
        if left == row.roles and not suspended:
            continue
        values = {
            # An account has one role at least; with none left it is suspended.
            "roles": left or row.roles,
            "state": SUSPENDED if suspended else row.state,
            "changed_ms": now_ms,
            "revision": row.revision + 1,
        }
        await connection.execute(update(_PEOPLE).where(_PEOPLE.c.person_id == row.person_id).values(values))
        changed += 1
    return changed


async def remove_passkeys(connection: AsyncConnection, known: Collection[str], kept: Collection[str]) -> int:
    """Of people who were known: passkeys that they had not any more."""
    rows = (await connection.execute(select(_PASSKEYS.c.credential_id, _PASSKEYS.c.person_id))).all()
    gone = [row.credential_id for row in rows if row.person_id in known and row.credential_id not in kept]
    for each in gone:
        await connection.execute(delete(_PASSKEYS).where(_PASSKEYS.c.credential_id == each))
    return len(gone)


async def disable_clients(connection: AsyncConnection, revoked: Collection[str], now_ms: int) -> int:
    """Machines that had been disabled."""
    values = {"revoked_ms": now_ms}
    found = 0
    for each in sorted(revoked):
        its = (_CLIENTS.c.client_id == each) & _CLIENTS.c.revoked_ms.is_(None)
        found += (await connection.execute(update(_CLIENTS).where(its).values(values))).rowcount
    return found


async def pause_subscriptions(connection: AsyncConnection, wanted: Collection[str]) -> int:
    """Webhooks that were not active any more."""
    active = select(_SUBSCRIPTIONS.c.subscription_id).where(_SUBSCRIPTIONS.c.state == "active")
    gone = [each for each in (await connection.execute(active)).scalars() if each not in wanted]
    for each in gone:
        its = _SUBSCRIPTIONS.c.subscription_id == each
        await connection.execute(update(_SUBSCRIPTIONS).where(its).values(state="paused"))
    return len(gone)


async def end_keys(connection: AsyncConnection, ended: Mapping[str, int]) -> int:
    """Signing keys that had been ended."""
    found = 0
    for certificate, ended_ms in sorted(ended.items()):
        its = (_KEYS.c.certificate_sha256 == certificate) & _KEYS.c.ended_ms.is_(None)
        found += (await connection.execute(update(_KEYS).where(its).values(ended_ms=ended_ms))).rowcount
    return found


async def last_audited(connection: AsyncConnection) -> tuple[int, str] | None:
    """The log's last row: its number and hash."""
    row = (
        await connection.execute(select(_AUDIT.c.seq, _AUDIT.c.sha256).order_by(_AUDIT.c.seq.desc()).limit(1))
    ).first()
    return None if row is None else (row.seq, row.sha256)


async def add_audited(connection: AsyncConnection, rows: list[dict[str, Any]]) -> int:
    """Rows as they were."""
    for at in range(0, len(rows), 1_000):
        await connection.execute(insert(_AUDIT), rows[at : at + 1_000])
    return len(rows)
