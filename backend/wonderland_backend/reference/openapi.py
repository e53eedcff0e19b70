"""What FastAPI leaves out of the description: who may call what, what every operation can answer, examples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from wonderland.problems import said
from wonderland_backend import errors
from wonderland_backend.clients import idempotency
from wonderland_backend.clients.scopes import RID_DISPLAY, RID_SERVICE, SCOPES, scopes_for
from wonderland_backend.errors import Forbidden, Problem, SignInRequired, TooLarge, TooManyRequests, Unprocessable
from wonderland_backend.reference.examples import example_of
from wonderland_backend.tokens import ScopeMissing, TokenRefused

Document = dict[str, Any]
METHODS: Final = ("get", "put", "post", "delete", "patch")
OPEN: Final = frozenset({"tokens", "server", "sign-in"})
"""Tags of what can be called without a token; what a sign-in needs, its own description says."""
NETWORK: Final = "network remote id"
"""ASTM F3411: for systems alone."""
LIMITED: Final = frozenset({"/oauth/token"})
"""Open to all, but not as often as they like."""
_PROBLEM: Final = "Problem"
_TAG: Final = '"6f0c2a9b4d1e8f7a3c5b2d9e0f1a4c7b"'
_HEADERS: Final[Mapping[str, Any]] = {
    "ETag": {"description": "The answer's tag, for `If-None-Match` and `If-Match` (RFC 9110)", "example": _TAG},
    "RateLimit-Policy": {"description": "The quota q of requests in w seconds", "example": '"default";q=600;w=60'},
    "RateLimit": {"description": "r requests are left, for t seconds", "example": '"default";r=588;t=12'},
    "Deprecation": {"description": "Deprecated since (RFC 9745)", "example": "@1798761600"},
    "Sunset": {"description": "Works until (RFC 8594)", "example": "Thu, 01 Jul 2027 00:00:00 GMT"},
    "Link": {"description": "What takes its place", "example": '<https://example.com/>; rel="deprecation"'},
    "Retry-After": {"description": "Seconds", "example": "12"},
    "WWW-Authenticate": {"description": "RFC 6750", "example": 'Bearer realm="wonderland", error="invalid_token"'},
    idempotency.REPLAYED: {"description": "`true`: this was answered before, and is not done twice", "example": "true"},
}
_IF_NONE_MATCH: Final[Mapping[str, Any]] = {
    "name": "If-None-Match",
    "in": "header",
    "required": False,
    "description": "The `ETag` of what you have: 304 and no body where it is still the same",
    "schema": {"type": "string"},
    "example": _TAG,
}

_IF_MATCH: Final[Mapping[str, Any]] = {
    **_IF_NONE_MATCH,
    "name": "If-Match",
    "description": "The `ETag` of what you saw: 412, and nothing is changed, where it is another by now",
}


def complete(document: Document) -> None:
    """Add security, limits, headers and examples to every operation, in place."""
    components = document["components"]
    components["securitySchemes"] = _security_schemes()
    components["headers"] = {name: {**about, "schema": {"type": "string"}} for name, about in _HEADERS.items()}
    for told in document.get("webhooks", {}).values():
        del told["post"]["responses"]["422"]  # the receiver's business
        _add_examples("", told["post"], components["schemas"])
    components["responses"] = {_PROBLEM: errors.anywhere()}
    for path, method, operation in operations(document):
        tags = [str(tag) for tag in operation.get("tags", ())]
        _describe_access(path, method, tags, operation)
        responses = operation["responses"]
        if operation.get("requestBody") is not None:
            errors.add_problem(responses, TooLarge)
        if "application/json" in responses.get("422", {}).get("content", ()):
            del responses["422"]  # FastAPI's own; refusals of fields are problems, too.
            errors.add_problem(responses, Unprocessable)
        _describe_headers(operation)
        _add_examples(path, operation, components["schemas"])
        responses["default"] = {"$ref": f"#/components/responses/{_PROBLEM}"}


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
        "metrics": {"type": "http", "scheme": "bearer", "description": "The metrics token of this server's settings"},
    }


def _describe_access(path: str, method: str, tags: list[str], operation: dict[str, Any]) -> None:
    """Who may call an operation, and how they are refused."""
    responses = operation["responses"]
    if tags == [NETWORK]:
        scopes = [RID_SERVICE if method == "post" else RID_DISPLAY]
        operation["security"] = [{"client": scopes}]
        responses.pop("422", None)  # 400 there, as the standard has it
    elif OPEN.isdisjoint(tags):
        scopes = sorted(frozenset[str]().union(*(scopes_for(method, tag) for tag in tags)))
        operation["security"] = [{"person": []}, *({"client": [scope]} for scope in scopes)]
    else:
        operation.setdefault("security", [])
        scopes = []
    refusals: list[type[Problem] | Problem] = []
    if scopes:
        refusals = [TokenRefused, ScopeMissing(scopes)]
    elif operation.get("security"):
        refusals = [SignInRequired, Forbidden]
    if operation.get("security") or path in LIMITED:
        refusals.append(TooManyRequests)
    for refusal in refusals:
        errors.add_problem(responses, refusal)
    for status in ("401", "403") if scopes else ():
        _add_headers(responses[status], "WWW-Authenticate")
    if refusals:
        for status, response in responses.items():
            if status[0] in "23":
                _add_headers(response, "RateLimit-Policy", "RateLimit")
    if "429" in responses:
        _add_headers(responses["429"], "Retry-After", *(("RateLimit-Policy", "RateLimit") if refusals else ()))


def _describe_headers(operation: dict[str, Any]) -> None:
    """What follows for headers from a mark of deprecation, a 304, a 412, and a key by which a write may come twice."""
    responses = operation["responses"]
    if operation.get("deprecated"):
        for response in responses.values():
            _add_headers(response, "Deprecation", "Sunset", "Link")
    if "304" in responses:
        operation.setdefault("parameters", []).append(dict(_IF_NONE_MATCH))
        for status in ("200", "304"):
            _add_headers(responses[status], "ETag")
    if "412" in responses:
        operation.setdefault("parameters", []).append(dict(_IF_MATCH))
        if "200" in responses:
            _add_headers(responses["200"], "ETag")
    if any(each["name"] == idempotency.HEADER for each in operation.get("parameters", ())):
        for status, response in responses.items():
            if status[0] == "2":
                _add_headers(response, idempotency.REPLAYED)


def _add_headers(response: dict[str, Any], *names: str) -> None:
    told = response.setdefault("headers", {})
    told |= {name: {"$ref": f"#/components/headers/{name}"} for name in names if name not in told}


def _add_examples(path: str, operation: dict[str, Any], schemas: Mapping[str, Any]) -> None:
    parameters = operation.get("parameters", ())
    for parameter in parameters:
        if "example" not in parameter and (parameter.get("required") or "default" not in parameter.get("schema", {})):
            parameter["example"] = example_of(parameter.get("schema", {}), schemas, parameter["name"])
    for media in operation.get("requestBody", {}).get("content", {}).values():
        _fill(media, schemas)
    for parameter in parameters:
        if parameter["in"] == "path":
            path = path.replace(f"{{{parameter['name']}}}", str(parameter["example"]))
    for response in operation["responses"].values():
        for kind, media in response.get("content", {}).items():
            if kind == errors.MEDIA_TYPE:
                for each in media["examples"].values():
                    each["value"]["instance"] = path
                    if each["value"]["detail"] == str(Unprocessable.example):
                        each["value"]["errors"] = [_blamed(operation)]
            else:
                _fill(media, schemas)


def _fill(media: dict[str, Any], schemas: Mapping[str, Any]) -> None:
    if "example" not in media and "examples" not in media and media.get("schema") and media["schema"] != errors.BINARY:
        media["example"] = example_of(media["schema"], schemas)


def _blamed(operation: Mapping[str, Any]) -> dict[str, str]:
    """What may be wrong with a field or parameter of an operation, as `errors` names it."""
    for parameter in operation.get("parameters", ()):
        schema, where = parameter.get("schema", {}), f"{parameter['in']}.{parameter['name']}"
        if "pattern" in schema:
            return {"path": where, "message": str(said("field_pattern", pattern=schema["pattern"]))}
        if "maximum" in schema:
            return {"path": where, "message": str(said("field_at_most", le=schema["maximum"]))}
    if operation.get("requestBody") is not None:
        return {"path": "body.nane", "message": str(said("field_unknown"))}
    return {"path": "query.limitt", "message": str(said("field_unknown"))}
