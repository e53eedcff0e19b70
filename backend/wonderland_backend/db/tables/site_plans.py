"""Files of site plans, by their hash; which of them holds is on the ledger."""

from __future__ import annotations

from sqlalchemy import LargeBinary
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class SitePlanRow(Base):
    """One file that somebody brought for a pad."""

    __tablename__ = "site_plans"

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    stored_ms: Mapped[int]
    body: Mapped[bytes] = mapped_column(LargeBinary)
