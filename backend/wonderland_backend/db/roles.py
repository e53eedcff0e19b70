"""Two roles on PostgreSQL: the owner of the tables migrates them, and the server may only use them.

The server's role appends to the audit log and cannot change it, drop its triggers or disable them, since it does not
own it. It owns the tables that it makes a partition of each day.
"""

from __future__ import annotations

import re
from typing import Final

from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.engine import Database
from wonderland_backend.db.partitions import PARTITIONED, partitions
from wonderland_backend.db.tables.audit import AuditRow
from wonderland_backend.errors import DatabaseError

_NAME: Final = re.compile(r"[a-z_][a-z0-9_]{0,62}")
_MEMBER: Final = text("SELECT pg_has_role(current_user, :role, 'MEMBER')")
_KNOWN: Final = text("SELECT 1 FROM pg_roles WHERE rolname = :role")


async def confine(database: Database, role: str, password: str | None) -> None:
    """Give a role what the server needs and no more; make it, or give it this password, where there is one.

    Whoever calls owns the tables, and is a member of the role or may make roles. Raises `DatabaseError`.
    """
    if database.is_sqlite:
        raise DatabaseError("SQLite has no roles: whoever has the file has everything; use PostgreSQL for two roles")
    if not _NAME.fullmatch(role):
        raise DatabaseError(f"{role!r} is no name for a role: lower-case letters, digits and _, at most 63")
    async with database.write() as connection:
        if (await connection.execute(_KNOWN, {"role": role})).first() is None:
            if password is None:
                raise DatabaseError(f"there is no role {role}; give --server-password-file, and it is made")
            await connection.exec_driver_sql(f"CREATE ROLE {role} LOGIN")
        if password is not None:
            await _set_password(connection, role, password)
        if (await connection.execute(text("SELECT current_user"))).scalar_one() == role:
            raise DatabaseError(f"{role} migrates here itself: give the server a role that does not own the tables")
        if not (await connection.execute(_MEMBER, {"role": role})).scalar_one():
            # An owner who is no superuser hands the partitions over only to a role whose member it is.
            await connection.exec_driver_sql(f"GRANT {role} TO CURRENT_USER")
        await _grant(connection, role)


async def owns_audit_log(database: Database) -> bool:
    """Whether who is connected could drop what keeps the audit log, or become who could (PostgreSQL)."""
    owned = text("SELECT pg_has_role(tableowner, 'MEMBER') FROM pg_tables WHERE tablename = 'audit_log'")
    async with database.engine.connect() as connection:
        return bool((await connection.execute(owned)).scalar())


async def _set_password(connection: AsyncConnection, role: str, password: str) -> None:
    written = text("SELECT format('ALTER ROLE %I PASSWORD %L', cast(:role AS text), cast(:password AS text))")
    statement = (await connection.execute(written, {"role": role, "password": password})).scalar_one()
    await connection.execute(text(statement.replace(":", r"\:")))


async def _grant(connection: AsyncConnection, role: str) -> None:
    audit_log = AuditRow.__tablename__
    statements = [
        f"GRANT USAGE, CREATE ON SCHEMA public TO {role}",
        f"GRANT SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA public TO {role}",
        f"GRANT USAGE, SELECT ON ALL SEQUENCES IN SCHEMA public TO {role}",
        f"REVOKE ALL ON {audit_log}, alembic_version FROM {role}",
        f"GRANT SELECT, INSERT ON {audit_log} TO {role}",
        f"GRANT SELECT ON alembic_version TO {role}",
    ]
    for model in PARTITIONED:
        names = (model.__tablename__, *await partitions(connection, model.__tablename__))
        statements += [f'ALTER TABLE "{name}" OWNER TO {role}' for name in names]
    for statement in statements:
        await connection.exec_driver_sql(statement)
