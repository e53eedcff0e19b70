"""Whose a pad or a drone is that connects."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import DroneRow, PadRow


async def owner_of_pad(session: AsyncSession, pad_id: str) -> str | None:
    """Its organisation; None of one that the ledger does not have (yet)."""
    return (await session.scalars(select(PadRow.msp_id).where(PadRow.pad_id == pad_id))).one_or_none()


async def owner_of_drone(session: AsyncSession, uav_id: str) -> str | None:
    """As `owner_of_pad`."""
    return (await session.scalars(select(DroneRow.msp_id).where(DroneRow.uav_id == uav_id))).one_or_none()
