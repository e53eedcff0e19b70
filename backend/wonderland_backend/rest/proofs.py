"""Proofs by REST, as JSON or GeoJSON."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend import geojson
from wonderland_backend.access import SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, LedgerAway, NotAcceptable, NotFound, RowsDiffer, documented
from wonderland_backend.languages import HEADER, language_of
from wonderland_backend.ledger.contents import require_committed
from wonderland_backend.mirror.source import BlockSourceDep
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.proofs import queries
from wonderland_backend.proofs.schemas import Proof, ProofFilters, ProofPage
from wonderland_backend.statements import signed

router = APIRouter(tags=["proofs"])
_NOT_FOUND: Final = NotFound(said("no_such_proof"))
ProofId = Annotated[str, Path(pattern="^[0-9a-f]{64}$", description="Transaction id of the request")]
_LANGUAGES: dict[str, Any] = {"parameters": [HEADER]}


@router.get(
    "/proofs",
    response_model=ProofPage,
    responses=documented(BadRequest, OPERATORS_MASKED) | geojson.documented(ProofPage),
    openapi_extra=_LANGUAGES,
)
async def list_proofs(request: Request, context: ContextDep, filters: ProofFilters, person: SignedInPerson) -> Response:
    """Proofs, newest first. As GeoJSON each is a point: the measured place, else the place that was claimed."""
    place = filters.after_place(int, int)
    async with context.database.read() as database:
        rows = await queries.listing(
            database, filters, person.scope, before=(place[0], place[1]) if place is not None else None
        )
    language = language_of(request)
    return geojson.page(
        request,
        ((row, queries.proof_json(row, language)) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.block, row.tx_index),
        id_of=_id,
        geometry_of=_geometry,
        headers={"Content-Language": language},
    )


@router.get(
    "/proofs/{proof_id}",
    response_model=Proof,
    responses=documented(_NOT_FOUND, NotAcceptable, LedgerAway, RowsDiffer)
    | signed.documented(geojson.documented(Proof)),
    openapi_extra=_LANGUAGES,
)
async def read_proof(
    request: Request,
    context: ContextDep,
    proof_id: ProofId,
    person: SignedInPerson,
    statements: signed.WantedStatements,
    source: BlockSourceDep,
) -> Response:
    """One proof. Its evidence, step by step, is `/sessions/{session_id}` with the same id.

    As `application/jose` this server signs the answer, so that it can be shown to others (docs/api/statements.md).
    """
    async with context.database.read() as database:
        row = await queries.find_proof(database, proof_id, person.scope)
    if row is None:
        raise NotFound(said("no_such_proof"))
    language = language_of(request)
    if statements is not None:
        await require_committed(source, row)
        return await statements.answer("proof", queries.proof_json(row, language), context.clock())
    return geojson.one(
        request,
        queries.proof_json(row, language),
        id_of=_id,
        geometry_of=_geometry,
        headers={"Content-Language": language},
    )


def _id(item: geojson.Item) -> str:
    return str(item["proof_id"])


def _geometry(item: geojson.Item) -> geojson.Geometry:
    claimed = item.get("signed") or item.get("broadcast") or {}
    return geojson.point(item.get("measured") or claimed.get("place"))
