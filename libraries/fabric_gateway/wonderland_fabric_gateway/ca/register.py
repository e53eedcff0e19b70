"""The CA's memory: every certificate it issued, which are revoked, and its current revocation lists.

SQLite with synchronous=FULL, opened for each operation: what was answered survives a power cut, and two processes
take turns. A revocation and the list that carries it are written in one transaction.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.ca.application import Kind
from wonderland_fabric_gateway.ca.errors import CaBusyError, CaCorruptError, CaStorageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

BUSY_TIMEOUT_S: Final = 10.0
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS certificates (
  serial TEXT PRIMARY KEY, kind TEXT NOT NULL, name TEXT NOT NULL, node_ou TEXT NOT NULL, attributes TEXT NOT NULL,
  hosts TEXT NOT NULL, not_before_ms INTEGER NOT NULL, not_after_ms INTEGER NOT NULL, pem BLOB NOT NULL,
  issued INTEGER NOT NULL UNIQUE, revoked_ms INTEGER, reason TEXT
) STRICT;
CREATE INDEX IF NOT EXISTS certificates_by_name ON certificates (kind, name, issued);
CREATE INDEX IF NOT EXISTS certificates_revoked ON certificates (kind, revoked_ms) WHERE revoked_ms IS NOT NULL;
CREATE TABLE IF NOT EXISTS revocation_lists (
  kind TEXT PRIMARY KEY, number INTEGER NOT NULL, next_update_ms INTEGER NOT NULL, pem BLOB NOT NULL
) STRICT;
"""
_INVITATIONS: Final = """
CREATE TABLE IF NOT EXISTS invitations (
  name TEXT PRIMARY KEY, secret_sha256 TEXT NOT NULL, attributes TEXT NOT NULL, validity_s INTEGER NOT NULL,
  expires_ms INTEGER NOT NULL, failures INTEGER NOT NULL
) STRICT
"""
"""Made when first written to: registers of earlier versions lack it."""
_COLUMNS: Final = (
    "serial, kind, name, node_ou, attributes, hosts, not_before_ms, not_after_ms, pem, issued, revoked_ms, reason"
)


@dataclass(frozen=True, slots=True)
class IssuedCertificate:
    """A certificate as the register knows it. `serial` is lower-case hex; `revoked_ms` None while it stands."""

    serial: str
    kind: Kind
    name: str
    node_ou: str
    attributes: Mapping[str, str]
    hosts: tuple[str, ...]
    not_before_ms: int
    not_after_ms: int
    pem: bytes
    revoked_ms: int | None = None
    reason: str = ""

    def is_active(self, now_ms: int) -> bool:
        """Neither revoked nor expired."""
        return self.revoked_ms is None and now_ms <= self.not_after_ms


@dataclass(frozen=True, slots=True)
class RevocationList:
    """A current revocation list, PEM."""

    number: int
    next_update_ms: int
    pem: bytes


@dataclass(frozen=True, slots=True)
class Invitation:
    """What a name may be enrolled with, once, by whoever has the secret; only its hash is kept."""

    name: str
    secret_sha256: str
    attributes: Mapping[str, str]
    validity_s: int
    expires_ms: int
    failures: int = 0


