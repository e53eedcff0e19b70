"""The registry by REST. What changes it goes through `wonderland_backend.transactions`."""

from __future__ import annotations

import asyncio
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland.registry import lists
from wonderland_backend.access import SIGNED_IN, Officer, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, Forbidden, NotFound, documented
from wonderland_backend.languages import language_of
from wonderland_backend.numbers.store import numbers_of
from wonderland_backend.registry.queries import changes, organisations
from wonderland_backend.registry.queries import records as queries
from wonderland_backend.registry.reach import reach
from wonderland_backend.registry.schemas import (
    CertificateFilters,
    ChangeFilters,
    DroneFilters,
    HistoryFilters,
    ImportCheck,
    PadFilters,
    RegistryCertificatePage,
    RegistryChangePage,
    RegistryDroneDetail,
    RegistryDronePage,
    RegistryForms,
    RegistryOrganisations,
    RegistryPadDetail,
    RegistryPadPage,
    RegistryPolicies,
    RegistryProposalPage,
)
from wonderland_backend.responses import Json, page, record, resource
from wonderland_backend.rest.transactions import Signer
from wonderland_backend.transactions.functions import CHANGES

router = APIRouter(prefix="/registry", tags=["registry"], dependencies=SIGNED_IN)
NO_STORE = {"Cache-Control": "private, no-store"}
UavId = Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=40)]
PadId = Annotated[str, Path(pattern=f"^{ID_PATTERN}$", max_length=64)]


@router.get("/forms", response_model=RegistryForms)
async def list_forms() -> Response:
    """What people may send, with the bounds of every field: those that the contract checks."""
    items = [
        {"function": name, "roles": list(change.roles), "argument": change.argument.json_schema()}
        for name, change in sorted(CHANGES.items())
    ]
    return Json({"items": items}, headers={"Cache-Control": "private, max-age=300"})


@router.get("/drones", response_model=RegistryDronePage, responses=documented(BadRequest, etag=True))
async def list_registry_drones(
    request: Request, context: ContextDep, filters: DroneFilters, person: SignedInPerson
) -> Response:
    """Drones, by serial number or the last changed first."""
    kinds = (int, int, str) if filters.sort == "changed" else (str,)
    async with context.database.read() as database:
        rows = await queries.drones(database, person, filters, filters.after_place(*kinds))
        counts = await queries.in_force(database, [row.uav_id for row in rows], context.clock())
        numbers = await numbers_of(database, [row.record for row in rows])
    items = [(row, queries.shown_drone(row, person, numbers[row.uav_id], counts[row.uav_id])) for row in rows]
    changed = filters.sort == "changed"
    return page(
        request,
        items,
        filters.limit,
        cursor_of=lambda row: (row.block, row.tx_index, row.uav_id) if changed else (row.uav_id,),
    )


@router.get(
    "/drones/{uav_id}",
    response_model=RegistryDroneDetail,
    responses=documented(NotFound(said("no_such_drone", uav_id="OH-DRN-0417")), etag=True),
)
async def read_registry_drone(request: Request, context: ContextDep, uav_id: UavId, person: SignedInPerson) -> Response:
    """A drone, its authorisations, each with the version that a change names as seen, and its calibrations."""
    async with context.database.read() as database:
        row = await queries.drone(database, person, uav_id)
        if row is None:
            raise NotFound(said("no_such_drone", uav_id=uav_id))
        counts = await queries.in_force(database, [uav_id], context.clock())
        numbers = await numbers_of(database, [row.record])
        found = {
            "authorisations": await queries.authorisations(database, uav_id),
            "calibrations": await queries.calibrations(database, row, context.clock()),
        }
    return resource(request, {"drone": queries.shown_drone(row, person, numbers[uav_id], counts[uav_id]), **found})


@router.get("/pads", response_model=RegistryPadPage, responses=documented(BadRequest, etag=True))
async def list_registry_pads(
    request: Request, context: ContextDep, filters: PadFilters, person: SignedInPerson
) -> Response:
    """Pads, by identifier or the last changed first."""
    kinds = (int, int, str) if filters.sort == "changed" else (str,)
    async with context.database.read() as database:
        rows = await queries.pads(database, person, filters, filters.after_place(*kinds))
    items = [(row, {"record": record(row.record), "version": queries.version(row)}) for row in rows]
    changed = filters.sort == "changed"
    return page(
        request,
        items,
        filters.limit,
        cursor_of=lambda row: (row.block, row.tx_index, row.pad_id) if changed else (row.pad_id,),
    )


@router.get("/policies", response_model=RegistryPolicies)
async def list_policies(request: Request, context: ContextDep) -> Response:
    """The policies that hold where no pad has one of its own."""
    async with context.database.read() as database:
        return resource(request, {"policies": await queries.policies(database, "*")})


