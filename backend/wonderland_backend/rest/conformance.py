"""The question that U-space asks, by REST."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from wonderland import messages
from wonderland.messages import Language
from wonderland_backend.access import SignedInPerson
from wonderland_backend.conformance import queries
from wonderland_backend.conformance.rules import Broadcast, Finding, Question, judge
from wonderland_backend.conformance.schemas import Conformance, ConformanceFor, ConformanceQuery
from wonderland_backend.context import ContextDep
from wonderland_backend.drones import queries as drones
from wonderland_backend.errors import LedgerAway, NotAcceptable, RowsDiffer, documented
from wonderland_backend.languages import HEADER, language_of
from wonderland_backend.ledger.contents import require_committed
from wonderland_backend.mirror.source import BlockSourceDep
from wonderland_backend.proofs.queries import proof_json
from wonderland_backend.responses import resource
from wonderland_backend.sessions import queries as sessions
from wonderland_backend.statements import signed

router = APIRouter(tags=["conformance"])


@router.get(
    "/conformance",
    response_model=Conformance,
    responses=documented(NotAcceptable, LedgerAway, RowsDiffer, etag=True) | signed.documented({}),
    openapi_extra={"parameters": [HEADER]},
)
async def read_conformance(
    request: Request,
    context: ContextDep,
    asked: ConformanceFor,
    person: SignedInPerson,
    statements: signed.WantedStatements,
    source: BlockSourceDep,
) -> Response:
    """Whether a drone's broadcast is supported by a proof, how fresh that proof is, and how strong.

    A proof bounds where the drone can be later: it flies no faster than `max_speed_mm_s`. The rules are in
    docs/api/conformance.md. As `application/jose` this server signs the answer (docs/api/statements.md).
    """
    now = context.clock()
    language = language_of(request)
    content: dict[str, Any] = {"serial": asked.serial, "t_ms": now}
    async with context.database.read() as database:
        registered = await drones.find_drone(database, person.scope, asked.serial) is not None
        broadcast = _own(asked, now)
        last_heard = await queries.heard(database, asked.serial) if registered or person.scope.everything else None
        known = registered or last_heard is not None
        found = await queries.newest(database, asked.serial) if registered else None
        measured = await queries.measured(database, found[0]) if found is not None else None
        signature = await sessions.signature(database, found[0].session_id, found[0].pad_id) if found else None
    broadcast = broadcast or last_heard
    if known:
        question = Question(asked.within_mm, asked.max_speed_mm_s, asked.min_assurance)
        finding = judge(broadcast, measured, question, now)
        if found is not None and found[0] is not found[1]:
            finding = replace(finding, limits=(*finding.limits, "last_proof_inconclusive"))
    else:
        finding = Finding("unknown", ())
    if not registered:
        finding = replace(finding, limits=("not_registered", *finding.limits))
    content |= _shown(finding, language)
    if known and broadcast is not None:
        told_by = "heard" if asked.lat_e7 is None else "asked"
        content["broadcast"] = _broadcast(broadcast, told_by)
    if found is not None and measured is not None:
        content |= {
            "proof": proof_json(found[0], language),
            "measured_ms": measured.t_ms,
            "assurance": measured.assurance,
        }
    if signature is not None:
        content["signature"] = signature
    if statements is not None:
        for row in set(found or ()):
            await require_committed(source, row)
        return await statements.answer("conformance", content, now)
    headers = {"Cache-Control": "private, no-store", "Content-Language": language}
    return resource(request, content, headers=headers)


def _own(asked: ConformanceQuery, now_ms: int) -> Broadcast | None:
    """The broadcast that came with the question."""
    if asked.lat_e7 is None or asked.lon_e7 is None:
        return None
    return Broadcast(asked.lat_e7, asked.lon_e7, now_ms if asked.t_ms is None else asked.t_ms, asked.accuracy_mm)


def _broadcast(broadcast: Broadcast, source: str) -> dict[str, Any]:
    return {
        "lat_e7": broadcast.lat_e7,
        "lon_e7": broadcast.lon_e7,
        "t_ms": broadcast.t_ms,
        "accuracy_mm": broadcast.accuracy_mm,
        "source": source,
        "verified": False,
    }


def _shown(finding: Finding, language: Language) -> dict[str, Any]:
    content: dict[str, Any] = {
        "status": finding.status,
        "text": messages.text("conformance", f"status.{finding.status}", {}, language),
        "limits": [
            {"code": each, "text": messages.text("conformance", f"limit.{each}", {}, language)}
            for each in finding.limits
        ],
    }
    facts = {
        "distance_mm": finding.distance_mm,
        "proven_within_mm": finding.within_mm,
        "proven_beyond_mm": finding.beyond_mm,
        "age_ms": finding.age_ms,
        "supported_until_ms": finding.supported_until_ms,
    }
    return content | {name: value for name, value in facts.items() if value is not None}