class Register:
    """One open transaction on the register; see `open_register`."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database

    def add(self, certificate: IssuedCertificate) -> None:
        """Record a certificate, before anybody is given it."""
        self._database.execute(
            f"INSERT INTO certificates ({_COLUMNS}) SELECT ?,?,?,?,?,?,?,?,?,"  # noqa: S608 - our own column names
            " coalesce(max(issued), 0) + 1, ?, ? FROM certificates",
            (
                certificate.serial,
                certificate.kind,
                certificate.name,
                certificate.node_ou,
                json.dumps(dict(certificate.attributes)),
                json.dumps(certificate.hosts),
                certificate.not_before_ms,
                certificate.not_after_ms,
                certificate.pem,
                certificate.revoked_ms,
                certificate.reason or None,
            ),
        )

    def certificates(self, name: str | None = None, kind: Kind | None = None) -> tuple[IssuedCertificate, ...]:
        """Certificates, oldest first, perhaps only those of a name or a kind."""
        return self._select("(?1 IS NULL OR name = ?1) AND (?2 IS NULL OR kind = ?2)", (name, kind))

    def by_serial(self, serial: str) -> IssuedCertificate | None:
        """The certificate with that serial number (lower-case hex)."""
        found = self._select("serial = ?1", (serial,))
        return found[0] if found else None

    def revoked(self, kind: Kind) -> tuple[IssuedCertificate, ...]:
        """The revoked certificates of a kind."""
        return self._select("kind = ?1 AND revoked_ms IS NOT NULL", (kind,))

    def revoke(self, serial: str, revoked_ms: int, reason: str) -> None:
        """Mark a certificate as revoked."""
        statement = "UPDATE certificates SET revoked_ms = ?, reason = ? WHERE serial = ? AND revoked_ms IS NULL"
        self._database.execute(statement, (revoked_ms, reason, serial))

    def revocation_list(self, kind: Kind) -> RevocationList | None:
        """The current list of a kind."""
        statement = "SELECT number, next_update_ms, pem FROM revocation_lists WHERE kind = ?"
        row = self._database.execute(statement, (kind,)).fetchone()
        return None if row is None else RevocationList(*row)

    def set_revocation_list(self, kind: Kind, current: RevocationList) -> None:
        """Replace the current list of a kind."""
        self._database.execute(
            "INSERT OR REPLACE INTO revocation_lists (kind, number, next_update_ms, pem) VALUES (?,?,?,?)",
            (kind, current.number, current.next_update_ms, current.pem),
        )

    def invite(self, invitation: Invitation) -> None:
        """Keep an invitation, in place of an earlier one to the same name."""
        self._database.execute(_INVITATIONS)
        self._database.execute(
            "INSERT OR REPLACE INTO invitations VALUES (?,?,?,?,?,?)",
            (
                invitation.name,
                invitation.secret_sha256,
                json.dumps(dict(invitation.attributes)),
                invitation.validity_s,
                invitation.expires_ms,
                invitation.failures,
            ),
        )

    def invitation(self, name: str) -> Invitation | None:
        """The invitation to a name."""
        self._database.execute(_INVITATIONS)
        row = self._database.execute("SELECT * FROM invitations WHERE name = ?", (name,)).fetchone()
        if row is None:
            return None
        return Invitation(row[0], row[1], json.loads(row[2]), row[3], row[4], row[5])

    def end_invitation(self, name: str) -> None:
        """It was used, or is no longer good."""
        self._database.execute("DELETE FROM invitations WHERE name = ?", (name,))

    def _select(self, where: str, values: tuple[str | None, ...]) -> tuple[IssuedCertificate, ...]:
        statement = f"SELECT {_COLUMNS} FROM certificates WHERE {where} ORDER BY issued"  # noqa: S608 - our own text
        return tuple(_certificate(row) for row in self._database.execute(statement, values))


def _certificate(row: tuple[Any, ...]) -> IssuedCertificate:
    try:
        return IssuedCertificate(
            serial=row[0],
            kind=Kind(row[1]),
            name=row[2],
            node_ou=row[3],
            attributes=json.loads(row[4]),
            hosts=tuple(json.loads(row[5])),
            not_before_ms=row[6],
            not_after_ms=row[7],
            pem=row[8],
            revoked_ms=row[10],
            reason=row[11] or "",
        )
    except (ValueError, TypeError) as cause:
        raise CaCorruptError(f"the register's entry {row[0]!r} cannot be read; restore the CA from a backup") from cause


@contextlib.contextmanager
def open_register(path: Path, *, write: bool, timeout_s: float = BUSY_TIMEOUT_S) -> Iterator[Register]:
    """The register within one transaction: committed when the block ends well, undone when it raises.

    A writing transaction excludes every other one, also of other processes, from its beginning. Raises
    `CaBusyError`, `CaStorageError`, `CaCorruptError`.
    """
    try:
        with contextlib.closing(sqlite3.connect(path, timeout=timeout_s, isolation_level=None)) as database:
            database.execute("PRAGMA synchronous = FULL")
            database.execute("BEGIN IMMEDIATE" if write else "BEGIN")
            try:
                yield Register(database)
            except BaseException:
                if database.in_transaction:  # a full disk may have ended it already
                    database.execute("ROLLBACK")
                raise
            database.execute("COMMIT")
    except sqlite3.OperationalError as cause:
        if cause.sqlite_errorcode & 0xFF in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
            raise CaBusyError(f"{path}: another process has held it for {timeout_s:g} s; try again") from cause
        raise CaStorageError(f"{path}: {cause}") from cause
    except sqlite3.DatabaseError as cause:
        raise CaCorruptError(f"{path}: {cause}; restore the CA's directory from a backup") from cause


def create_register(path: Path) -> None:
    """Make an empty register, readable by its owner only. Raises `CaStorageError`."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as database:
            database.execute("PRAGMA synchronous = FULL")
            database.executescript(_SCHEMA)
    except (OSError, sqlite3.Error) as cause:
        raise CaStorageError(f"{path}: {cause}") from cause


def milliseconds(moment: datetime) -> int:
    """Milliseconds since the Unix epoch of an aware datetime."""
    return round(moment.timestamp() * 1000)


def moment(t_ms: int) -> datetime:
    """The aware UTC datetime, whole seconds as X.509 has them."""
    return datetime.fromtimestamp(t_ms // 1000, UTC)
