"""What `wonderland doctor` checks of a backend."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from sqlalchemy import make_url
from sqlalchemy.exc import SQLAlchemyError

from wonderland.doctor import checks, gather
from wonderland.doctor.checks import Check
from wonderland_backend.backup.make import backups
from wonderland_backend.backup.manifest import moment_ms
from wonderland_backend.db import migrate
from wonderland_backend.db.engine import Database
from wonderland_backend.db.roles import owns_audit_log
from wonderland_backend.errors import BackendError
from wonderland_backend.settings import CONFIG, Settings, load

PART: Final = "backend"
BACKUPS: Final = Path("/var/lib/wonderland-backend/backups")
"""Where wonderland-backup.service puts them."""


def all_checks(path: Path, now_ms: int) -> Iterator[Check]:
    """Of the backend whose settings these are."""
    os.environ[CONFIG] = str(path)  # as `wonderland backend --config` does
    try:
        settings = load()
    except BackendError as error:
        yield Check(PART, "settings", "failed", str(error), "docs/reference/settings.md has them all")
        return
    yield Check(PART, "settings", "ok", f"they can be read: {path}")
    url = make_url(settings.database)
    if url.get_backend_name() == "sqlite" and not Path(url.database or "").is_file():
        step = "wonderland backend migrate, or put `database` right"  # to open it would make it
        yield Check(PART, "database", "failed", f"there is no file {url.database}", step)
    else:
        yield from asyncio.run(_database(settings))
    if settings.connection is None:
        yield Check(PART, "ledger", "failed", "no connection is set", 'connection = "connection.json"')
    else:
        yield from gather.ledger(PART, settings.connection, settings.identity, now_ms)
    newest = backups(BACKUPS)[-1:] if BACKUPS.is_dir() else []
    yield checks.backups(moment_ms(newest[0]) if newest else None, str(BACKUPS), now_ms)


async def _database(settings: Settings) -> list[Check]:
    database = Database(settings.database)
    try:
        found, needed = await migrate.revision(database), migrate.head()
        if found != needed:
            which = f"its tables are of revision {found or 'none'}; this version needs {needed}"
            return [Check(PART, "database", "failed", which, "wonderland backend migrate")]
        said = [Check(PART, "database", "ok", f"its tables are of this version ({found})")]
        if not database.is_sqlite:
            owner = await owns_audit_log(database)
            step = "wonderland backend migrate --server-role, and let the server connect as that role"
            said.append(
                Check(PART, "role", "warning", "the server owns the audit log, and could drop its triggers", step)
                if owner
                else Check(PART, "role", "ok", "the server cannot change the audit log")
            )
    except (SQLAlchemyError, BackendError, OSError) as error:
        line = str(error).splitlines()[0]
        return [Check(PART, "database", "failed", line, "is the database running, and the address right?")]
    else:
        return said
    finally:
        await database.close()
