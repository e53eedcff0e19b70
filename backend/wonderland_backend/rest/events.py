"""Events: as a stream (Server-Sent Events), or page by page for those who would rather ask."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AbstractContextManager
from typing import Any, Final

import orjson
from fastapi import APIRouter, Request
from fastapi.responses import Response, StreamingResponse

from wonderland_backend.access import SignedInPerson, person_of
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import Problem, TooManyRequests, documented
from wonderland_backend.events import queries as feed
from wonderland_backend.events.queries import BAD_PLACE, Commits, CommitsDep, Filter, Place
from wonderland_backend.events.schemas import EventFilters, EventPage
from wonderland_backend.events.streams import StreamsDep
from wonderland_backend.person import Person
from wonderland_backend.responses import Json

router = APIRouter(tags=["events"])
STREAM: Final = "text/event-stream"
_EXAMPLE: Final = 'id: 1042.0\nevent: ProofDecided\ndata: {"id":"1042.0","type":"ProofDecided","block":1042}\n\n'
HEARTBEAT_S: Final = 15.0
"""Proxies close what is silent; and who may no longer look is noticed at least this often."""
RETRY_MS: Final = 3_000
_LAST_EVENT_ID: Final[dict[str, Any]] = {
    "name": "Last-Event-ID",
    "in": "header",
    "required": False,
    "description": "The last event seen; browsers send it by themselves. It counts before `after`",
    "schema": {"type": "string"},
    "example": "1042.0",
}


@router.get(
    "/events",
    response_model=EventPage,
    responses=documented(BAD_PLACE, TooManyRequests)
    | {200: {"model": EventPage, "content": {STREAM: {"schema": {"type": "string"}, "example": _EXAMPLE}}}},
    openapi_extra={"parameters": [_LAST_EVENT_ID]},
)
async def read_events(
    request: Request,
    context: ContextDep,
    commits: CommitsDep,
    streams: StreamsDep,
    filters: EventFilters,
    person: SignedInPerson,
) -> Response:
    """What is committed to the ledger, in its order, from a place on.

    With `Accept: text/event-stream` a stream that never ends: `id` is the event's, `event` its type, `data` the
    LedgerEvent. After a break it goes on where it was, and nothing is missed. Otherwise one page.
    """
    text = request.headers.get("last-event-id") or filters.after
    async with context.database.read() as database:
        after = Place.parse(text) if text is not None else await feed.tip(database)
        if STREAM not in request.headers.get("accept", ""):
            batch = await feed.read(database, after, filters.filter(), person, filters.limit)
            content = {
                "items": [event.to_json() for event in batch.events],
                "after": str(batch.seen),
                "more": batch.more,
            }
            return Json(content, headers={"Cache-Control": "private, no-store"})
    streams.check(person.person_id)
    headers = {"Cache-Control": "private, no-store", "X-Accel-Buffering": "no"}
    held = streams.held(person.person_id)
    stream = _stream(request, context, commits, held, after, filters.filter(), person)
    return StreamingResponse(stream, headers=headers, media_type=STREAM)


async def _stream(
    request: Request,
    context: Context,
    commits: Commits,
    held: AbstractContextManager[None],
    after: Place,
    wanted: Filter,
    person: Person,
) -> AsyncIterator[bytes]:
    with held:
        yield f"retry: {RETRY_MS}\n: after {after}\n\n".encode()
        while not commits.stopping:
            upcoming = commits.upcoming
            async with context.database.read() as database:
                batch = await feed.read(database, after, wanted, person)
            for event in batch.events:
                yield _framed(event)
            if batch.seen != after and not batch.events:
                # The place moves on even where nothing was wanted, so that a resumed stream need not look again.
                yield f"id: {batch.seen}\n\n".encode()
            after = batch.seen
            if not batch.more and not await feed.happens(upcoming, HEARTBEAT_S):
                if not await _may_look(request, person):
                    return
                yield b": still here\n\n"


def _framed(event: feed.Event) -> bytes:
    data = orjson.dumps(event.to_json()).decode()
    return f"id: {event.place}\nevent: {event.type}\ndata: {data}\n\n".encode()


async def _may_look(request: Request, person: Person) -> bool:
    """Whether whoever opened the stream is still signed in, or its token still good, with the same rights."""
    try:
        return (await person_of(request)).scope == person.scope
    except TooManyRequests:
        return True
    except Problem:
        return False
