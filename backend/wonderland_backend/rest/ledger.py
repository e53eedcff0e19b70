"""Blocks, transactions, status, health and metrics by REST."""

from __future__ import annotations

import hmac
from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import SIGNED_IN, Officer, SignedInPerson, person_of
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BINARY, BadRequest, Forbidden, LedgerAway, NotFound, documented
from wonderland_backend.filters import Paging
from wonderland_backend.ledger import contents, queries
from wonderland_backend.ledger.schemas import (
    Alive,
    BlockPage,
    LedgerBlockDetail,
    LedgerTransactionDetail,
    Status,
    TransactionContents,
)
from wonderland_backend.live.hub import HubDep
from wonderland_backend.masking import shown_json
from wonderland_backend.metrics import CONTENT_TYPE, MetricsDep
from wonderland_backend.mirror.source import BlockSourceDep
from wonderland_backend.responses import Json, page, resource

router = APIRouter(tags=["ledger"], dependencies=SIGNED_IN)
public = APIRouter(tags=["server"])
MAX_BLOCK = 2**53


@public.get("/health", response_model=Alive)
async def read_health() -> Response:
    """Says that the server answers; needs no sign-in and gives no data."""
    return Json({"status": "ok"}, headers={"Cache-Control": "no-store"})


@public.get(
    "/metrics",
    response_class=Response,
    responses=documented()
    | {200: {"content": {"text/plain": {"schema": {"type": "string"}, "example": "wonderland_mirror_block 1042\n"}}}},
    openapi_extra={"security": [{"person": []}, {"metrics": []}]},
)
async def read_metrics(request: Request, context: ContextDep, metrics: MetricsDep) -> Response:
    """Metrics in Prometheus's text format, for whoever is signed in or bears the metrics token."""
    expected = context.settings.metrics_bearer()
    given = request.headers.get("authorization", "").removeprefix("Bearer ")
    if expected is None or not hmac.compare_digest(given.encode(), expected.encode()):
        await person_of(request)
    return Response(metrics.exposition(), media_type=CONTENT_TYPE, headers={"Cache-Control": "no-store"})


@router.get("/status", response_model=Status, responses=documented())
async def read_status(context: ContextDep, hub: HubDep, person: SignedInPerson) -> Response:
    """Which ledger this is, how far its mirror has come, how much there is, and which outputs are on."""
    status = hub.board.status()
    status["server"] = status["server"] | {"outputs": context.settings.outputs.switches()}
    if not person.scope.everything:
        del status["counts"]
    return Json(status, headers={"Cache-Control": "private, no-store"})


@router.get("/blocks", response_model=BlockPage, responses=documented(BadRequest, etag=True))
async def list_blocks(request: Request, context: ContextDep, paging: Paging) -> Response:
    """Blocks, newest first."""
    before = paging.after_key(int)
    async with context.database.read() as database:
        rows = await queries.blocks(database, before=before, limit=paging.limit + 1)
    return page(
        request, ((row, queries.shown_block(row)) for row in rows), paging.limit, cursor_of=lambda row: (row.number,)
    )


@router.get("/blocks/{number}", response_model=LedgerBlockDetail, responses=documented(NotFound, etag=True))
async def read_block(
    request: Request, context: ContextDep, person: SignedInPerson, number: Annotated[int, Path(ge=0, le=MAX_BLOCK)]
) -> Response:
    """A block with its transactions."""
    async with context.database.read() as database:
        row = await queries.block(database, number)
        if row is None:
            raise NotFound(said("no_such_block", block=number))
        items = await queries.transactions_of(database, person, number)
    return resource(request, queries.shown_block(row) | {"items": items})


@router.get(
    "/blocks/{number}/data",
    response_class=Response,
    responses=documented(Forbidden, NotFound, LedgerAway)
    | {200: {"content": {"application/octet-stream": {"schema": BINARY}}}},
)
async def read_block_data(
    context: ContextDep, source: BlockSourceDep, person: Officer, number: Annotated[int, Path(ge=0, le=MAX_BLOCK)]
) -> Response:
    """The block's transactions as bytes: their SHA-256 is the header's `data_hash`. Read from the ledger itself.

    These are what was signed, to the last byte: nothing is masked, so that they are for officers only, and audited.
    """
    async with context.database.read() as database:
        if await queries.block(database, number) is None:
            raise NotFound(said("no_such_block", block=number))
    block = await contents.fetch_block(source, number)
    async with context.database.write() as connection:
        await audit.record(connection, person, "read_contents", f"block/{number}", t_ms=context.clock())
    headers = {"Cache-Control": "private, max-age=86400, immutable"}
    return Response(b"".join(block.envelopes), media_type="application/octet-stream", headers=headers)


@router.get(
    "/transactions/{tx_id}/contents",
    response_model=TransactionContents,
    responses=documented(Forbidden, NotFound, LedgerAway, etag=True),
)
async def read_transaction_contents(
    request: Request,
    context: ContextDep,
    source: BlockSourceDep,
    person: SignedInPerson,
    tx_id: Annotated[str, Path(pattern=r"^[0-9a-f]{64}$", description="SHA-256, hexadecimal")],
) -> Response:
    """Arguments, reads, writes and endorsements of a transaction, read from the ledger itself.

    Numbers of operators are masked in it as everywhere (`masked`); the bytes of the block have them.
    """
    async with context.database.read() as database:
        found = await queries.transaction(database, tx_id, person)
    if found is None:
        raise NotFound(said("no_such_transaction"))
    row, _ = found
    if not queries.sees_contents(row, person):
        raise Forbidden(said("transaction_not_yours"))
    block = await contents.fetch_block(source, row.block)
    async with context.database.write() as connection:
        subject = f"transaction/{tx_id}"
        await audit.record(connection, person, "read_contents", subject, tx_id=tx_id, t_ms=context.clock())
    shown = contents.transaction_contents(block, row.tx_index, lambda text: shown_json(text, person, row.creator_msp))
    return resource(request, shown)


@router.get("/transactions/{tx_id}", response_model=LedgerTransactionDetail, responses=documented(NotFound, etag=True))
async def read_transaction(
    request: Request,
    context: ContextDep,
    person: SignedInPerson,
    tx_id: Annotated[str, Path(pattern=r"^[0-9a-f]{64}$", description="SHA-256, hexadecimal")],
) -> Response:
    """A transaction, valid or refused."""
    async with context.database.read() as database:
        found = await queries.transaction(database, tx_id, person)
    if found is None:
        raise NotFound(said("no_such_transaction"))
    row, event = found
    shown = queries.shown_transaction(row, event)
    if event is not None and queries.sees_contents(row, person):
        shown["event_payload"] = shown_json(event.payload, person, row.creator_msp)
    return resource(request, shown)
