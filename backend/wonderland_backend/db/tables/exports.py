"""Exports that somebody asked for, and how far each has come."""

from __future__ import annotations

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class ExportRow(Base):
    """One export."""

    __tablename__ = "exports"

    export_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    person_id: Mapped[str] = mapped_column(Identifier)
    created_ms: Mapped[int] = mapped_column(index=True)
    query: Mapped[str]
    """JSON: format, window, filters."""
    expected: Mapped[int]
    """About so many rows."""
    state: Mapped[str] = mapped_column(String(16))
    """``prepared``, ``running``, ``done`` or ``broken``."""
    rows: Mapped[int]
    bytes: Mapped[int]
    changed_ms: Mapped[int]
    sha256: Mapped[str | None] = mapped_column(Hash)
    """Of the archive, once it is whole."""
