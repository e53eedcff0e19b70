"""What an endpoint demands of whoever calls it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Final

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.problems import said
from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.clients.machines import Machines
from wonderland_backend.context import Context, required
from wonderland_backend.errors import Forbidden, SignInRequired
from wonderland_backend.person import AUTHORITY, Person, Role


async def person_of(connection: HTTPConnection) -> Person:
    """Who is signed in, or which machine bears a token for this. Raises `SignInRequired`, `Forbidden`."""
    authorization = connection.headers.get("authorization")
    if authorization is not None:
        person: Person | None = await required(connection, Machines).person_of(connection, authorization)
    else:
        cookie = connection.cookies.get(required(connection, Context).cookie_name)
        person = await required(connection, SignIns).person_of_cookie(cookie)
    if person is None:
        raise SignInRequired(said("sign_in_first"))
    connection.state.person = person  # for `audit.refusals`, which stands outside
    if authorization is None and connection.scope["type"] == "http":
        quota = required(connection, Context).settings.person_requests_per_min
        required(connection, Machines).limits.admit(connection.scope, person.person_id, quota)
    return person


SignedInPerson = Annotated[Person, Depends(person_of)]
SIGNED_IN: Final = [Depends(person_of)]


def allowed(*roles: Role) -> Callable[[Person], Awaitable[Person]]:
    """A dependency: somebody who has one of these roles. It raises `SignInRequired` and `Forbidden`."""

    async def check(person: SignedInPerson) -> Person:
        require(person, *roles)
        return person

    return check


def require(person: Person, *roles: Role) -> None:
    """Raises `Forbidden` for somebody who has none of these roles."""
    if not person.has(*roles):
        theirs = " and ".join(person.roles) or "none"
        raise Forbidden(said("role_needed", needed=" or ".join(roles), theirs=theirs))


def only(*roles: Role) -> Any:
    """The same for a route or router that does not need to know who it is: ``dependencies=[only("admin")]``."""
    return Depends(allowed(*roles))


Officer = Annotated[Person, Depends(allowed(*AUTHORITY))]
"""Somebody who acts for the authority."""
BY_COOKIE: Final[dict[str, Any]] = {"security": [{"person": []}]}
"""For the description of an endpoint beside others that need no sign-in."""
Administrator = Annotated[Person, Depends(allowed("admin"))]
