"""Reading pads from the database."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import orjson
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.errors import ProofError
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.pads import Pad
from wonderland_backend.db.tables.ledger import PadRow
from wonderland_backend.db.tables.reported import HealthRow
from wonderland_backend.narrowing import field
from wonderland_backend.person import Scope
from wonderland_backend.responses import record


def pad_json(pad_record: str, health_body: str | None, *, connected: bool) -> Any:
    """The Pad of the interfaces: record, anchors on the globe, and how the pad says that it is."""
    health = None
    if health_body is not None:
        health = record(health_body, connected=connected)
    return record(pad_record, anchors=orjson.Fragment(anchors(pad_record)), health=health)


@lru_cache(maxsize=4096)
def anchors(pad_record: str) -> str:
    """Where a pad's anchors stand, as JSON; empty without a commissioning that can be read."""
    found: list[dict[str, Any]] = []
    try:
        commissioning = Pad.decode(pad_record).commissioning
        for each in commissioning.anchors if commissioning is not None else ():
            assert commissioning is not None
            lat_e7, lon_e7, _ = to_wgs84(commissioning.frame, each.east_mm, each.north_mm, each.up_mm)
            found.append(
                {
                    "anchor_id": each.anchor_id,
                    "lat_e7": lat_e7,
                    "lon_e7": lon_e7,
                    "east_mm": each.east_mm,
                    "north_mm": each.north_mm,
                    "up_mm": each.up_mm,
                }
            )
    except ProofError:
        # A record of a later contract, or a frame that reaches nowhere: the pad is shown without anchors.
        return "[]"
    return orjson.dumps(found).decode()


async def listing(
    database: AsyncSession,
    scope: Scope,
    *,
    after: str | None = None,
    limit: int,
    operator: str | None = None,
    within: Sequence[str] | None = None,
) -> Sequence[PadRow]:
    """Pads by identifier; of an operator, and among those that are named, where they are."""
    query = scope.narrow(select(PadRow).order_by(PadRow.pad_id).limit(limit), pad=PadRow.pad_id)
    if after is not None:
        query = query.where(PadRow.pad_id > after)
    if operator is not None:
        query = query.where(PadRow.record.contains(field("operator_id", operator), autoescape=True))
    if within is not None:
        query = query.where(PadRow.pad_id.in_(within))
    return (await database.scalars(query)).all()


async def find_pad(database: AsyncSession, scope: Scope, pad_id: str) -> PadRow | None:
    """The pad's row; None for one that the ledger does not know, or that is not theirs to see."""
    query = scope.narrow(select(PadRow).where(PadRow.pad_id == pad_id), pad=PadRow.pad_id)
    return (await database.scalars(query)).first()


async def health_of(database: AsyncSession, pad_ids: Sequence[str]) -> dict[str, str]:
    """The last health reports of these pads, as JSON texts."""
    query = select(HealthRow).where(HealthRow.agent == "pad", HealthRow.agent_id.in_(pad_ids))
    return {row.agent_id: row.body for row in await database.scalars(query)}
