"""That somebody has asked for a proof. Whether it came about is on the ledger, and read there."""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Identifier


class ProofRequestRow(Base):
    """A drone is to prove itself at a pad. It has to ask on the ledger itself; this is what its agent is told."""

    __tablename__ = "proof_requests"
    __table_args__ = (Index(None, "uav_id", "created_ms"), Index(None, "created_ms", "request_id"))

    request_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    action: Mapped[str] = mapped_column(String(16))
    requested_by: Mapped[str] = mapped_column(Identifier)
    """A person's or a client's id."""
    note: Mapped[str]
    created_ms: Mapped[int]
    expires_ms: Mapped[int] = mapped_column(index=True)
    told_ms: Mapped[int | None]
    """When the drone's agent was told."""
    accepted: Mapped[bool | None]
    """What the agent answered."""
    answer: Mapped[str | None]
    cancelled_ms: Mapped[int | None]
