"""What is pushed (AsyncAPI 3): the live WebSocket and the event stream, from the same models as the OpenAPI."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from pydantic.json_schema import models_json_schema

from wonderland import __version__
from wonderland_backend.clients.scopes import LIVE, PROOFS, SCOPES
from wonderland_backend.events.schemas import LedgerEvent
from wonderland_backend.live.endpoints import FORBIDDEN
from wonderland_backend.live.hub import GOING_AWAY, SIGNED_OUT, TOO_MANY, TOO_SLOW
from wonderland_backend.live.schemas import FRAMES
from wonderland_backend.reference.examples import example_of
from wonderland_backend.schemas import ApiModel

router = APIRouter()
CLOSE_CODES: Final = {
    SIGNED_OUT: "No sign-in and no token, or it has ended: get a new one, and come back with `since`",
    FORBIDDEN: "The token lacks one of the scopes; the reason names it",
    TOO_SLOW: "You read too slowly: come back with `since`, and fetch by REST what was missed",
    TOO_MANY: "Too many connections",
    GOING_AWAY: "The server stops: come back with `since`",
}
_LIVE: Final = f"""\
Everything that the console shows, as it happens. First a `LiveHello`; then, unless it says `resumed`, the state in
parts (`LiveSnapshot`), then what changes (`LiveDelta`). Clients send nothing.

Close codes: {"; ".join(f"{code}: {why}" for code, why in CLOSE_CODES.items())}."""
_EVENTS: Final = """\
Server-Sent Events, with `Accept: text/event-stream`: `id` is the event’s place on the ledger, `event` its type, `data`
this message as JSON. After a break send `Last-Event-ID`: nothing is missed. Comments come every 15 s; they keep the
connection open. An `id` without `data` only moves the place on."""


@router.get("/asyncapi.json", include_in_schema=False)
def read_asyncapi(request: Request) -> JSONResponse:
    """The description of what is pushed; needs no sign-in."""
    return JSONResponse(asyncapi(request.url.netloc, encrypted=request.url.scheme == "https"))


def asyncapi(host: str, *, encrypted: bool = True) -> dict[str, Any]:
    """The document, for the server at this name and port."""
    wire = "s" if encrypted else ""
    servers = {"live": _server(host, f"ws{wire}", LIVE, wire), "events": _server(host, f"http{wire}", (PROOFS,), wire)}
    return {**_messages(), "servers": servers}


@cache
def _messages() -> dict[str, Any]:
    """All of it that is the same wherever the server is."""
    models: tuple[type[ApiModel], ...] = (*FRAMES, LedgerEvent)
    _, found = models_json_schema(
        [(model, "validation") for model in models], ref_template="#/components/schemas/{model}"
    )
    schemas = dict(sorted(found["$defs"].items()))
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Wonderland, pushed",
            "version": __version__,
            "description": "What the server sends by itself. What it is asked for, and webhooks: `openapi.json`.",
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/json",
        "channels": {
            "live": {
                "address": "/api/v1/live",
                "description": _LIVE,
                "servers": [{"$ref": "#/servers/live"}],
                "messages": {each.__name__: _ref("messages", each.__name__) for each in FRAMES},
                "bindings": {"ws": {"method": "GET", "query": _LIVE_QUERY, "headers": _AUTHORIZATION}},
            },
            "events": {
                "address": "/api/v1/events",
                "description": _EVENTS,
                "servers": [{"$ref": "#/servers/events"}],
                "messages": {"LedgerEvent": _ref("messages", "LedgerEvent")},
            },
        },
        "operations": {
            "sendLive": {
                "action": "send",
                "channel": {"$ref": "#/channels/live"},
                "summary": "The live picture",
                "messages": [{"$ref": f"#/channels/live/messages/{each.__name__}"} for each in FRAMES],
            },
            "sendEvents": {
                "action": "send",
                "channel": {"$ref": "#/channels/events"},
                "summary": "What is committed to the ledger, in its order",
                "bindings": {"http": {"method": "GET", "query": _EVENTS_QUERY, "bindingVersion": "0.3.0"}},
                "messages": [{"$ref": "#/channels/events/messages/LedgerEvent"}],
            },
        },
        "components": {
            "messages": {model.__name__: _message(model.__name__, schemas) for model in models},
            "schemas": schemas,
            "securitySchemes": {
                "person": {
                    "type": "httpApiKey",
                    "in": "cookie",
                    "name": "wonderland_<instance>",
                    "description": "People: the cookie of a sign-in at the console",
                },
            },
        },
    }


_LIVE_QUERY: Final = {
    "type": "object",
    "properties": {
        "since": {
            "type": "string",
            "pattern": r"^[0-9a-f]{16}:\d{1,15}$",
            "description": "`epoch:seq` of the last frame seen: what came since follows, where it is still known",
        },
        "packed": {
            "type": "string",
            "enum": ["zlib"],
            "description": "Frames of 1,024 characters or more come as binary messages, the same text in zlib’s format",
        },
    },
}
_EVENTS_QUERY: Final = {
    "type": "object",
    "properties": {
        "after": {"type": "string", "description": "The last event seen; 0.0: from the first; none: new ones"},
        **{
            name: {"type": "array", "items": {"type": "string"}, "description": f"Only these: {what}"}
            for name, what in (("type", "types"), ("pad", "pads"), ("drone", "drones"), ("outcome", "verdicts"))
        },
    },
}
_AUTHORIZATION: Final = {
    "type": "object",
    "properties": {"Authorization": {"type": "string", "description": "`Bearer` and the token; browsers: the cookie"}},
}


def _server(host: str, protocol: str, scopes: tuple[str, ...], wire: str) -> dict[str, Any]:
    client = {
        "type": "oauth2",
        "description": "Machines: client credentials; the connection ends with the token",
        "flows": {
            "clientCredentials": {
                "tokenUrl": f"http{wire}://{host}/oauth/token",
                "availableScopes": {scope: SCOPES[scope] for scope in scopes},
            }
        },
        "scopes": list(scopes),
    }
    return {
        "host": host,
        "protocol": protocol,
        "security": [client, {"$ref": "#/components/securitySchemes/person"}],
    }


def _message(name: str, schemas: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": name,
        "title": name,
        "summary": schemas[name].get("description", "").partition("\n")[0],
        "contentType": "application/json",
        "payload": _ref("schemas", name),
        "examples": [{"payload": example_of(schemas[name], schemas)}],
    }


def _ref(kind: str, name: str) -> dict[str, str]:
    return {"$ref": f"#/components/{kind}/{name}"}
