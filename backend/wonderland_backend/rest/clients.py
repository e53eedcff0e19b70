"""OAuth 2.0 for machines (RFC 6749, 7517, 8414), and their registration by an administrator."""

from __future__ import annotations

from typing import Annotated, Any, Final
from urllib.parse import parse_qsl

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import Said, said
from wonderland_backend.access import Administrator
from wonderland_backend.auth import step_up
from wonderland_backend.auth.step_up import StepUpRequired
from wonderland_backend.clients import idempotency, store
from wonderland_backend.clients.machines import MachinesDep
from wonderland_backend.clients.schemas import (
    AuthorizationServer,
    ClientCreated,
    ClientPage,
    ClientRegistration,
    RegisteredClient,
    TokenAnswer,
    TokenError,
    TokenKeys,
)
from wonderland_backend.clients.scopes import SCOPES
from wonderland_backend.clients.store import ClientError, Clients, ClientsDep
from wonderland_backend.clients.tokens import ASSERTION_ALGORITHMS, ASSERTION_TYPE, TokenDenied
from wonderland_backend.context import Context, ContextDep
from wonderland_backend.errors import BadRequest, Forbidden, NotFound, Unprocessable, documented
from wonderland_backend.filters import Paging
from wonderland_backend.person import Person
from wonderland_backend.proved import Fresh
from wonderland_backend.responses import Json, page, resource

oauth = APIRouter(tags=["tokens"])
router = APIRouter(tags=["clients"])
_NOT_FOUND: Final = NotFound(said("no_such_client", client_id="wl-5d0c2f6b9a7e4c1d8b3f0a62"))
ClientId = Annotated[str, Path(pattern="^wl-[0-9a-f]{24}$")]
MAX_FIELDS: Final = 16
TOKENS_PER_MINUTE: Final = 60
"""From one address: guessing secrets of 256 bits is hopeless, and hashing for those who try it is wasted."""
TLS_METHODS: Final = ("tls_client_auth", "self_signed_tls_client_auth")
NO_STORE: Final = {"Cache-Control": "no-store"}
_FORM: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["grant_type"],
    "properties": {
        "grant_type": {"type": "string", "enum": ["client_credentials"]},
        "scope": {"type": "string", "description": "Separated by spaces; without it all that the client may have"},
        "audience": {"type": "string", "description": "This server's host name, if it is named at all"},
        "client_id": {"type": "string", "description": "Of a client that authenticates by its TLS certificate"},
        "client_assertion_type": {"type": "string", "enum": [ASSERTION_TYPE]},
        "client_assertion": {"type": "string", "description": "A JWT that the client has signed (RFC 7523)"},
    },
}
_REQUEST_BODY: Final[dict[str, Any]] = {
    "requestBody": {"required": True, "content": {"application/x-www-form-urlencoded": {"schema": _FORM}}}
}


def _refused(error: str, description: Said) -> dict[str, Any]:
    example = {"error": error, "error_description": str(description)}
    return {
        "model": TokenError,
        "description": "Refused as RFC 6749, 5.2 has it.",
        "content": {"application/json": {"example": example}},
    }


@oauth.post(
    "/oauth/token",
    response_model=TokenAnswer,
    responses={
        400: _refused("invalid_scope", said("oauth_scope", scopes="wonderland.ledger.read")),
        401: _refused("invalid_client", said("oauth_secret")),
    },
    openapi_extra=_REQUEST_BODY,
)
async def issue_token(request: Request, machines: MachinesDep) -> Response:
    """An access token for a client: by its secret (HTTP Basic), an assertion that it has signed, or its certificate.

    A token that was asked for with a certificate is good with that certificate only (RFC 8705).
    """
    remote = request.client.host if request.client is not None else ""
    machines.limits.admit(request.scope, f"token/{remote}", TOKENS_PER_MINUTE)
    try:
        form = await _form(request)
        shown = machines.certificates.of(request)
        answer = await machines.tokens.issue(form, request.headers.get("authorization"), shown)
    except TokenDenied as refused:
        unknown = refused.code == "invalid_client"
        content = {"error": refused.code, "error_description": str(refused)}
        headers = NO_STORE | ({"WWW-Authenticate": 'Basic realm="wonderland"'} if unknown else {})
        return Json(content, 401 if unknown else 400, headers)
    return Json(answer, headers=NO_STORE)


@oauth.get("/oauth/jwks.json", response_model=TokenKeys)
async def read_token_keys(machines: MachinesDep) -> Response:
    """The public keys of our access tokens (RFC 7517)."""
    keys = machines.tokens.keys.public()
    return Json(keys, headers={"Cache-Control": "public, max-age=300"})


