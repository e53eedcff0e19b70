"""The past by REST."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter
from fastapi.responses import Response, StreamingResponse

from wonderland.problems import said
from wonderland_backend.access import SIGNED_IN, SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import NotFound, documented
from wonderland_backend.mirror.status import MirrorStatusDep
from wonderland_backend.replay import film
from wonderland_backend.replay.queries import marks
from wonderland_backend.replay.queries.session import session_at
from wonderland_backend.replay.schemas import (
    AtMoment,
    FramesWanted,
    MarksWanted,
    PastMarks,
    PastRefusal,
    PastState,
    RefusalWanted,
)
from wonderland_backend.responses import Json
from wonderland_backend.rest.sessions import SessionIdPath
from wonderland_backend.sessions.schemas import SessionDetail

router = APIRouter(prefix="/replay", tags=["replay"], dependencies=SIGNED_IN)
_NOT_FOUND: Final = NotFound(said("no_such_session_then"))
_END: Final = '{"type":"end","t_ms":1800000000000,"complete":true}\n'
NO_STORE = {"Cache-Control": "private, no-store"}


@router.get("/state", response_model=PastState, responses=documented())
async def past_state(context: ContextDep, mirror: MirrorStatusDep, query: AtMoment, person: SignedInPerson) -> Response:
    """What the live map showed at a moment."""
    when, stage = await film.stage_at(context, mirror, query.at_ms, person)
    content = {"t_ms": when.t_ms, "block": when.block, **stage.board.snapshot(), "status": stage.board.status()}
    return Json(content, headers=NO_STORE)


@router.get(
    "/frames",
    response_class=StreamingResponse,
    responses=documented()
    | {200: {"content": {"application/x-ndjson": {"schema": {"type": "string"}, "example": _END}}}},
)
async def past_frames(
    context: ContextDep, mirror: MirrorStatusDep, query: FramesWanted, person: SignedInPerson
) -> Response:
    """A span of the past as the live interface's frames, one JSON object a line (application/x-ndjson).

    LiveHello, LiveSnapshot, a LiveDelta for each step in which something changed, and last
    `{"type": "end", "t_ms", "complete"}`: a film that would be too long ends early, ask for the rest from there.
    """
    content = film.frames(
        context,
        mirror,
        person,
        from_ms=query.from_ms,
        until_ms=query.until_ms,
        step_ms=query.step_ms,
        snapshot=query.snapshot,
    )
    return StreamingResponse(content, media_type="application/x-ndjson", headers=NO_STORE)


@router.get("/marks", response_model=PastMarks, responses=documented())
async def past_marks(context: ContextDep, query: MarksWanted, person: SignedInPerson) -> Response:
    """How much there is when, and where it is worth looking."""
    span = {"from_ms": query.from_ms, "until_ms": query.until_ms}
    async with context.database.read() as database:
        bounds = await marks.stored(database)
        density = await marks.density(database, person.scope, buckets=query.buckets, **span)
        found = await marks.marks(database, person.scope, **span)
    content = {**span, "density": density, "marks": found}
    if bounds is not None:
        content |= {"stored_from_ms": bounds[0], "stored_until_ms": bounds[1]}
    return Json(content, headers=NO_STORE)


@router.get("/refusal", response_model=PastRefusal, responses=documented())
async def past_refusal(context: ContextDep, query: RefusalWanted, person: SignedInPerson) -> Response:
    """The next refusal after a moment, or the last one before it."""
    async with context.database.read() as database:
        found = await marks.refusal_beside(database, person.scope, query.at_ms, query.direction)
    return Json({} if found is None else {"found": found}, headers=NO_STORE)


@router.get("/sessions/{session_id}", response_model=SessionDetail, responses=documented(_NOT_FOUND))
async def past_session(
    context: ContextDep, session_id: SessionIdPath, query: AtMoment, person: SignedInPerson
) -> Response:
    """All that was known of a session at a moment."""
    async with context.database.read() as database:
        content = await session_at(database, session_id, query.at_ms, person.scope)
    if content is None:
        raise NotFound(said("no_such_session_then"))
    return Json(content, headers=NO_STORE)
