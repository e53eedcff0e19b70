"""Flights: what belongs together among the positions that a drone broadcast. Unverified."""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Identifier


class FlightRow(Base):
    """Positions of one drone without a longer pause between two of them."""

    __tablename__ = "flights"
    __table_args__ = (Index(None, "uav_id", "end_ms"), Index(None, "start_ms", "flight_id"), Index(None, "end_ms"))

    flight_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    start_ms: Mapped[int]
    end_ms: Mapped[int]
    positions: Mapped[int]
    south_e7: Mapped[int]
    west_e7: Mapped[int]
    north_e7: Mapped[int]
    east_e7: Mapped[int]
    first_lat_e7: Mapped[int]
    first_lon_e7: Mapped[int]
    last_lat_e7: Mapped[int]
    last_lon_e7: Mapped[int]
