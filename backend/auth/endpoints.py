"""Signing in and out."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response
from starlette.requests import HTTPConnection

from backend.auth.schemas import SignedIn, SignIn
from backend.auth.sign_ins import Person
from backend.context import Context, context_of
from backend.errors import SignInRequired, documented
from backend.responses import Json

router = APIRouter(tags=["sign-in"])


async def person_of(connection: HTTPConnection) -> Person:
    """Who is signed in. Raises `SignInRequired`."""
    context = context_of(connection)
    person = await context.sign_ins.find(connection.cookies.get(context.cookie_name))
    if person is None:
        raise SignInRequired("Sign in first: open the link that the server printed at its start.")
    return person


SignedInPerson = Annotated[Person, Depends(person_of)]
SIGNED_IN = [Depends(person_of)]


@router.post("/session", response_model=SignedIn, responses=documented())
async def sign_in(request: Request, body: SignIn) -> Response:
    """Spend a one-time token for a cookie (HttpOnly, SameSite=Strict)."""
    context: Context = context_of(request)
    cookie, person = await context.sign_ins.redeem(body.token)
    response = Json(person.described().model_dump(), headers={"Cache-Control": "no-store"})
    response.set_cookie(
        context.cookie_name,
        cookie,
        max_age=context.settings.sign_in_ttl_s,
        httponly=True,
        samesite="strict",
        secure=context.settings.is_https,
        path="/",
    )
    return response


@router.get("/session", response_model=SignedIn, responses=documented())
async def who_am_i(person: SignedInPerson) -> Response:
    """Who is signed in, and until when."""
    return Json(person.described().model_dump(), headers={"Cache-Control": "no-store"})


@router.delete("/session", status_code=204, responses=documented())
async def sign_out(request: Request, person: SignedInPerson) -> Response:
    """End the sign-in; open live connections of it are closed, too."""
    context = context_of(request)
    await context.sign_ins.end(person.cookie_sha256)
    context.hub.close_person(person.cookie_sha256)
    response = Response(status_code=204)
    response.delete_cookie(
        context.cookie_name, path="/", httponly=True, samesite="strict", secure=context.settings.is_https
    )
    return response
