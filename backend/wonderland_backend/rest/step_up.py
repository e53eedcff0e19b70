"""Step-up: proving once more who is at the keys, for one request."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from wonderland.problems import said
from wonderland_backend.access import BY_COOKIE, SignedInPerson
from wonderland_backend.auth import step_up
from wonderland_backend.auth.limits import counted
from wonderland_backend.auth.step_up import NoPasskey, StepUpRequired
from wonderland_backend.auth.store.ceremonies import CeremonyOver
from wonderland_backend.context import ContextDep
from wonderland_backend.errors import TooManyRequests, documented
from wonderland_backend.people.schemas import Ceremony, Challenge, Credential
from wonderland_backend.responses import Json
from wonderland_backend.schemas import ApiModel

router = APIRouter(tags=["sign-in"])
NO_STORE: Final = {"Cache-Control": "no-store"}
_COUNTED: Final = [Depends(counted)]


class StepUpQuestion(BaseModel):
    """The request that is to be made."""

    model_config = ConfigDict(extra="forbid")

    method: str = Field(pattern="^(POST|PUT|PATCH|DELETE)$", examples=["POST"])
    path: str = Field(pattern="^/api/v1/", max_length=2048, examples=["/api/v1/people"])
    body_sha256: str = Field(pattern="^[0-9a-f]{64}$", description="Of the body's bytes; of none where there is none")


class StepUpAnswer(BaseModel):
    """What the authenticator signed."""

    model_config = ConfigDict(extra="forbid")

    ceremony: Ceremony
    credential: Credential


class StepUpGranted(ApiModel):
    """Good once, for the request that was named."""

    token: str = Field(description=f"For the header {step_up.HEADER} of that request")


@router.post(
    "/step-up/challenge",
    response_model=Challenge,
    dependencies=_COUNTED,
    responses=documented(NoPasskey, TooManyRequests),
    openapi_extra=BY_COOKIE,
)
async def ask_step_up(context: ContextDep, body: StepUpQuestion, person: SignedInPerson) -> Response:
    """What the browser's authenticator has to sign, so that this one request may be made."""
    act = step_up.Act(body.method, body.path, body.body_sha256)
    async with context.database.write() as connection:
        found = await step_up.ask(context, connection, person, act)
    return Json(found, headers=NO_STORE)


@router.post(
    "/step-up",
    response_model=StepUpGranted,
    dependencies=_COUNTED,
    responses=documented(CeremonyOver, StepUpRequired(said("step_up_of_other")), TooManyRequests),
    openapi_extra=BY_COOKIE,
)
async def step_up_by_passkey(
    request: Request, context: ContextDep, body: StepUpAnswer, person: SignedInPerson
) -> Response:
    """Who is at the keys, proved once more."""
    token = await step_up.grant(context, person, body.ceremony, body.credential, request.headers.get("host", ""))
    return Json({"token": token}, headers=NO_STORE)
