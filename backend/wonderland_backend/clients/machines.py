"""Requests with a bearer token: who sends them, whether their scopes suffice, how often they may."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, Final

from starlette.requests import HTTPConnection

from wonderland.problems import said
from wonderland_backend.clients.certificates import Certificates
from wonderland_backend.clients.keys import TokenKeys
from wonderland_backend.clients.scopes import LIVE, scopes_for
from wonderland_backend.clients.store import Clients, sha256
from wonderland_backend.clients.tokens import Tokens
from wonderland_backend.context import part
from wonderland_backend.db.tables.clients import ClientRow
from wonderland_backend.errors import Forbidden
from wonderland_backend.http.limits import RateLimits
from wonderland_backend.person import Person, roles_of
from wonderland_backend.settings import Settings
from wonderland_backend.tokens import Caller, TokenRefused, TokenVerifier

METHOD: Final = "client"


class Machines:
    """Turns a bearer token into whoever may do what the request asks for."""

    def __init__(
        self,
        tokens: Tokens,
        clients: Clients,
        verifier: TokenVerifier,
        limits: RateLimits,
        certificates: Certificates,
    ) -> None:
        self.tokens = tokens
        self.certificates = certificates
        self.limits = limits
        self._clients = clients
        self._verifier = verifier
        verifier.trust(tokens.issuer, tokens.keys.all)

    async def person_of(self, connection: HTTPConnection, authorization: str) -> Person:
        """The machine as a `Person`. Raises `TokenRefused`, `ScopeMissing`, `Forbidden`, `TooManyRequests`."""
        caller, client = await self._known(connection, authorization)
        person = _system(caller) if client is None else person_of_client(client, caller.expires_s * 1000)
        self.limits.admit(connection.scope, person.person_id)
        enough = _scopes_for(connection)
        if not enough:
            raise Forbidden(said("not_for_machines"))
        caller.require(*enough)
        connection.state.scopes = caller.scopes
        return person

    async def person_of_live(self, connection: HTTPConnection) -> Person:
        """A machine that may see live frames. Raises `TokenRefused`, `ScopeMissing`."""
        caller, client = await self._known(connection, connection.headers.get("authorization"))
        for scope in LIVE:
            caller.require(scope)
        return _system(caller) if client is None else person_of_client(client, caller.expires_s * 1000)

    async def may_go_on(self, person_id: str, role: str, expires_ms: int, now_ms: int) -> bool:
        """Whether live frames stay open: the token has not ended, and the machine has what it had.

        It loses with the person who registered it.
        """
        client = await self._clients.find_client(person_id)
        kept = client is None or (
            client.revoked_ms is None and client.role == role and set(LIVE) <= set(client.scopes.split())
        )
        return kept and now_ms < expires_ms

    async def caller_of(self, connection: HTTPConnection) -> Caller:
        """The machine as its token says, with what it may today. Raises `TokenRefused`."""
        caller, _ = await self._known(connection, connection.headers.get("authorization"))
        return caller

    async def _known(self, connection: HTTPConnection, authorization: str | None) -> tuple[Caller, ClientRow | None]:
        """Who calls; and its registration, where it is a client of ours."""
        shown = self.certificates.of(connection)
        caller = await self._verifier.verify(authorization, None if shown is None else shown.thumbprint)
        if caller.issuer != self.tokens.issuer:
            return caller, None
        client = await self._clients.find_client(caller.subject)
        if client is None or client.revoked_ms is not None:
            raise TokenRefused(said("client_revoked"))
        # What was taken away from the client since is in its older tokens no longer.
        return replace(caller, scopes=caller.scopes & frozenset(client.scopes.split())), client


MachinesDep = Annotated[Machines, part(Machines)]


def person_of_client(client: ClientRow, expires_ms: int = 0) -> Person:
    """A registered client with the rights that it has."""
    return Person(
        person_id=client.client_id,
        name=client.name,
        roles=roles_of(client.role),
        msp_id=client.msp_id,
        method=METHOD,
        signed_in_ms=client.created_ms,
        expires_ms=expires_ms,
        cookie_sha256="",
    )


def machines_of(
    settings: Settings,
    clients: Clients,
    verifier: TokenVerifier,
    host: str,
    clock: Callable[[], int],
    randomness: Callable[[int], bytes],
) -> Machines:
    """As the settings say; `host` is our own name. Raises `SettingsError`."""
    tokens = Tokens(
        TokenKeys.load(settings.token_key_file),
        clients,
        issuer=(settings.public_url or "http://localhost").rstrip("/"),
        audience=settings.uspace.audiences[0] if settings.uspace.audiences else host,
        clock=clock,
        randomness=randomness,
    )
    limits = RateLimits(settings.client_requests_per_min, clock)
    return Machines(tokens, clients, verifier, limits, Certificates.of_settings(settings, clock))


def _system(caller: Caller) -> Person:
    """A system that another issuer vouches for: it sees what anybody may, and no personal data."""
    return Person(
        person_id=f"sys-{sha256(f'{caller.issuer} {caller.subject}')[:28]}",
        name=caller.subject[:120],
        roles=("viewer",),
        msp_id="",
        method=METHOD,
        signed_in_ms=0,
        expires_ms=caller.expires_s * 1000,
        cookie_sha256="",
    )


def _scopes_for(connection: HTTPConnection) -> frozenset[str]:
    route: Any = connection.scope.get("route")
    method = str(connection.scope.get("method", "GET"))
    tags = getattr(route, "tags", None) or ()
    return frozenset[str]().union(*(scopes_for(method, str(tag)) for tag in tags))
