"""Sessions by REST."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland_backend import audit
from wonderland_backend.access import SIGNED_IN, Officer, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BINARY, BadRequest, Forbidden, LedgerAway, NotFound, documented
from wonderland_backend.filters import SessionFilters
from wonderland_backend.ledger.access import MaybeLedgerDep
from wonderland_backend.ledger.queries import with_events
from wonderland_backend.narrowing import OPERATORS_MASKED
from wonderland_backend.responses import page, record, resource
from wonderland_backend.sessions import queries
from wonderland_backend.sessions.course import course_of
from wonderland_backend.sessions.residuals import residuals
from wonderland_backend.sessions.schemas import Course, SessionDetail, SessionPage
from wonderland_backend.verdicts import queries as verdicts
from wonderland_evidence.errors import EvidenceError

router = APIRouter(tags=["sessions"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_session"))
SessionIdPath = Annotated[str, Path(pattern=r"^[0-9a-f]{64}$", description="Transaction id of its RequestProof")]


@router.get("/sessions", response_model=SessionPage, responses=documented(BadRequest, OPERATORS_MASKED, etag=True))
async def list_sessions(
    request: Request, context: ContextDep, person: SignedInPerson, filters: SessionFilters
) -> Response:
    """Sessions, newest first."""
    before = filters.after_place(int, str)
    async with context.database.read() as database:
        found = await queries.listing(
            database, filters, person.scope, before=(before[0], before[1]) if before else None
        )
    return page(
        request,
        ((view, view.to_json()) for view in found),
        filters.limit,
        cursor_of=lambda view: (view.outline.requested_ms, view.session_id),
    )


@router.get("/sessions/{session_id}", response_model=SessionDetail, responses=documented(_NOT_FOUND, etag=True))
async def read_session(
    request: Request, context: ContextDep, person: SignedInPerson, session_id: SessionIdPath
) -> Response:
    """All that is known of a session: its record, verdict, steps, transactions, evidence."""
    async with context.database.read() as database:
        view = await queries.view(database, session_id, person.scope)
        row = await queries.row(database, session_id)
        if view is None or row is None:
            raise NotFound(said("no_such_session"))
        verdict = await verdicts.find_verdict(database, session_id)
        evidence = await queries.evidence(database, session_id)
        transactions = await with_events(database, await queries.transactions(database, view))
        estimates = await queries.estimates(database, session_id)
        ends = await queries.reported_ends(database, session_id)
        outline = view.outline
        signature = await queries.signature(database, session_id, outline.pad_id)
        findings = await queries.findings(database, outline)
    content: dict[str, Any] = {
        "summary": view.to_json(),
        "session": record(row.record),
        "transactions": transactions,
        "estimates": [orjson.Fragment(text) for text in estimates],
        "findings": [orjson.Fragment(finding.body) for finding in findings],
        "reported_ends": [orjson.Fragment(each.body) for each in ends],
    }
    if signature is not None:
        content["signature"] = signature
    if verdict is not None:
        content["verdict"] = verdicts.verdict_json(verdict)
    if evidence is not None:
        content["evidence"] = record(evidence.record)
    return resource(request, content)


@router.get(
    "/sessions/{session_id}/evidence",
    response_class=Response,
    responses=documented(Forbidden, _NOT_FOUND, LedgerAway)
    | {200: {"content": {"application/json": {"schema": BINARY}}}},
)
async def read_evidence(
    context: ContextDep, ledger: MaybeLedgerDep, person: Officer, session_id: SessionIdPath
) -> Response:
    """All that proves the session without this server, in one file (`wonderland-evidence/1`), from the ledger itself.

    These are blocks as they were signed, to the last byte: nothing is masked, so that they are for officers only, and
    audited.
    """
    async with context.database.read() as database:
        if await queries.row(database, session_id) is None:
            raise NotFound(said("no_such_session"))
    if ledger is None:
        raise LedgerAway(said("no_ledger_here"))
    try:
        data = await ledger.evidence(session_id, context.settings.timestamp_url)
    except EvidenceError as cause:
        raise LedgerAway(said("evidence_not_to_be_had", why=str(cause))) from cause
    async with context.database.write() as connection:
        await audit.record(connection, person, "read_contents", f"session/{session_id}", t_ms=context.clock())
    headers = {
        "Cache-Control": "private, no-store",
        "Content-Disposition": f'attachment; filename="evidence-{session_id[:12]}.json"',
    }
    return Response(data, media_type="application/json", headers=headers)


@router.get("/sessions/{session_id}/course", response_model=Course, responses=documented(_NOT_FOUND, etag=True))
async def read_course(
    request: Request, context: ContextDep, person: SignedInPerson, session_id: SessionIdPath
) -> Response:
    """How the likelihood of each claim went with the rounds, and what each range says against claim and estimate."""
    async with context.database.read() as database:
        view = await queries.view(database, session_id, person.scope)
        row = await queries.row(database, session_id)
        decided = await verdicts.find_verdict(database, session_id)
        brought = await queries.evidence(database, session_id)
        if view is None or row is None or decided is None or brought is None:
            raise NotFound(said("no_decided_session"))
        session = Session.decode(row.record.encode())
        survey = await queries.commissioning(database, session)
    verdict, evidence = Verdict.decode(decided.record.encode()), Evidence.decode(brought.record.encode())
    # Some twenty decisions of a millisecond each: not on the event loop.
    points = await asyncio.to_thread(course_of, session, survey, evidence, verdict)
    policy = session.policy
    content = {
        "verify_ppm": policy.verify_ppm,
        "refute_ppm": policy.refute_ppm,
        "points": points,
        "residuals": [] if survey is None else residuals(session, survey, evidence, verdict),
    }
    return resource(request, content)
