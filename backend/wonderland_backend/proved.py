"""What an endpoint demands besides (`access`): that the person is at the keys now, proved by a passkey."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from wonderland_backend.access import SignedInPerson
from wonderland_backend.auth import step_up
from wonderland_backend.context import ContextDep


async def _fresh(request: Request, context: ContextDep, person: SignedInPerson) -> None:
    await step_up.require_fresh(request, context, person)


async def _recent(request: Request, context: ContextDep, person: SignedInPerson) -> None:
    await step_up.require_recent(request, context, person)


async def _new_passkey(request: Request, context: ContextDep, person: SignedInPerson) -> None:
    await step_up.require_for_new_passkey(request, context, person)


Fresh = Annotated[None, Depends(_fresh)]
"""A parameter of an endpoint, after the one that says who may: an assertion made for this very request."""
Recent = Annotated[None, Depends(_recent)]
"""For what is urgent: an assertion of the last 15 minutes will do."""
ForNewPasskey = Annotated[None, Depends(_new_passkey)]
