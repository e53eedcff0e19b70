"""Who among other systems may ask: FastAPI dependencies on bearer tokens."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from starlette.requests import HTTPConnection

from wonderland_backend.clients.machines import MachinesDep
from wonderland_backend.tokens import Caller
from wonderland_backend.uspace.service import USpaceDep


def system_with(*scopes: str) -> Callable[..., Awaitable[Caller]]:
    """A dependency: the system whose token has one of these scopes.

    Else 401 or 403 as RFC 6750 has it, and 429 for one that asks too often.
    """

    async def caller_of(connection: HTTPConnection, machines: MachinesDep, uspace: USpaceDep) -> Caller:
        caller = await machines.caller_of(connection)
        caller.require(*scopes)
        uspace.limits.admit(connection.scope, f"{caller.issuer} {caller.subject}")
        return caller

    return caller_of
