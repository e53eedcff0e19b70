"""The audit log. Triggers refuse every change and deletion of its rows (migration 0004)."""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class AuditRow(Base):
    """What somebody did or read. Each row's hash covers the hash of the row before."""

    __tablename__ = "audit_log"
    __table_args__ = (
        Index(None, "person_id", "seq"),
        Index(None, "act", "seq"),
        Index(None, "subject", "seq"),
        Index(None, "t_ms"),
        Index(None, "tx_id"),
    )

    seq: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    t_ms: Mapped[int]
    person_id: Mapped[str] = mapped_column(String(32))
    """Empty where nobody was signed in."""
    person: Mapped[str] = mapped_column(Identifier)
    act: Mapped[str] = mapped_column(String(48))
    subject: Mapped[str] = mapped_column(String(256))
    """What it was done to: ``kind/id``."""
    detail: Mapped[str]
    """Canonical JSON object."""
    tx_id: Mapped[str | None] = mapped_column(Identifier)
    previous_sha256: Mapped[str] = mapped_column(Hash)
    sha256: Mapped[str] = mapped_column(Hash)


class AuditStreamRow(Base):
    """Up to which row the log was sent to a destination."""

    __tablename__ = "audit_stream"

    destination: Mapped[str] = mapped_column(String(256), primary_key=True)
    seq: Mapped[int]
