"""One's own account: passkeys and sign-ins."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.access import SignedInPerson
from wonderland_backend.auth import passkeys, step_up
from wonderland_backend.auth.step_up import StepUpRequired
from wonderland_backend.auth.store.ceremonies import CeremonyOver
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import BadRequest, Conflict, NotFound, documented
from wonderland_backend.live.hub import HubDep
from wonderland_backend.people import store
from wonderland_backend.people.schemas import (
    Challenge,
    NewPasskey,
    PasskeyIdPath,
    PasskeyName,
    PersonDetail,
    SignInIdPath,
)
from wonderland_backend.person import Person
from wonderland_backend.proved import ForNewPasskey, Fresh
from wonderland_backend.responses import Json

router = APIRouter(tags=["people"])
_NO_PASSKEY: Final = NotFound(said("no_such_passkey"))
NO_STORE = {"Cache-Control": "no-store"}


@router.get("/me", response_model=PersonDetail, responses=documented())
async def read_me(context: ContextDep, me: SignedInPerson) -> Response:
    """One's account, passkeys and sign-ins."""
    return await _me(context, me)


@router.post(
    "/me/passkeys/options",
    response_model=Challenge,
    responses=documented(StepUpRequired, Conflict(said("too_many_passkeys", most=20))),
    openapi_extra=step_up.DOCUMENTED,
)
async def ask_passkey(context: ContextDep, me: SignedInPerson, _proved: ForNewPasskey) -> Response:
    """What the browser needs to make another passkey."""
    async with context.database.write() as connection:
        found = await passkeys.ask_for_new(context, connection, me.person_id, me.name)
    return Json(found, headers=NO_STORE)


@router.post(
    "/me/passkeys",
    response_model=PersonDetail,
    responses=documented(
        BadRequest(said("passkey_malformed", why="the signature is wrong")),
        CeremonyOver,
        Conflict(said("passkey_known")),
    ),
)
async def add_passkey(request: Request, context: ContextDep, me: SignedInPerson, body: NewPasskey) -> Response:
    """Keep the passkey that the browser has made."""
    asked = await passkeys.asked_for(context, passkeys.REGISTER, body.ceremony)
    if asked["person_id"] != me.person_id:
        raise CeremonyOver(said("ceremony_of_other"))
    async with context.database.write() as connection:
        host = request.headers.get("host", "")
        await passkeys.keep(context, connection, asked, body.credential, name=body.name, host=host)
        subject = store.subject(me.person_id)
        await audit.record(connection, me, "passkey_added", subject, {"name": body.name}, t_ms=context.clock())
    return await _me(context, me)


@router.patch("/me/passkeys/{credential_id}", response_model=PersonDetail, responses=documented(_NO_PASSKEY))
async def rename_passkey(
    context: ContextDep, me: SignedInPerson, credential_id: PasskeyIdPath, body: PasskeyName
) -> Response:
    """Call a passkey something else."""
    async with context.database.write() as connection:
        await store.rename_passkey(connection, me, credential_id, body.name, context.clock())
    return await _me(context, me)


@router.delete(
    "/me/passkeys/{credential_id}",
    response_model=PersonDetail,
    responses=documented(StepUpRequired, _NO_PASSKEY, Conflict(said("last_sign_in_method"))),
    openapi_extra=step_up.DOCUMENTED,
)
async def remove_passkey(
    context: ContextDep, me: SignedInPerson, _proved: Fresh, credential_id: PasskeyIdPath
) -> Response:
    """Forget a passkey; not the last sign-in method."""
    async with context.database.write() as connection:
        await store.remove_passkey(connection, me, credential_id, context.clock())
    return await _me(context, me)


@router.delete(
    "/me/sign-ins/{sign_in_id}",
    response_model=PersonDetail,
    responses=documented(NotFound(said("sign_in_ended"))),
)
async def end_own_sign_in(context: ContextDep, hub: HubDep, me: SignedInPerson, sign_in_id: SignInIdPath) -> Response:
    """Sign another of one's browsers out."""
    async with context.database.write() as connection:
        cookie = await store.end_sign_in(connection, me, me.person_id, sign_in_id, context.clock())
    hub.close_person(cookie)
    return await _me(context, me)


async def _me(context: Context, me: Person) -> Response:
    return Json(await detail_of(context, me, me.person_id), headers=NO_STORE)


async def detail_of(context: Context, who: Person, person_id: str) -> dict[str, object]:
    """The PersonDetail of somebody, as `who` sees it. Raises `NotFound`."""
    now = context.clock()
    async with context.database.read() as database:
        person = await store.find_person(database, person_id)
        keys = await store.passkeys(database, person_id)
        sign_ins = await store.sign_ins(
            database,
            person_id,
            current=who.cookie_sha256,
            alive_since_ms=now - context.settings.sign_in_idle_s * 1000,
            now=now,
        )
    return {"person": person, "passkeys": keys, "sign_ins": sign_ins}
