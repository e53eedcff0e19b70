"""Reading proofs from the database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import orjson
from sqlalchemy import select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.messages import Language
from wonderland_backend.db.tables.ledger import VerdictRow
from wonderland_backend.narrowing import narrowed
from wonderland_backend.person import Scope
from wonderland_backend.proofs.reasons import reasons_in
from wonderland_backend.proofs.schemas import HeightFound, ProofQuery

_SAME: Final = (
    "uav_id", "pad_id", "action", "decided_ms", "outcome", "permission", "authorised", "assurance", "rounds",
    "buffer_mm", "covariance", "evidence_sha256",
)  # fmt: skip
_HEARD: Final = (
    "outcome", "messages", "attributed", "supported", "error_mm", "likelihood_ppm", "tolerance_mm",
)  # fmt: skip
_FORMER: Final[Mapping[str, dict[str, Any]]] = {
    "verified": {"outcome": "supported", "supported": True},
    "refuted": {"outcome": "contradicted", "supported": False},
    "inconclusive": {"outcome": "undecided", "supported": False},
}
"""What former contracts said of the one broadcast that they judged."""
_PLACE: Final = ("lat_e7", "lon_e7", "height_mm")


def proof_json(row: VerdictRow, language: Language) -> dict[str, Any]:
    """The Proof of a verdict's row."""
    record = orjson.loads(row.record)
    proof: dict[str, Any] = {"proof_id": row.session_id}
    proof |= {name: record[name] for name in _SAME if name in record}
    if "estimate" in record:
        proof["measured"] = _place(record["estimate"])
    if "signed" in record:
        proof["signed"] = _judged(record["signed"], language)
    if "height" in record:
        proof["height"] = {name: record["height"][name] for name in HeightFound.model_fields}
    if "broadcast" in record:
        proof["broadcast"] = heard(record["broadcast"])
    proof["reasons"] = reasons_in(language, record["reasons"])
    return proof | {"tx_id": row.tx_id, "block": row.block, "tx_index": row.tx_index}


async def find_proof(database: AsyncSession, proof_id: str, scope: Scope) -> VerdictRow | None:
    """One proof, if it is within the scope."""
    query = select(VerdictRow).where(VerdictRow.session_id == proof_id)
    query = scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    return (await database.scalars(query)).first()


async def listing(
    database: AsyncSession, filters: ProofQuery, scope: Scope, *, before: tuple[int, int] | None
) -> Sequence[VerdictRow]:
    """Proofs, newest first, one more than `filters.limit`. `before` (block, tx_index) is the last of the page before.

    Raises `BadRequest` for a box with too many pads.
    """
    query = select(VerdictRow).order_by(VerdictRow.block.desc(), VerdictRow.tx_index.desc()).limit(filters.limit + 1)
    query = scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    if before is not None:
        query = query.where(tuple_(VerdictRow.block, VerdictRow.tx_index) < before)
    query = await narrowed(database, query, filters, scope, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    if filters.outcome is not None:
        query = query.where(VerdictRow.outcome == filters.outcome)
    if filters.since_ms is not None:
        query = query.where(VerdictRow.decided_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(VerdictRow.decided_ms <= filters.until_ms)
    return (await database.scalars(query)).all()


def _judged(record: dict[str, Any], language: Language) -> dict[str, Any]:
    return {
        "outcome": record["outcome"],
        "place": _place(record["claim"]),
        "error_mm": record["error_mm"],
        "likelihood_ppm": record["likelihood_ppm"],
        "reasons": reasons_in(language, record["reasons"]),
    }


def heard(record: dict[str, Any]) -> dict[str, Any]:
    """The BroadcastHeard of a verdict's finding."""
    former = _FORMER.get(record["outcome"])
    if former is not None:
        record = record | former | {"messages": 1, "attributed": 0}
    known = {name: record[name] for name in _HEARD if name in record}
    return known | ({"place": _place(record["claim"])} if "claim" in record else {})


def _place(record: dict[str, Any]) -> dict[str, Any]:
    return {name: record[name] for name in _PLACE}