@router.get(
    "/pads/{pad_id}",
    response_model=RegistryPadDetail,
    responses=documented(NotFound(said("no_such_pad", pad_id="aurajoki-2")), etag=True),
)
async def read_registry_pad(request: Request, context: ContextDep, pad_id: PadId, person: SignedInPerson) -> Response:
    """A pad and the policies that hold there, each with the version that a change names as seen."""
    async with context.database.read() as database:
        row = await queries.pad(database, person, pad_id)
        if row is None:
            raise NotFound(said("no_such_pad", pad_id=pad_id))
        found = await queries.policies(database, pad_id)
        landing = await queries.landing_policy(database, pad_id)
    far = await asyncio.to_thread(reach, row.record, landing)
    shown = {"record": record(row.record), "version": queries.version(row)}
    return resource(request, {"pad": shown, "policies": found, "reach": far})


@router.get("/proposals", response_model=RegistryProposalPage, responses=documented(BadRequest, Forbidden, etag=True))
async def list_registry_proposals(
    request: Request, context: ContextDep, filters: ChangeFilters, _officer: Officer
) -> Response:
    """Changes that take two people, as one of them proposed them: what is open, and what became of the others."""
    now = context.clock()
    async with context.database.read() as database:
        rows = await changes.proposals(database, filters, filters.after_place(int, int, str), now)
    items = [(row, changes.shown_proposal(row, now)) for row in rows]
    return page(request, items, filters.limit, cursor_of=lambda row: (row.block, row.tx_index, row.change_id))


@router.post(
    "/imports/{kind}",
    response_model=ImportCheck,
    responses=documented(BadRequest(said("csv_no_header"))),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"text/csv": {"schema": {"type": "string", "description": "At most 1 MiB, 5,000 lines"}}},
        }
    },
)
async def check_import(
    request: Request, context: ContextDep, kind: Literal["drones", "authorisations", "pads"], _person: Signer
) -> Response:
    """A dry run of a CSV file: every error by line and column, and the arguments of what can be signed."""
    try:
        found = await asyncio.to_thread(lists.check, lists.KINDS[kind], await request.body())
    except lists.ListError as error:
        raise BadRequest(error.said) from error
    async with context.database.read() as database:
        there = await queries.known(database, kind, [row["id"] for row in found.rows])
    content = {
        "function": lists.KINDS[kind].function,
        "encoding": found.encoding,
        "delimiter": found.delimiter,
        "rows": [row | {"exists": row["id"] in there} for row in found.rows],
        "errors": found.shown_errors(language_of(request)),
        "error_count": len(found.errors),
    }
    return Json(content, headers=NO_STORE)


@router.get("/history", response_model=RegistryChangePage, responses=documented(BadRequest, NotFound, etag=True))
async def list_history(
    request: Request, context: ContextDep, filters: HistoryFilters, person: SignedInPerson
) -> Response:
    """Who changed what of a drone or pad, in which transaction; newest first."""
    place = filters.after_place(int, int, str, str)
    async with context.database.read() as database:
        if filters.kind == "drone" and await queries.drone(database, person, filters.id) is None:
            raise NotFound(said("no_such_drone", uav_id=filters.id))
        if filters.kind == "pad" and await queries.pad(database, person, filters.id) is None:
            raise NotFound(said("no_such_pad", pad_id=filters.id))
        rows, items = await queries.history(database, person, filters.kind, filters.id, place, filters.limit + 1)
    return page(
        request,
        zip(rows, items, strict=True),
        filters.limit,
        cursor_of=lambda row: (row.block, row.tx_index, row.kind, row.key),
    )


@router.get("/organisations", response_model=RegistryOrganisations)
async def list_organisations(context: ContextDep) -> Response:
    """The organisations of the channel, as its configuration has them."""
    async with context.database.read() as database:
        items = await organisations.organisations(database)
    return Json({"items": items}, headers=NO_STORE)


@router.get("/certificates", response_model=RegistryCertificatePage, responses=documented(BadRequest, etag=True))
async def list_certificates(
    request: Request, context: ContextDep, filters: CertificateFilters, person: SignedInPerson
) -> Response:
    """Certificates that have acted on the chain; those that end first first."""
    now = context.clock()
    async with context.database.read() as database:
        place = filters.after_place(int, str)
        rows = await organisations.certificates(database, person, filters, place, now)
        revoked = await organisations.revoked_serials(database)
    items = ((row, organisations.shown_certificate(row, revoked, now)) for row in rows)
    return page(request, items, filters.limit, cursor_of=lambda row: (row.not_after_ms, row.certificate_sha256))
