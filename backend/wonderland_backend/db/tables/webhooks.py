"""Webhooks that others have asked for, and what is to be delivered to them."""

from __future__ import annotations

from sqlalchemy import ForeignKey, Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Identifier

SubscriptionId = String(32)


class SubscriptionRow(Base):
    """Somebody wants to be told. `block` and `tx_index`: up to there deliveries have been made of events."""

    __tablename__ = "subscriptions"
    __table_args__ = (Index(None, "state", "block"),)

    subscription_id: Mapped[str] = mapped_column(SubscriptionId, primary_key=True)
    owner: Mapped[str] = mapped_column(Identifier, index=True)
    """A person's or a client's id."""
    name: Mapped[str] = mapped_column(Identifier)
    url: Mapped[str] = mapped_column(String(512))
    secret: Mapped[str] = mapped_column(Identifier)
    """Signs what is sent: both sides need it, so that no hash would do."""
    filter: Mapped[str]
    """JSON: types, pads, drones, outcomes."""
    state: Mapped[str] = mapped_column(String(16))
    """``active`` or ``paused``."""
    block: Mapped[int]
    tx_index: Mapped[int]
    created_ms: Mapped[int]


class DeliveryRow(Base):
    """One message to one subscriber, until it has arrived or was given up."""

    __tablename__ = "webhook_deliveries"
    __table_args__ = (Index(None, "subscription_id", "created_ms", "delivery_id"),)

    delivery_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    subscription_id: Mapped[str] = mapped_column(
        SubscriptionId, ForeignKey("subscriptions.subscription_id", ondelete="CASCADE")
    )
    event_id: Mapped[str] = mapped_column(Identifier)
    type: Mapped[str] = mapped_column(Identifier)
    body: Mapped[str]
    created_ms: Mapped[int] = mapped_column(index=True)
    attempts: Mapped[int]
    next_ms: Mapped[int | None] = mapped_column(index=True)
    """When to try (again); None when it is delivered or given up."""
    delivered_ms: Mapped[int | None]
    status: Mapped[int | None]
    """What was answered last."""
    problem: Mapped[str | None]
