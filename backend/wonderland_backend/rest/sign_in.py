"""Signing in by a link, signing out, who is signed in."""

from __future__ import annotations

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response

from wonderland_backend.access import BY_COOKIE, SignedInPerson
from wonderland_backend.auth.limits import counted, failures_audited
from wonderland_backend.auth.schemas import SignedIn, SignIn
from wonderland_backend.auth.store.sign_ins import SignInsDep
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import TooManyRequests, documented
from wonderland_backend.live.hub import HubDep
from wonderland_backend.person import Person
from wonderland_backend.responses import Json

router = APIRouter(tags=["sign-in"])
NO_STORE = {"Cache-Control": "no-store"}


@router.post(
    "/session", response_model=SignedIn, dependencies=[Depends(counted)], responses=documented(TooManyRequests)
)
async def sign_in(request: Request, context: ContextDep, sign_ins: SignInsDep, body: SignIn) -> Response:
    """Spend a one-time token for a cookie (HttpOnly, SameSite=Strict)."""
    async with failures_audited(request, "link"):
        browser, former = request.headers.get("user-agent", ""), request.cookies.get(context.cookie_name)
        cookie, person = await sign_ins.redeem(body.token, browser, former)
    return signed_in(context, cookie, person)


@router.get("/session", response_model=SignedIn, responses=documented(), openapi_extra=BY_COOKIE)
async def who_am_i(context: ContextDep, person: SignedInPerson) -> Response:
    """Who is signed in, and until when."""
    return Json(_described(context, person), headers=NO_STORE)


@router.post("/session/use", status_code=204, responses=documented(), openapi_extra=BY_COOKIE)
async def use_sign_in(sign_ins: SignInsDep, person: SignedInPerson) -> Response:
    """Somebody is at the keys. Only this keeps a sign-in from ending unused; requests and open connections do not."""
    await sign_ins.use(person)
    return Response(status_code=204)


@router.delete("/session", status_code=204, responses=documented(), openapi_extra=BY_COOKIE)
async def sign_out(context: ContextDep, hub: HubDep, sign_ins: SignInsDep, person: SignedInPerson) -> Response:
    """End the sign-in; open live connections of it are closed, too."""
    await sign_ins.end(person)
    hub.close_person(person.cookie_sha256)
    response = Response(status_code=204)
    response.delete_cookie(
        context.cookie_name, path="/", httponly=True, samesite="strict", secure=context.settings.is_https
    )
    return response


def signed_in(context: Context, cookie: str, person: Person) -> Response:
    """The answer to whoever has just signed in: who they are, and their cookie."""
    response = Json(_described(context, person), headers=NO_STORE)
    set_cookie(context, response, cookie, person)
    return response


def set_cookie(context: Context, response: Response, cookie: str, person: Person) -> None:
    """Give the browser its cookie."""
    response.set_cookie(
        context.cookie_name,
        cookie,
        max_age=(person.expires_ms - person.signed_in_ms) // 1000,
        httponly=True,
        samesite="strict",
        secure=context.settings.is_https,
        path="/",
    )


def _described(context: Context, person: Person) -> dict[str, object]:
    found = SignedIn(
        person_id=person.person_id,
        name=person.name,
        roles=list(person.roles),
        msp_id=person.msp_id or None,
        method=person.method,  # type: ignore[arg-type]
        signed_in_ms=person.signed_in_ms,
        expires_ms=person.expires_ms,
        idle_s=context.settings.sign_in_idle_s,
    )
    return found.model_dump(exclude_none=True)
