"""Whom a request is about, and what was erased, as lines of a file that outlives the database's backups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

from wonderland_backend.errors import BackendError

Kind = Literal["drone", "account"]


@dataclass(frozen=True)
class Subject:
    """A drone, with what is known of its operator, by serial number; or an account by its id."""

    kind: Kind
    id: str

    @property
    def audited(self) -> str:
        """As the audit log names it."""
        return f"{'drone' if self.kind == 'drone' else 'person'}/{self.id}"


@dataclass(frozen=True)
class Erased:
    """One erasure, to be done again on a database that was restored from before it.

    Nothing in it is secret or more than the ledger and the audit log have: serial number or account id, when, and the
    commitments whose numbers went.
    """

    subject: Subject
    erased_ms: int
    commitments: tuple[str, ...] = ()

    def line(self) -> bytes:
        """A line of the journal."""
        return msgspec.json.encode(_Line(self.subject.kind, self.subject.id, self.erased_ms, self.commitments)) + b"\n"


class _Line(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    kind: Kind
    id: str
    erased_ms: int
    commitments: tuple[str, ...] = ()


def journal(data: bytes) -> list[Erased]:
    """The erasures of a journal. Raises `BackendError` with the line that is none."""
    found = []
    for number, line in enumerate(data.splitlines(), 1):
        try:
            its = msgspec.json.decode(line, type=_Line)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise BackendError(f"--journal: line {number}: {error}; nothing was erased anew") from None
        found.append(Erased(Subject(its.kind, its.id), its.erased_ms, its.commitments))
    return found
