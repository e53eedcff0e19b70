"""Signing in by a passkey, and accepting links by one: everything here is for those who are not signed in."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.auth import passkeys
from wonderland_backend.auth.limits import counted, failures_audited
from wonderland_backend.auth.schemas import SignedIn
from wonderland_backend.auth.secret import sha256
from wonderland_backend.auth.site import site_of
from wonderland_backend.auth.store.ceremonies import CeremonyOver
from wonderland_backend.auth.store.sign_ins import SignInsDep
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import BadRequest, Conflict, TooManyRequests, documented
from wonderland_backend.people import store
from wonderland_backend.people.accept import KINDS, Acceptance, accept, open_link
from wonderland_backend.people.schemas import Ceremony, Challenge, Credential, Name
from wonderland_backend.person import Role
from wonderland_backend.responses import Json
from wonderland_backend.rest.sign_in import signed_in
from wonderland_backend.schemas import ApiModel

router = APIRouter(tags=["sign-in"])
NO_STORE: Final = {"Cache-Control": "no-store"}
_COUNTED: Final = [Depends(counted)]
Token = Annotated[str, Field(min_length=1, max_length=128)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid")


class SignInMethods(ApiModel):
    """How one can sign in here."""

    set_up: bool = Field(description="Whether there is an administrator; if not, the link of the first start makes one")
    demo: bool
    site: str = Field(description="The host name that passkeys are bound to; the console must be open under it")
    oidc: str | None = Field(default=None, description="What the OpenID provider is called, where there is one")


class PasskeyAnswer(_Body):
    """The browser's answer to a challenge."""

    ceremony: Ceremony
    credential: Credential


class LinkQuestion(_Body):
    """A link's token."""

    token: Token


class LinkShown(ApiModel):
    """What a link is good for."""

    kind: Literal["set_up", "invitation", "recovery", "sign_in", "display"]
    name: str | None = Field(default=None, description="Whose it is; the first administrator has no name yet")
    roles: list[Role]
    expires_ms: int


class LinkAcceptance(_Body):
    """A link's token; the first administrator says her name."""

    token: Token
    name: Name | None = None


class LinkAnswer(_Body):
    """The browser's new passkey."""

    ceremony: Ceremony
    credential: Credential
    passkey_name: Name


@router.get("/sign-in", response_model=SignInMethods)
async def sign_in_methods(context: ContextDep, sign_ins: SignInsDep) -> Response:
    """How one can sign in here. Needs no sign-in."""
    found = SignInMethods(
        set_up=await sign_ins.is_set_up(),
        demo=context.settings.demo,
        site=site_of(context.settings, "").rp_id,
        oidc=context.settings.oidc.name if context.settings.oidc.issuer is not None else None,
    )
    return Json(found.model_dump(exclude_none=True), headers=NO_STORE)


@router.post(
    "/sign-in/passkey/challenge",
    response_model=Challenge,
    dependencies=_COUNTED,
    responses=documented(TooManyRequests),
)
async def challenge_passkey(context: ContextDep) -> Response:
    """What the browser's authenticator has to sign."""
    async with context.database.write() as connection:
        found = await passkeys.ask_to_sign_in(context, connection)
    return Json(found, headers=NO_STORE)


@router.post(
    "/sign-in/passkey",
    response_model=SignedIn,
    dependencies=_COUNTED,
    responses=documented(CeremonyOver, TooManyRequests),
)
async def sign_in_by_passkey(
    request: Request, context: ContextDep, sign_ins: SignInsDep, body: PasskeyAnswer
) -> Response:
    """Sign in by what the authenticator signed."""
    async with failures_audited(request, "passkey"):
        asked = await passkeys.asked_for(context, passkeys.SIGN_IN, body.ceremony)
        async with context.database.write() as connection:
            person_id = await passkeys.verify(
                context, connection, asked, body.credential, host=request.headers.get("host", "")
            )
            browser, former = request.headers.get("user-agent", ""), request.cookies.get(context.cookie_name)
            cookie, person = await sign_ins.begin(connection, person_id, "passkey", browser, former)
    return signed_in(context, cookie, person)


@router.post("/sign-in/link", response_model=LinkShown, dependencies=_COUNTED, responses=documented(TooManyRequests))
async def look_at_link(request: Request, context: ContextDep, sign_ins: SignInsDep, body: LinkQuestion) -> Response:
    """What a link is good for; it stays good."""
    async with failures_audited(request, "link"), context.database.write() as connection:
        link = await sign_ins.find_link(connection, sha256(body.token))
        person = await store.find_person(connection, link.person_id) if link.person_id is not None else None
    found = LinkShown(
        kind=link.kind,
        name=person["name"] if person is not None else None,
        roles=person["roles"] if person is not None else ["admin"],
        expires_ms=link.expires_ms,
    )
    return Json(found.model_dump(exclude_none=True), headers=NO_STORE)


@router.post(
    "/sign-in/link/passkey/options",
    response_model=Challenge,
    dependencies=_COUNTED,
    responses=documented(BadRequest(said("link_not_for_passkey")), TooManyRequests),
)
async def ask_link_passkey(
    request: Request, context: ContextDep, sign_ins: SignInsDep, body: LinkAcceptance
) -> Response:
    """What the browser needs to make a passkey for the link's person."""
    async with failures_audited(request, "link"), context.database.write() as connection:
        link, acceptance = await open_link(context, sign_ins, connection, sha256(body.token), body.name)
        if link.kind not in KINDS:
            raise BadRequest(said("link_not_for_passkey"))
        found = await passkeys.ask_for_new(
            context, connection, acceptance.person_id, acceptance.name, more=acceptance.to_json()
        )
    return Json(found, headers=NO_STORE)


@router.post(
    "/sign-in/link/passkey",
    response_model=SignedIn,
    dependencies=_COUNTED,
    responses=documented(
        BadRequest(said("passkey_malformed", why="the signature is wrong")),
        CeremonyOver,
        Conflict(said("set_up_already")),
        TooManyRequests,
    ),
)
async def accept_link_by_passkey(
    request: Request, context: ContextDep, sign_ins: SignInsDep, body: LinkAnswer
) -> Response:
    """Spend the link: from now on the new passkey signs its person in, and does so at once."""
    host, browser = request.headers.get("host", ""), request.headers.get("user-agent", "")
    former = request.cookies.get(context.cookie_name)
    async with failures_audited(request, "link"):
        asked = await passkeys.asked_for(context, passkeys.REGISTER, body.ceremony)
        if "token_sha256" not in asked:
            raise CeremonyOver(said("ceremony_of_signed_in"))
        async with context.database.write() as connection:
            account = await accept(context, sign_ins, connection, Acceptance.of(asked))
            await passkeys.keep(context, connection, asked, body.credential, name=body.passkey_name, host=host)
            detail = {"name": body.passkey_name}
            subject = store.subject(account.person_id)
            await audit.record(connection, account, "passkey_added", subject, detail, t_ms=context.clock())
            cookie, person = await sign_ins.begin(connection, account.person_id, "passkey", browser, former)
    return signed_in(context, cookie, person)
