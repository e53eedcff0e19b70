"""Alerts, what people did with them, and what is to be told outside."""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class AlertRow(Base):
    """Something that an officer must not miss, and what has become of it."""

    __tablename__ = "alerts"
    __table_args__ = (
        Index(None, "state", "t_ms"),
        Index(None, "t_ms", "alert_id"),
        Index(None, "pad_id", "t_ms"),
        Index(None, "uav_id", "t_ms"),
    )

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    kind: Mapped[str] = mapped_column(String(32))
    severity: Mapped[str] = mapped_column(String(16))
    source: Mapped[str]
    t_ms: Mapped[int]
    raised_ms: Mapped[int] = mapped_column(index=True)
    """When it was first shown; `t_ms` is when its cause happened."""
    pad_id: Mapped[str | None] = mapped_column(Identifier)
    uav_id: Mapped[str | None] = mapped_column(Identifier)
    session_id: Mapped[str | None] = mapped_column(Hash)
    tx_id: Mapped[str | None] = mapped_column(Identifier)
    facts: Mapped[str]
    """JSON object: what its text needs."""
    state: Mapped[str] = mapped_column(String(16))
    """``open``, ``acknowledged``, ``over`` (its cause ended by itself), ``returned`` (so, and nobody had seen it)."""
    revision: Mapped[int]
    """Rises with each change; who acts names the one that he has seen."""
    changed_ms: Mapped[int] = mapped_column(index=True)
    acknowledged_by: Mapped[str | None] = mapped_column(Identifier)
    assigned_to: Mapped[str | None] = mapped_column(Identifier)
    snoozed_until_ms: Mapped[int | None]
    over_ms: Mapped[int | None]


class AlertActRow(Base):
    """What somebody did about an alert. Never changed, never deleted."""

    __tablename__ = "alert_acts"

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    revision: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    t_ms: Mapped[int]
    person: Mapped[str] = mapped_column(Identifier)
    act: Mapped[str] = mapped_column(String(16))
    detail: Mapped[str | None] = mapped_column(Identifier)
    """Whom it was assigned to, or until when (ms) it sleeps."""
    note: Mapped[str | None]


class AlertDeliveryRow(Base):
    """An alert that is to be told to somebody outside: by e-mail or webhook, until it has been."""

    __tablename__ = "alert_deliveries"

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    target: Mapped[str] = mapped_column(String(512), primary_key=True)
    attempts: Mapped[int]
    next_ms: Mapped[int | None] = mapped_column(index=True)
    """When to try (again); None when it is delivered or given up."""
    delivered_ms: Mapped[int | None]
    problem: Mapped[str | None]
