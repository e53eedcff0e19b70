"""Asking for a proof by REST."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import SignedInPerson, require
from wonderland_backend.agents.connected import Agents, AgentsDep
from wonderland_backend.clients import idempotency
from wonderland_backend.clients.machines import METHOD
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.drones import queries as drones
from wonderland_backend.errors import BadRequest, Conflict, Forbidden, NotFound, Unprocessable, documented
from wonderland_backend.pads import queries as pads
from wonderland_backend.person import ALL, Person
from wonderland_backend.proof_requests import route, store
from wonderland_backend.proof_requests.schemas import (
    NewProofRequest,
    ProofRequest,
    ProofRequestFilters,
    ProofRequestPage,
)
from wonderland_backend.responses import Json, page, resource
from wonderland_backend.webhooks import store as webhooks

router = APIRouter(tags=["proof requests"])
_NOT_FOUND: Final = NotFound(said("no_such_request"))
_SETTLED: Final = Conflict(said("request_settled", state="fulfilled"))
RequestId = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
NO_STORE: Final = {"Cache-Control": "private, no-store"}
_ONCE: Final[dict[str, Any]] = {"parameters": [idempotency.PARAMETER]}


@router.post(
    "/proof-requests",
    status_code=201,
    response_model=ProofRequest,
    responses=documented(
        idempotency.BAD_KEY,
        Forbidden,
        NotFound(said("no_such_drone", uav_id="OH-DRN-0417")),
        idempotency.BUSY,
        Unprocessable,
    ),
    openapi_extra=_ONCE,
)
async def add_proof_request(
    request: Request, context: ContextDep, agents: AgentsDep, body: NewProofRequest, person: SignedInPerson
) -> Response:
    """Ask that a drone proves its location at a pad.

    Nobody can prove a drone against its will: its agent has to ask on the ledger. It is told at once where it is
    connected, else when it next is; subscribers to `proof_request.created` are told, too.
    """
    if person.method != METHOD:
        require(person, "admin", "inspector", "pad_operator", "fleet_operator")
    return await idempotency.once(request, person, lambda: _add(context, agents, body, person))


async def _add(context: Context, agents: Agents, body: NewProofRequest, person: Person) -> Response:
    now = context.clock()
    async with context.database.read() as database:
        await _check_visible(database, body, person)
    row: dict[str, Any] = {
        "request_id": context.randomness(16).hex(),
        "uav_id": body.uav_id,
        "pad_id": body.pad_id,
        "action": body.action,
        "requested_by": person.person_id,
        "note": body.note,
        "created_ms": now,
        "expires_ms": now + body.valid_s * 1000,
        "told_ms": None,
        "accepted": None,
        "answer": None,
        "cancelled_ms": None,
    }
    async with context.database.read() as database:
        deliveries = await route.deliveries_of(database, row, now)
    async with context.database.write() as connection:
        await store.add(connection, row)
        await webhooks.add_deliveries(connection, deliveries)
        detail = {"uav_id": body.uav_id, "pad_id": body.pad_id, "action": body.action}
        subject = f"proof-request/{row['request_id']}"
        await audit.record(connection, person, "request_proof", subject, detail, t_ms=now)
    await route.tell_agent(context, agents, body.uav_id)
    async with context.database.read() as database:
        found = await store.find_request(database, row["request_id"], ALL)
        assert found is not None
        content = await store.request_json(database, found, now)
    return Json(content, 201, NO_STORE | {"Location": f"/api/v1/proof-requests/{row['request_id']}"})


async def _check_visible(database: AsyncSession, body: NewProofRequest, person: Person) -> None:
    """Both have to be registered, and one of them the asker's, who may see not all. Raises `NotFound`."""
    theirs = (
        await drones.find_drone(database, person.scope, body.uav_id),
        await pads.find_pad(database, person.scope, body.pad_id),
    )
    if not any(theirs) or await drones.find_drone(database, ALL, body.uav_id) is None:
        raise NotFound(said("no_such_drone", uav_id=body.uav_id))
    if await pads.find_pad(database, ALL, body.pad_id) is None:
        raise NotFound(said("no_such_pad", pad_id=body.pad_id))


@router.get("/proof-requests", response_model=ProofRequestPage, responses=documented(BadRequest, etag=True))
async def list_proof_requests(
    request: Request, context: ContextDep, filters: ProofRequestFilters, person: SignedInPerson
) -> Response:
    """Requests for proofs, newest first."""
    place = filters.after_place(int, str)
    async with context.database.read() as database:
        rows = await store.listing(database, filters, person.scope, before=(place[0], place[1]) if place else None)
        items = [(row, await store.request_json(database, row, context.clock())) for row in rows]
    return page(request, items, filters.limit, cursor_of=lambda row: (row.created_ms, row.request_id))


@router.get("/proof-requests/{request_id}", response_model=ProofRequest, responses=documented(_NOT_FOUND, etag=True))
async def read_proof_request(
    request: Request, context: ContextDep, request_id: RequestId, person: SignedInPerson
) -> Response:
    """What has become of a request."""
    async with context.database.read() as database:
        row = await store.find_request(database, request_id, person.scope)
        if row is None:
            raise NotFound(said("no_such_request"))
        content = await store.request_json(database, row, context.clock())
    return resource(request, content)


@router.delete(
    "/proof-requests/{request_id}", response_model=ProofRequest, responses=documented(Forbidden, _NOT_FOUND, _SETTLED)
)
async def cancel_proof_request(context: ContextDep, request_id: RequestId, person: SignedInPerson) -> Response:
    """Take a request back, as long as the drone has not asked. Whoever made it may, and the authority."""
    now = context.clock()
    async with context.database.read() as database:
        row = await store.find_request(database, request_id, person.scope)
        if row is None or (row.requested_by != person.person_id and not person.has("admin", "inspector")):
            raise NotFound(said("no_such_request"))
        state = (await store.request_json(database, row, now))["state"]
    if state != "pending":
        raise Conflict(said("request_settled", state=state))
    async with context.database.write() as connection:
        await store.change(connection, request_id, row.uav_id, cancelled_ms=now)
        await audit.record(connection, person, "cancel_proof_request", f"proof-request/{request_id}", t_ms=now)
    async with context.database.read() as database:
        found = await store.find_request(database, request_id, ALL)
        assert found is not None
        content = await store.request_json(database, found, now)
    return Json(content, headers=NO_STORE)
