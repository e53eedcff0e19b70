"""What FastAPI leaves out of the description: who may call an operation, what every one can answer, examples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from backend import errors
from backend.clients.scopes import RID_DISPLAY, RID_SERVICE, SCOPES, scopes_for
from backend.errors import TYPE_BASE
from backend.reference.examples import example_of

Document = dict[str, Any]
PROBLEM: Final = {"$ref": "#/components/schemas/ProblemDetails"}
METHODS: Final = ("get", "put", "post", "delete", "patch")
OPEN: Final = frozenset({"tokens", "server", "sign-in"})
"""Tags of what can be called without a token; what a sign-in needs, its own description says."""
NETWORK: Final = "network remote id"
"""ASTM F3411: for systems alone."""
_TITLES: Final[Mapping[str, tuple[str, str, str]]] = {
    "400": ("bad-request", "Bad Request", "`cursor` is not one of this list's; pass the `next` of the page before."),
    "401": ("sign-in-required", "Unauthorized", "Sign in first."),
    "403": ("forbidden", "Forbidden", "The token lacks the scope wonderland.proofs.read."),
    "404": ("not-found", "Not Found", "No pad aurajoki-9 is registered."),
    "409": ("conflict", "Conflict", "Somebody else has changed it since you looked; look at it again."),
    "413": ("too-large", "Content Too Large", "The body is larger than the 65536 bytes allowed here."),
    "422": ("invalid-request", "Unprocessable Content", "The request has fields or parameters that are not allowed."),
    "429": ("too-many-requests", "Too Many Requests", "More than 600 requests in a minute; go on in 12 s."),
    "503": ("ledger-away", "Service Unavailable", "The ledger cannot be asked just now."),
}


def complete(document: Document) -> None:
    """Add security, limits and examples to every operation, in place."""
    document["components"]["securitySchemes"] = _security_schemes()
    for path, method, operation in operations(document):
        tags = [str(tag) for tag in operation.get("tags", ())]
        responses = operation["responses"]
        if tags == [NETWORK]:
            operation["security"] = [{"client": [RID_DISPLAY]}, {"client": [RID_SERVICE]}]
            responses.pop("422", None)  # 400 there, as the standard has it
        elif OPEN.isdisjoint(tags):
            operation["security"] = _security(method, tags)
            if len(operation["security"]) > 1:
                responses.setdefault("403", _problem("The token lacks the scope."))
                responses.setdefault("429", _too_many())
        if operation.get("requestBody") is not None:
            responses.setdefault("413", _problem("The body is too large."))
        _add_examples(path, operation, document["components"]["schemas"])


def operations(document: Document) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(path, method, operation) of a document."""
    for path, methods in document["paths"].items():
        for method in METHODS:
            if method in methods:
                yield path, method, methods[method]


def _security_schemes() -> dict[str, Any]:
    flow = {"tokenUrl": "/oauth/token", "scopes": dict(SCOPES)}
    return {
        "client": {
            "type": "oauth2",
            "description": "Machines: client credentials, by secret or signed assertion",
            "flows": {"clientCredentials": flow},
        },
        "person": {
            "type": "apiKey",
            "in": "cookie",
            "name": "wonderland_<instance>",
            "description": "People: the cookie of a sign-in at the console",
        },
    }


def _security(method: str, tags: list[str]) -> list[dict[str, list[str]]]:
    scopes = sorted(frozenset[str]().union(*(scopes_for(method, tag) for tag in tags)))
    return [{"person": []}, *({"client": [scope]} for scope in scopes)]


def _problem(description: str) -> dict[str, Any]:
    return {"description": description, "content": {errors.MEDIA_TYPE: {"schema": PROBLEM}}}


def _too_many() -> dict[str, Any]:
    headers = {
        "Retry-After": {"description": "Seconds", "schema": {"type": "integer"}, "example": 12},
        "RateLimit-Policy": {"schema": {"type": "string"}, "example": '"default";q=600;w=60'},
        "RateLimit": {"schema": {"type": "string"}, "example": '"default";r=0;t=12'},
    }
    return _problem("Too many requests; try again later.") | {"headers": headers}


def _add_examples(path: str, operation: dict[str, Any], schemas: Mapping[str, Any]) -> None:
    for parameter in operation.get("parameters", ()):
        if "example" not in parameter and (parameter.get("required") or "default" not in parameter.get("schema", {})):
            parameter["example"] = example_of(parameter.get("schema", {}), schemas, parameter["name"])
    body = operation.get("requestBody")
    for media in (body or {}).get("content", {}).values():
        _fill(media, schemas)
    for status, response in operation["responses"].items():
        for kind, media in response.get("content", {}).items():
            if kind == errors.MEDIA_TYPE:
                media.setdefault("schema", PROBLEM)
                media.setdefault("example", _problem_example(path, str(status)))
            else:
                _fill(media, schemas)


def _fill(media: dict[str, Any], schemas: Mapping[str, Any]) -> None:
    if "example" not in media and "examples" not in media and media.get("schema"):
        media["example"] = example_of(media["schema"], schemas)


def _problem_example(path: str, status: str) -> dict[str, Any]:
    code, title, detail = _TITLES.get(status, ("internal", "Internal Server Error", "An unexpected error."))
    return {"type": TYPE_BASE + code, "title": title, "status": int(status), "detail": detail, "instance": path}
