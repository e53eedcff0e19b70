"""Zones (geo-awareness): data sets as they were imported, each one replacing its source's last, and their zones."""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class ZoneSetRow(Base):
    """One import. Of each source the one with ``replaced_ms`` NULL holds; the others are history."""

    __tablename__ = "zone_sets"
    __table_args__ = (
        Index(None, "source", "imported_ms"),
        Index(None, "imported_ms", "import_id"),
        Index("uq_zone_sets_current", "current", unique=True),
    )

    import_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    source: Mapped[str] = mapped_column(String(64))
    current: Mapped[str | None] = mapped_column(String(64))
    """The source, while it holds: no two sets of one source can."""
    format: Mapped[str] = mapped_column(String(16))
    """``ed318`` or ``ed269``."""
    file_sha256: Mapped[str] = mapped_column(Hash)
    size_bytes: Mapped[int]
    zones: Mapped[int]
    notices: Mapped[str]
    """JSON: what was repaired or left out, with lines."""
    about: Mapped[str]
    """JSON: the collection's own members (title, metadata), for the export."""
    imported_ms: Mapped[int]
    imported_by: Mapped[str] = mapped_column(Identifier)
    replaced_ms: Mapped[int | None]


class ZoneRow(Base):
    """A zone of an import: its ED-318 feature, and what is asked of it most."""

    __tablename__ = "zones"
    __table_args__ = (Index(None, "zone_id"), Index(None, "south", "north"))

    import_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    zone_id: Mapped[str] = mapped_column(String(16), primary_key=True)
    type: Mapped[str] = mapped_column(String(24))
    country: Mapped[str] = mapped_column(String(3))
    west: Mapped[int]
    """Degrees × 10⁷, as the other edges of its box."""
    south: Mapped[int]
    east: Mapped[int]
    north: Mapped[int]
    feature: Mapped[str]
    """JSON (ED-318), as it was brought to it."""
