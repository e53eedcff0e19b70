"""Bringing a backup back: looked through before anything is changed, compared after, whole or not at all."""

from __future__ import annotations

import contextlib
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import psycopg
from sqlalchemy.engine import URL

from wonderland_backend.backup import postgres, sealed, sqlite, taken
from wonderland_backend.backup.manifest import DATABASE, SEALED, Manifest
from wonderland_backend.db import migrate
from wonderland_backend.errors import BackendError
from wonderland_backend.personal_data.store import AGAIN
from wonderland_backend.personal_data.subjects import Erased

_MARGIN_MS: Final = 15 * 60_000
"""An erasure has the time at which it began, and may have been committed after the backup's snapshot."""
_ERASED: Final = f"""
SELECT subject, max(CASE WHEN detail LIKE '%{AGAIN}%' THEN 0 ELSE t_ms END) FROM {{}}
WHERE act = 'erase_personal_data' AND t_ms >= {{}} GROUP BY subject ORDER BY 1
"""  # noqa: S608 - own words
_POSTGRES: Final = _ERASED.replace(f"%{AGAIN}%", f"%%{AGAIN}%%")


def since(manifest: Manifest, noted: list[Erased]) -> list[Erased]:
    """Which erasures of a journal the backup may not have."""
    return [each for each in noted if each.erased_ms >= manifest.made_ms - _MARGIN_MS]


def refuse_unknown(manifest: Manifest, url: URL) -> None:
    """Raises `BackendError` for another kind of database, and for tables of a later version."""
    kind = url.get_backend_name()
    if manifest.database != kind:
        raise BackendError(f"the backup is of {manifest.database}, and --database is {kind}; both must be the same")
    if not migrate.knows(manifest.revision):
        raise BackendError(
            f"the backup is of Wonderland {manifest.version}, whose tables (revision {manifest.revision}) this version "
            "does not know: install that version or a later one"
        )


@contextlib.contextmanager
def database(
    manifest: Manifest, directory: Path, url: URL, *, replace: bool, role: str | None, journal: list[Erased]
) -> Iterator[taken.Rows]:
    """The database as it was backed up, for what is still to be done on it; what was there comes back if that fails.

    Gives reads of what was there before. Raises `BackendError`.
    """
    if manifest.database == "sqlite":
        target = Path(url.database or "")
        _refuse(
            str(target),
            sqlite.is_empty(target),
            replace,
            _erased_sqlite(target, manifest.made_ms),
            journal,
        )
        with sqlite.replacing(target) as kept:
            sqlite.copy(directory / DATABASE, target)
            yield taken.nothing if kept is None else taken.of_sqlite(kept)
        return
    with postgres.connect(url) as connection:
        if role is not None and not postgres.has_role(connection, role):
            raise BackendError(
                f"the server that was backed up connects as {role}, which is no role here: give --server-role and "
                "--server-password-file, and it is made"
            )
        erased = _erased_postgres(connection, manifest.made_ms)
        was_empty = postgres.is_empty(connection)
        _refuse(f"the database {url.database}", was_empty, replace, erased, journal)
        with postgres.replacing(connection):
            postgres.restore(connection, url, directory / DATABASE, manifest.tables)
            yield taken.nothing if was_empty else taken.of_postgres(connection)


def _refuse(what: str, is_empty: bool, replace: bool, erased: dict[str, int], journal: list[Erased]) -> None:
    if not is_empty and not replace:
        raise BackendError(f"{what} is not empty: restore into an empty one, or say --replace")
    noted = {each.subject.audited: each.erased_ms for each in sorted(journal, key=lambda each: each.erased_ms)}
    # An older journal of the same name would erase nothing of what came since.
    missing = sorted(each for each, t_ms in erased.items() if noted.get(each, -1) < max(0, t_ms - _MARGIN_MS))
    if missing:
        raise BackendError(
            f"{what} has forgotten since the backup what this would bring back: {', '.join(missing)}. Give --journal, "
            "the file of these erasures, up to the last one"
        )


def _erased_sqlite(path: Path, since_ms: int) -> dict[str, int]:
    if not path.exists():
        return {}
    with contextlib.closing(sqlite3.connect(path)) as opened, contextlib.suppress(sqlite3.OperationalError):
        return dict(opened.execute(_ERASED.format("audit_log", "?"), (since_ms - _MARGIN_MS,)).fetchall())
    return {}


def _erased_postgres(connection: psycopg.Connection[Any], since_ms: int) -> dict[str, int]:
    found: dict[str, int] = {}
    for schema in ("public", postgres.KEPT):  # the latter where a restore was cut off
        with contextlib.suppress(psycopg.errors.UndefinedTable):
            rows = connection.execute(_POSTGRES.format(f"{schema}.audit_log", "%s"), (since_ms - _MARGIN_MS,))
            found |= dict(rows.fetchall())
    return found


def verify(manifest: Manifest, directory: Path, url: URL, name: str) -> None:
    """Restore into a database of its own, compare, and drop it. Raises `BackendError`."""
    if manifest.database == "sqlite":
        with tempfile.TemporaryDirectory(prefix="wonderland-verify-") as scratch:
            sqlite.copy(directory / DATABASE, Path(scratch) / name)
        return
    with (
        postgres.scratch(url, name) as scratch_url,
        postgres.connect(scratch_url) as connection,
        postgres.replacing(connection),
    ):
        postgres.restore(connection, scratch_url, directory / DATABASE, manifest.tables)


def files(manifest: Manifest, directory: Path, to: Path, passphrase: bytes) -> list[Path]:
    """Settings, keys and further databases, below a directory; nothing is replaced. Raises `BackendError`, OSError."""
    if SEALED not in manifest.files:
        raise BackendError(f"{directory} has no settings and keys: it was made without --passphrase-file")
    archive = sealed.unseal((directory / SEALED).read_bytes(), passphrase, manifest.salt, manifest.bound())
    databases = {name: to / each.path.lstrip("/") for name, each in manifest.files.items() if each.path}
    for path in databases.values():
        sealed.refuse_existing(path)
    done = sealed.unpack(archive, to)
    for name, path in databases.items():
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        sqlite.copy(directory / name, path)
    return [*done, *databases.values()]
