"""Traffic by REST, once or as a stream."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend import areas, audit
from wonderland_backend.access import SignedInPerson, person_of
from wonderland_backend.areas import BAD_BOX
from wonderland_backend.audit.store import recorded
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import Problem, TooManyRequests, documented
from wonderland_backend.events.queries import Commits, CommitsDep
from wonderland_backend.events.streams import StreamsDep
from wonderland_backend.person import Person
from wonderland_backend.responses import Json
from wonderland_backend.uspace.eu664.schemas import Recipient, Traffic
from wonderland_backend.uspace.eu664.traffic import SCOPES, TrafficInformation
from wonderland_backend.uspace.service import USpaceDep

router = APIRouter(tags=["traffic"])

STREAM: Final = "text/event-stream"
_EXAMPLE: Final = 'event: traffic\ndata: {"t_ms":1800000000000,"recipient":"ussp","items":[]}\n\n'
TICK_S: Final = 0.5
AUDITED_EVERY_MS: Final = 3_600_000
"""A row an hour for each machine: they ask every few seconds."""
_NO_STORE: Final = {"Cache-Control": "private, no-store"}
LOOK_AGAIN_TICKS: Final = 30
"""How often it is checked that whoever listens still may; and a sign of life where nothing flies."""


class TrafficQuery(BaseModel):
    """Which part of the map."""

    model_config = ConfigDict(extra="forbid")

    bbox: str | None = Field(default=None, pattern=areas.PATTERN, description=areas.DESCRIPTION)


@router.get(
    "/traffic",
    response_model=Traffic,
    responses=documented(BAD_BOX, TooManyRequests)
    | {200: {"model": Traffic, "content": {STREAM: {"schema": {"type": "string"}, "example": _EXAMPLE}}}},
)
async def read_traffic(
    request: Request,
    context: ContextDep,
    commits: CommitsDep,
    streams: StreamsDep,
    uspace: USpaceDep,
    query: Annotated[TrafficQuery, Query()],
    person: SignedInPerson,
) -> Response:
    """Drones in flight, with the fields of EU 2021/664, article 8(2), that the recipient may have.

    The recipient follows from the token's scope: `wonderland.traffic.` with `authority`, `ats` (air traffic
    services), `ussp` (U-space service providers) or `public`; people signed in to the console get the public view.
    With `Accept: text/event-stream` a stream: an event `traffic` with everything that flies, then one every half
    second with what has changed. Its events have no ids: after a break there is nothing to resume, a new stream
    begins with everything that flies.
    """
    box = areas.Box.parse(query.bbox) if query.bbox is not None else None
    asked = _Asked(uspace.traffic, _recipient(request), box, context.clock)
    await _audited(context, person, asked.recipient)
    if STREAM not in request.headers.get("accept", ""):
        return Json(asked.content(asked.traffic.items(asked.recipient, box)[0]), headers=_NO_STORE)
    streams.check(person.person_id)
    content = _stream(request, context, asked, streams.held(person.person_id), commits)
    return StreamingResponse(content, headers=_NO_STORE | {"X-Accel-Buffering": "no"}, media_type=STREAM)


@dataclass(frozen=True)
class _Asked:
    """What a recipient is told, and of which part of the map."""

    traffic: TrafficInformation
    recipient: Recipient
    box: areas.Box | None
    clock: Callable[[], int]

    def content(self, items: list[dict[str, Any]]) -> dict[str, Any]:
        """The answer, or the data of an event."""
        return {"t_ms": self.clock(), "recipient": self.recipient, "items": items}


def _recipient(request: Request) -> Recipient:
    scopes: frozenset[str] = getattr(request.state, "scopes", frozenset())
    return next((recipient for scope, recipient in SCOPES.items() if scope in scopes), "public")


async def _audited(context: Context, person: Person, recipient: Recipient) -> None:
    """Write down, once an hour, that somebody is told who operates drones and from where: all but the public are."""
    if recipient == "public":
        return
    subject, now_ms = f"traffic/{recipient}", context.clock()
    known = recorded(person, "read_personal_data", subject, since_ms=now_ms - AUDITED_EVERY_MS, t_ms=now_ms)
    async with context.database.read() as database:  # asked every few seconds: it waits for nobody who writes
        if (await database.execute(known)).first() is not None:
            return
    async with context.database.write() as connection:
        await audit.record_read(connection, person, subject, t_ms=now_ms)


async def _stream(
    request: Request, context: Context, asked: _Asked, held: AbstractContextManager[None], commits: Commits
) -> AsyncIterator[bytes]:
    after, ticks = -1, 0
    with held:
        while not commits.stopping:
            items, seen = asked.traffic.items(asked.recipient, asked.box, after=after)
            if items or after < 0:
                data = orjson.dumps(asked.content(items)).decode()
                yield f"event: traffic\ndata: {data}\n\n".encode()
            after = seen
            await asyncio.sleep(TICK_S)
            ticks += 1
            if ticks % LOOK_AGAIN_TICKS == 0:
                person = await _still(request)
                if person is None:
                    return
                await _audited(context, person, asked.recipient)
                yield b": still here\n\n"


async def _still(request: Request) -> Person | None:
    try:
        return await person_of(request)
    except Problem:
        return None