@oauth.get("/.well-known/oauth-authorization-server", response_model=AuthorizationServer)
async def read_authorization_server(machines: MachinesDep) -> Response:
    """Where tokens are had and how (RFC 8414)."""
    issuer, by_tls = machines.tokens.issuer, machines.certificates.offered
    methods = ["client_secret_basic", "private_key_jwt", *(TLS_METHODS if by_tls else ())]
    content = {
        "issuer": issuer,
        "token_endpoint": f"{issuer}/oauth/token",
        "jwks_uri": f"{issuer}/oauth/jwks.json",
        "scopes_supported": list(SCOPES),
        "response_types_supported": [],
        "grant_types_supported": ["client_credentials"],
        "token_endpoint_auth_methods_supported": methods,
        "token_endpoint_auth_signing_alg_values_supported": ASSERTION_ALGORITHMS,
        "tls_client_certificate_bound_access_tokens": by_tls,
        "service_documentation": f"{issuer}/api/v1/reference",
    }
    return Json(content, headers={"Cache-Control": "public, max-age=300"})


@router.get("/clients", response_model=ClientPage, responses=documented(BadRequest, Forbidden, etag=True))
async def list_clients(request: Request, context: ContextDep, paging: Paging, _person: Administrator) -> Response:
    """The machines that are registered, revoked ones included."""
    after = paging.after_key(str)
    async with context.database.read() as database:
        rows = await store.listing(database, after=after, limit=paging.limit + 1)
    return page(
        request, ((row, store.client_json(row)) for row in rows), paging.limit, cursor_of=lambda row: (row.client_id,)
    )


@router.post(
    "/clients",
    status_code=201,
    response_model=ClientCreated,
    responses=documented(
        idempotency.BAD_KEY,
        Forbidden,
        StepUpRequired,
        idempotency.BUSY,
        Unprocessable(said("client_scopes", scopes="wonderland.all", known="wonderland.read")),
    ),
    openapi_extra={"parameters": [idempotency.PARAMETER, step_up.PARAMETER]},
)
async def add_client(
    request: Request,
    context: ContextDep,
    clients: ClientsDep,
    body: ClientRegistration,
    person: Administrator,
    _proved: Fresh,
) -> Response:
    """Register a machine. Its secret is in the answer, and nowhere else ever after."""
    return await idempotency.once(request, person, lambda: _add(context, clients, body, person))


async def _add(context: Context, clients: Clients, body: ClientRegistration, person: Person) -> Response:
    try:
        tls = None if body.certificate is None else body.certificate.known_by()
        wanted = store.NewClient(body.name, tuple(body.scopes), body.role, body.msp_id, body.jwks, tls)
        async with context.database.write() as connection:
            row, secret = await clients.add(connection, wanted, person)
    except ClientError as cause:
        raise Unprocessable(cause.said) from None
    content: dict[str, Any] = {"client": store.client_json(row)}
    if secret is not None:
        content["client_secret"] = secret
    return Json(content, 201, NO_STORE | {"Location": f"/api/v1/clients/{row.client_id}"})


@router.get(
    "/clients/{client_id}", response_model=RegisteredClient, responses=documented(Forbidden, _NOT_FOUND, etag=True)
)
async def read_client(request: Request, clients: ClientsDep, client_id: ClientId, _person: Administrator) -> Response:
    """A machine."""
    row = await clients.find_client(client_id)
    if row is None:
        raise NotFound(said("no_such_client", client_id=client_id))
    return resource(request, store.client_json(row))


@router.delete("/clients/{client_id}", response_model=RegisteredClient, responses=documented(Forbidden, _NOT_FOUND))
async def revoke_client(
    context: ContextDep, clients: ClientsDep, client_id: ClientId, person: Administrator
) -> Response:
    """Revoke a machine for good: its tokens are worth nothing from now on."""
    async with context.database.write() as connection:
        await clients.revoke(connection, client_id, person)
    row = await clients.find_client(client_id)
    assert row is not None
    return Json(store.client_json(row), headers={"Cache-Control": "private, no-store"})


async def _form(request: Request) -> dict[str, str]:
    """The form's fields, each at most once. Raises `TokenDenied`."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/x-www-form-urlencoded":
        raise TokenDenied("invalid_request", said("oauth_form"))
    try:
        pairs = parse_qsl((await request.body()).decode(), keep_blank_values=True, max_num_fields=MAX_FIELDS)
    except ValueError:
        raise TokenDenied("invalid_request", said("oauth_no_form")) from None
    form = dict(pairs)
    if len(form) != len(pairs):
        raise TokenDenied("invalid_request", said("oauth_twice"))
    return form
