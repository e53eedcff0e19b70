"""People as administrators manage them."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import Administrator
from wonderland_backend.agents.members import Members, MembersDep
from wonderland_backend.auth import step_up
from wonderland_backend.auth.secret import new_id
from wonderland_backend.auth.step_up import StepUpRequired
from wonderland_backend.auth.store.sign_ins import SignIns, SignInsDep
from wonderland_backend.clients import idempotency
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import Conflict, Forbidden, NotFound, PreconditionFailed, documented
from wonderland_backend.live.hub import HubDep
from wonderland_backend.people import store
from wonderland_backend.people.accept import INVITATION, RECOVERY
from wonderland_backend.people.schemas import (
    Invitation,
    LinkMade,
    PeopleList,
    PersonChange,
    PersonDetail,
    PersonIdPath,
    SignInIdPath,
)
from wonderland_backend.person import Person
from wonderland_backend.proved import Fresh
from wonderland_backend.responses import Json, etag_of, require_match, resource
from wonderland_backend.rest.me import detail_of

router = APIRouter(tags=["people"])
_NOT_FOUND: Final = NotFound(said("no_such_person"))
NO_STORE = {"Cache-Control": "no-store"}


@router.get("/people", response_model=PeopleList, responses=documented(Forbidden))
async def list_people(context: ContextDep, who: Administrator) -> Response:
    """All people, by name. Audited: it has their e-mail addresses."""
    async with context.database.write() as connection:
        found = await store.listing(connection)
        await audit.record_read(connection, who, "people", t_ms=context.clock())
    return Json({"items": found}, headers=NO_STORE)


@router.post(
    "/people",
    response_model=LinkMade,
    status_code=201,
    responses=documented(idempotency.BAD_KEY, Forbidden, StepUpRequired, Conflict(said("email_taken"))),
    openapi_extra={"parameters": [idempotency.PARAMETER, step_up.PARAMETER]},
)
async def invite_person(
    request: Request,
    context: ContextDep,
    sign_ins: SignInsDep,
    members: MembersDep,
    who: Administrator,
    _proved: Fresh,
    body: Invitation,
) -> Response:
    """Make an account, and the link by which its owner takes it."""
    _require_organisation(members, body.msp_id)
    return await idempotency.once(request, who, lambda: _invite(context, sign_ins, who, body))


async def _invite(context: Context, sign_ins: SignIns, who: Person, body: Invitation) -> Response:
    person_id = new_id(context.randomness)
    async with context.database.write() as connection:
        await store.create(connection, who, body, person_id, state=store.INVITED, now_ms=context.clock())
        ttl_s = context.settings.invitation_ttl_s
        token = await sign_ins.new_link(connection, INVITATION, person_id, ttl_s=ttl_s)
        person = await store.find_person(connection, person_id)
    return _made(context, person, token, 201)


def _require_organisation(members: Members, msp_id: str) -> None:
    """Raise `Conflict` for one that the channel does not have: it has no pads and drones that anybody could see.

    Not while the mirror has yet to read the channel's configuration.
    """
    known = members.msp_ids
    if msp_id and known and msp_id not in known:
        raise Conflict(said("organisation_unknown", msp_id=msp_id, known=", ".join(known)))


@router.get("/people/{person_id}", response_model=PersonDetail, responses=documented(Forbidden, _NOT_FOUND, etag=True))
async def read_person(request: Request, context: ContextDep, who: Administrator, person_id: PersonIdPath) -> Response:
    """A person, with how and where they sign in. Audited, unless it is oneself."""
    found = await detail_of(context, who, person_id)
    if person_id != who.person_id:
        async with context.database.write() as connection:
            await audit.record_read(connection, who, store.subject(person_id), t_ms=context.clock())
    return resource(request, found, headers=NO_STORE)


@router.patch(
    "/people/{person_id}",
    response_model=PersonDetail,
    responses=documented(Forbidden, StepUpRequired, _NOT_FOUND, Conflict, PreconditionFailed),
    openapi_extra=step_up.DOCUMENTED,
)
async def change_person(
    request: Request,
    context: ContextDep,
    hub: HubDep,
    members: MembersDep,
    who: Administrator,
    _proved: Fresh,
    person_id: PersonIdPath,
    body: PersonChange,
) -> Response:
    """Change name, address, roles or organisation; suspend and restore. Takes effect at once."""
    require_match(request, await detail_of(context, who, person_id))
    _require_organisation(members, body.msp_id or "")
    async with context.database.write() as connection:
        person, touched = await store.change(connection, who, person_id, body, context.clock())
    for cookie in touched:
        if person["state"] == store.SUSPENDED:
            hub.close_person(cookie)
        else:
            hub.restart_person(cookie)
    return await _detail(context, who, person_id)


@router.delete(
    "/people/{person_id}", status_code=204, responses=documented(Forbidden, _NOT_FOUND, Conflict, PreconditionFailed)
)
async def withdraw_invitation(
    request: Request, context: ContextDep, who: Administrator, person_id: PersonIdPath
) -> Response:
    """Take an invitation back that nobody has accepted."""
    require_match(request, await detail_of(context, who, person_id))
    async with context.database.write() as connection:
        await store.withdraw(connection, who, person_id, context.clock())
    return Response(status_code=204)


@router.post(
    "/people/{person_id}/link",
    response_model=LinkMade,
    status_code=201,
    responses=documented(Forbidden, StepUpRequired, _NOT_FOUND, Conflict),
    openapi_extra=step_up.DOCUMENTED,
)
async def make_link(
    context: ContextDep, sign_ins: SignInsDep, who: Administrator, _proved: Fresh, person_id: PersonIdPath
) -> Response:
    """Another link: for an invitation that has not been accepted, or for somebody who cannot sign in any more.

    Whoever comes back by it makes a new passkey; all earlier ones, and all sign-ins, end then.
    """
    async with context.database.write() as connection:
        person = await store.find_person(connection, person_id)
        if person["state"] == store.SUSPENDED:
            raise Conflict(said("suspended_restore_first"))
        kind = INVITATION if person["state"] == store.INVITED else RECOVERY
        ttl_s = context.settings.invitation_ttl_s if kind == INVITATION else None
        token = await sign_ins.new_link(connection, kind, person_id, ttl_s=ttl_s)
        await audit.record(connection, who, f"{kind}_link_made", store.subject(person_id), t_ms=context.clock())
    return _made(context, person, token, 201)


@router.delete(
    "/people/{person_id}/sign-ins/{sign_in_id}",
    response_model=PersonDetail,
    responses=documented(Forbidden, _NOT_FOUND),
)
async def end_sign_in(
    context: ContextDep, hub: HubDep, who: Administrator, person_id: PersonIdPath, sign_in_id: SignInIdPath
) -> Response:
    """Sign one of somebody's browsers out."""
    async with context.database.write() as connection:
        cookie = await store.end_sign_in(connection, who, person_id, sign_in_id, context.clock())
    hub.close_person(cookie)
    return await _detail(context, who, person_id)


async def _detail(context: Context, who: Person, person_id: str) -> Response:
    content = await detail_of(context, who, person_id)
    return Json(content, headers=NO_STORE | {"ETag": etag_of(content)})


def _made(context: Context, person: store.Row, token: str, status: int) -> Response:
    ttl_s = context.settings.invitation_ttl_s if person["state"] == store.INVITED else context.settings.token_ttl_s
    content = {"person": person, "token": token, "expires_ms": context.clock() + ttl_s * 1000}
    answer = Json(content, headers=NO_STORE)
    answer.status_code = status
    return answer
