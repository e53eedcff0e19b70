"""Signing in, and accepting links, by the OpenID provider: out to it, and back."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import Annotated, Any, Final
from urllib.parse import urlsplit

from fastapi import APIRouter, Depends, Request
from fastapi.responses import RedirectResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.auth.limits import address_of, counted
from wonderland_backend.auth.oidc import Identity, OidcError, Provider
from wonderland_backend.auth.secret import sha256
from wonderland_backend.auth.site import site_of
from wonderland_backend.auth.store import ceremonies
from wonderland_backend.auth.store.sign_ins import SignIns, SignInsDep
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import BadRequest, NotFound, Problem, TooManyRequests, documented
from wonderland_backend.people import store
from wonderland_backend.people.accept import KINDS, Acceptance, accept, activate, link_identity, open_link
from wonderland_backend.people.schemas import Name
from wonderland_backend.person import Account, Person
from wonderland_backend.responses import Json
from wonderland_backend.rest.sign_in import set_cookie
from wonderland_backend.schemas import ApiModel

logger = logging.getLogger(__name__)
router = APIRouter(tags=["sign-in"])
OIDC: Final = "oidc"
CALLBACK: Final = "/api/v1/sign-in/oidc/callback"
_COUNTED: Final = [Depends(counted)]


class ProviderAway(Problem):
    """The OpenID provider cannot be asked just now."""

    status, code = HTTPStatus.BAD_GATEWAY, "provider-away"
    example = said("oidc_away")


class _RefusedError(Exception):
    """Why nobody is signed in, as a word that the console has a text for."""


class OidcQuestion(BaseModel):
    """Nothing to sign in; a link's token to accept it, with the name of the first administrator."""

    model_config = ConfigDict(extra="forbid")

    token: Annotated[str, Field(min_length=1, max_length=128)] | None = None
    name: Name | None = None


class OidcStart(ApiModel):
    """Where the browser has to go."""

    url: str


@router.post(
    "/sign-in/oidc",
    response_model=OidcStart,
    dependencies=_COUNTED,
    responses=documented(
        BadRequest(said("link_not_for_identity")),
        NotFound(said("no_oidc")),
        ProviderAway,
        TooManyRequests,
    ),
)
async def start_oidc(request: Request, context: ContextDep, sign_ins: SignInsDep, body: OidcQuestion) -> Response:
    """Begin to sign in by the OpenID provider; the answer comes to the callback, in this browser only."""
    provider = _provider(context)
    try:
        url, kept = await provider.ask(_redirect_uri(context, request))
    except OidcError as error:
        logger.warning("the OpenID provider: %s", error)
        raise ProviderAway(said("oidc_away")) from None
    async with context.database.write() as connection:
        if body.token is not None:
            link, acceptance = await open_link(context, sign_ins, connection, sha256(body.token), body.name)
            if link.kind not in KINDS:
                raise BadRequest(said("link_not_for_identity"))
            kept |= acceptance.to_json()
        secret = await ceremonies.begin(connection, OIDC, kept, now_ms=context.clock(), randomness=context.randomness)
    response = Json({"url": url}, headers={"Cache-Control": "no-store"})
    response.set_cookie(
        _cookie_name(context),
        secret,
        max_age=ceremonies.LIFE_MS // 1000,
        httponly=True,
        # Lax, not strict: the way back is a link from the provider's page.
        samesite="lax",
        secure=context.settings.is_https,
        path="/",
    )
    return response


@router.get("/sign-in/oidc/callback", include_in_schema=False, dependencies=_COUNTED)
async def finish_oidc(request: Request, context: ContextDep, sign_ins: SignInsDep) -> Response:
    """The way back from the provider: to the console, signed in or with a word why not."""
    try:
        cookie, person = await _finish(context, sign_ins, request)
        response = RedirectResponse("/", status_code=303)
        set_cookie(context, response, cookie, person)
    except (_RefusedError, OidcError, Problem) as refused:
        why = str(refused) if isinstance(refused, _RefusedError) else "failed"
        logger.warning("sign-in by the OpenID provider was refused: %s", refused)
        async with context.database.write() as connection:
            detail = {"why": why, "address": address_of(request)}
            await audit.record(connection, "", "sign_in_failed", OIDC, detail, t_ms=context.clock())
        response = RedirectResponse(f"/#refused={why}", status_code=303)
    response.headers["Cache-Control"] = "no-store"
    response.delete_cookie(
        _cookie_name(context), path="/", httponly=True, samesite="lax", secure=context.settings.is_https
    )
    return response


async def _finish(context: Context, sign_ins: SignIns, request: Request) -> tuple[str, Person]:
    async with context.database.write() as connection:
        secret = request.cookies.get(_cookie_name(context), "")
        kept = await ceremonies.finish(connection, OIDC, secret, context.clock())
    if kept is None:
        raise _RefusedError("over")
    query = {name: value for name, value in request.query_params.items() if len(value) <= 4096}
    if "error" in query:
        raise _RefusedError("denied" if query["error"] == "access_denied" else "failed")
    identity = await _provider(context).answer(kept, query, _redirect_uri(context, request))
    async with context.database.write() as connection:
        account = await _account(context, sign_ins, connection, kept, identity)
        roles = context.settings.oidc.roles_of(identity.claims)
        if roles is not None and "token_sha256" not in kept:
            if not roles:
                raise _RefusedError("no_role")
            await store.set_roles(connection, account, roles, context.clock())
        browser, former = request.headers.get("user-agent", ""), request.cookies.get(context.cookie_name)
        return await sign_ins.begin(connection, account.person_id, OIDC, browser, former)


async def _account(
    context: Context, sign_ins: SignIns, connection: AsyncConnection, kept: dict[str, Any], identity: Identity
) -> Account:
    """Whose identity this is: by the link that is being accepted, by the subject, by the verified e-mail address."""
    now = context.clock()
    if "token_sha256" in kept:
        account = await accept(context, sign_ins, connection, Acceptance.of(kept))
        await link_identity(connection, account, identity, now)
        return account
    row = await store.of_identity(connection, identity.issuer, identity.subject)
    if row is None and identity.email is not None:
        row = await store.of_email(connection, identity.email)
        if row is not None and row.subject is not None:
            raise _RefusedError("unknown")
    if row is None:
        raise _RefusedError("unknown")
    if row.state == store.SUSPENDED:
        raise _RefusedError("suspended")
    account = Account(row.person_id, row.name)
    if row.state == store.INVITED:
        await activate(connection, account, now)
    if row.subject is None:
        await link_identity(connection, account, identity, now)
    return account


def _provider(context: Context) -> Provider:
    settings = context.settings.oidc
    if settings.issuer is None:
        raise NotFound(said("no_oidc"))
    return Provider(settings, context.http, clock=context.clock, randomness=context.randomness)


def _redirect_uri(context: Context, request: Request) -> str:
    """As the provider knows it: the public address, or this machine at the port that the browser asks."""
    if context.settings.public_url is not None:
        return site_of(context.settings, "").origin + CALLBACK
    return f"http://{urlsplit('//' + request.headers.get('host', '')).netloc}{CALLBACK}"


def _cookie_name(context: Context) -> str:
    return f"{context.cookie_name}_oidc"
