"""Operators' registration numbers: what opens the commitments that the ledger has. Not derived from any block."""

from __future__ import annotations

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class RegistrationNumberRow(Base):
    """A number with its salt. It is its drone's only while it opens the commitment in the ledger's record."""

    __tablename__ = "registration_numbers"

    commitment: Mapped[str] = mapped_column(Hash, primary_key=True)
    uav_id: Mapped[str] = mapped_column(String(40), index=True)
    number: Mapped[str] = mapped_column(String(32))
    salt: Mapped[str] = mapped_column(Hash)
    stored_ms: Mapped[int]
    stored_by: Mapped[str] = mapped_column(Identifier)
    """A person's id, or what it was that stored it."""
    tx_id: Mapped[str | None] = mapped_column(Hash, index=True)
    """The transaction that it waits for, and goes with if that comes to nothing; None: it stays."""
