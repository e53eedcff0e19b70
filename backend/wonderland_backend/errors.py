"""Errors of the REST interface: problem details (RFC 9457), each cause with its own ``type``."""

from __future__ import annotations

import inspect
import logging
import secrets
from http import HTTPStatus
from typing import Any, Final

import orjson
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from fastapi.routing import iter_route_contexts
from pydantic import Field
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import Scope

from wonderland.problems import Said, SaidError, in_language, said
from wonderland_backend.field_texts import field_text
from wonderland_backend.languages import language_of
from wonderland_backend.problem_texts import STANDBY, TYPE_BASE, title_in
from wonderland_backend.schemas import ApiModel

logger = logging.getLogger(__name__)

MEDIA_TYPE: Final = "application/problem+json"
PROBLEM_SCHEMA: Final = "#/components/schemas/ProblemDetails"
BINARY: Final = {"type": "string", "format": "binary"}
"""The schema of an answer that is bytes."""
_RENAMED: Final = {413: "Content Too Large", 422: "Unprocessable Content"}
NOT_MODIFIED: Final = "The client has it already."
FieldError = tuple[str, Said | str]
"""The path of a field or parameter, and what is wrong with it; what other libraries say is a text."""


class BackendError(Exception):
    """Base of what the backend raises on purpose."""


class SettingsError(BackendError):
    """A setting, an option or a file named by one is wrong; the text names it."""


class DatabaseError(BackendError):
    """The database is of another channel, of a later version, or cannot be used."""


class Elsewhere(BackendError):  # noqa: N818 - it says where to ask
    """Only the backend on duty has what is asked for; raised before anything was done or answered."""


class MirrorHalted(BackendError):  # noqa: N818 - a state that holds until a person acts, not an accident
    """The ledger's blocks contradict each other or the database; nothing more is mirrored until somebody looks."""


class FieldProblem(ApiModel):
    """What is wrong with one field or parameter of a request."""

    path: str
    message: str


class ProblemDetails(ApiModel):
    """Why a request was refused (RFC 9457)."""

    type: str = Field(description="URN of the kind of problem; stable, for machines")
    title: str
    status: int
    detail: str = Field(description="What was wrong and what to do")
    instance: str = Field(description="The path that was asked for")
    errors: list[FieldProblem] | None = None


class Problem(SaidError, BackendError):  # noqa: N818 - the standard's own word
    """Something failed here. Problems with causes of their own are raised by endpoints."""

    status: HTTPStatus = HTTPStatus.INTERNAL_SERVER_ERROR
    code: str = "internal"
    example: Said = said("internal", reference="5f0c21aa")
    """What it may say, for the description."""

    def __init__(self, said: Said, *errors: FieldError, headers: dict[str, str] | None = None) -> None:
        super().__init__(said)
        self.errors = errors
        self.headers = headers or {}


class NotFound(Problem):
    """There is no such thing, as far as the ledger was mirrored."""

    status, code = HTTPStatus.NOT_FOUND, "not-found"
    example = said("no_such_thing")


class SwitchedOff(Problem):
    """This server's administrator has switched it off; `GET /status` says what is on."""

    status, code = HTTPStatus.NOT_FOUND, "switched-off"
    example = said("live_geojson_off")


class NotAcceptable(Problem):
    """It is not to be had in the form that was asked for."""

    status, code = HTTPStatus.NOT_ACCEPTABLE, "not-acceptable"
    example = said("statements_off")


class BadRequest(Problem):
    """A cursor or a combination of parameters that means nothing."""

    status, code = HTTPStatus.BAD_REQUEST, "bad-request"
    example = said("bad_cursor")


class SignInRequired(Problem):
    """Nobody is signed in."""

    status, code = HTTPStatus.UNAUTHORIZED, "sign-in-required"
    example = said("sign_in_first")


class Forbidden(Problem):
    """Not allowed to whoever is signed in."""

    status, code = HTTPStatus.FORBIDDEN, "forbidden"
    example = said("role_needed", needed="inspector", theirs="viewer")


class Conflict(Problem):
    """Somebody else was quicker; nothing was overwritten."""

    status, code = HTTPStatus.CONFLICT, "conflict"
    example = said("changed_by_other")


class PreconditionFailed(Problem):
    """It has changed since the client saw it: `If-Match` names another state."""

    status, code = HTTPStatus.PRECONDITION_FAILED, "precondition-failed"
    example = said("changed_since_seen")


class Unprocessable(Problem):
    """Well-formed, but it cannot be done as asked; `errors` names the field where one is to blame."""

    status, code = HTTPStatus.UNPROCESSABLE_ENTITY, "invalid-request"
    example = said("request_fields")


class LedgerAway(Problem):
    """The ledger cannot be asked just now."""

    status, code = HTTPStatus.SERVICE_UNAVAILABLE, "ledger-away"
    example = said("ledger_away")


class RowsDiffer(Problem):
    """What is kept here is not what the ledger says."""

    status, code = HTTPStatus.SERVICE_UNAVAILABLE, "rows-differ"
    example = said("rows_differ")


class TooManyRequests(Problem):
    """Too many requests; try again later."""

    status, code = HTTPStatus.TOO_MANY_REQUESTS, "too-many-requests"
    example = said("too_many_requests", quota=600, wait_s=12)


class TooLarge(Problem):
    """The body is larger than this server takes."""

    status, code = HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too-large"
    example = said("body_too_large", limit=65536)


class MethodNotAllowed(Problem):
    """There is something at this path, but not to be used by this method; `Allow` names those that are."""

    status, code = HTTPStatus.METHOD_NOT_ALLOWED, "method-not-allowed"
    example = said("method_not_allowed")


class UnknownHost(Problem):
    """The request was meant for another name than this server's."""

    status, code = HTTPStatus.MISDIRECTED_REQUEST, "unknown-host"
    example = said("unknown_host")


class ForeignOrigin(Problem):
    """A page of another site asked."""

    status, code = HTTPStatus.FORBIDDEN, "foreign-origin"
    example = said("foreign_origin")


class SetUpRequired(Problem):
    """No administrator has set the server up yet."""

    status, code = HTTPStatus.FORBIDDEN, "set-up-required"
    example = said("set_up_first")


class DatabaseBusy(Problem):
    """The server has more to do than its database can take just now."""

    status, code = HTTPStatus.SERVICE_UNAVAILABLE, "database-busy"
    example = said("database_busy")


class Standby(Problem):
    """This server waits for another's end; nothing was done."""

    status, code = HTTPStatus.SERVICE_UNAVAILABLE, STANDBY
    example = said("standby")


class OutcomeUnknown(Problem):
    """The server that was to do it fell silent: look whether it was done before you ask again."""

    status, code = HTTPStatus.GATEWAY_TIMEOUT, "outcome-unknown"
    example = said("outcome_unknown")


def title_of(status: int) -> str:
    """The status as RFC 9110 names it; Python has older names for some, and not the same in every version."""
    return _RENAMED.get(status) or HTTPStatus(status).phrase


def problem_response(scope: Scope, problem: Problem) -> Response:
    """An answer in problem+json, in the language that the request prefers."""
    language = language_of(HTTPConnection(scope))
    body: dict[str, Any] = {
        "type": TYPE_BASE + problem.code,
        "title": title_in(problem.code, language) or title_of(problem.status),
        "status": int(problem.status),
        "detail": in_language(problem.said, language),
        "instance": scope["path"],
    }
    if problem.errors:
        body["errors"] = [{"path": where, "message": in_language(what, language)} for where, what in problem.errors]
    return Response(orjson.dumps(body), int(problem.status), problem.headers, MEDIA_TYPE)


def field_errors(error: RequestValidationError) -> list[FieldError]:
    """Which fields and parameters are not as they must be, and why; the first 20 of them."""
    return [(".".join(str(part) for part in each["loc"]), field_text(each)) for each in error.errors()[:20]]


def unreadable(error: HTTPException) -> FieldError | None:
    """What the framework says of a body that is not even text; None for another error."""
    if error.status_code != HTTPStatus.BAD_REQUEST or isinstance(error.__cause__, SaidError):
        return None
    return "body", said("field_no_json", error=str(error.__cause__))


def documented(*problems: type[Problem] | Problem, etag: bool = False) -> dict[int | str, dict[str, Any]]:
    """The ``responses`` of a route for OpenAPI: these problems beside that of not being signed in.

    A problem itself in place of its class is the example. `etag`: the answer has one (`responses.resource`).
    """
    told: dict[int | str, Any] = {}
    others = () if any(each.status == HTTPStatus.UNAUTHORIZED for each in problems) else (SignInRequired,)
    for problem in (*others, *problems):
        add_problem(told, problem)
    if etag:
        told["304"] = {"description": NOT_MODIFIED}
    return dict(sorted(told.items()))


def add_problem(told: dict[int | str, Any], problem: type[Problem] | Problem) -> None:
    """Have the ``responses`` of an operation name this problem, with an example, beside others of its status."""
    kind = problem if isinstance(problem, type) else type(problem)
    description = inspect.cleandoc(kind.__doc__ or "")
    response = told.setdefault(str(int(kind.status)), {"description": description})
    if description not in response["description"]:
        response["description"] += f" {description}"
    media = response.setdefault("content", {}).setdefault(MEDIA_TYPE, {"schema": {"$ref": PROBLEM_SCHEMA}})
    media.setdefault("examples", {})[kind.code] = {"value": example_of(problem)}


def example_of(problem: type[Problem] | Problem) -> dict[str, Any]:
    """The body that such a problem has, but for its `instance`."""
    detail = problem.example if isinstance(problem, type) else problem.said
    found = {
        "type": TYPE_BASE + problem.code,
        "title": title_of(problem.status),
        "status": int(problem.status),
        "detail": str(detail),
        "instance": "/",
    }
    if isinstance(problem, Problem) and problem.errors:
        found["errors"] = [{"path": where, "message": str(what)} for where, what in problem.errors]
    return found


ANYWHERE: Final = (
    UnknownHost, ForeignOrigin, SetUpRequired, MethodNotAllowed, DatabaseBusy, Standby, OutcomeUnknown, Problem,
)  # fmt: skip
"""What any operation may answer, whatever was asked."""


def anywhere() -> dict[str, Any]:
    """The response of OpenAPI for these."""
    return {
        "description": "What any operation may answer; all types of problems: `GET /api/v1/problems`",
        "content": {
            MEDIA_TYPE: {
                "schema": {"$ref": PROBLEM_SCHEMA},
                "examples": {each.code: {"value": example_of(each)} for each in ANYWHERE},
            }
        },
    }


NOTHING: Final = "nothing"
"""The name of routes by which there is nothing at a path."""


def methods_at(request: Request) -> set[str]:
    """What may be done with a path; the router itself names one route's methods only. Empty: there is nothing."""
    found: set[str] = set()
    for route in iter_route_contexts(request.app.routes):
        if route.methods is None or route.name == NOTHING or ":path}" in (route.path or ""):
            continue
        if route.path_regex.match(request.url.path):
            found |= route.methods
    return found | ({"HEAD"} if "GET" in found else set())


def _allowed(request: Request, error: HTTPException) -> str:
    """The `Allow` of an answer; empty where there is nothing by any method. The console’s pages have no path here."""
    if (found := methods_at(request)) or getattr(request.scope.get("route"), "name", "") == NOTHING:
        return ", ".join(sorted(found))
    return (error.headers or {}).get("Allow", "")


def install(app: FastAPI) -> None:
    """Make every error of the application a problem+json answer."""

    async def on_problem(request: Request, error: Exception) -> Response:
        assert isinstance(error, Problem)
        return problem_response(request.scope, error)

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        cause = error.__cause__
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED and (allow := _allowed(request, error)):
            return problem_response(request.scope, MethodNotAllowed(MethodNotAllowed.example, headers={"Allow": allow}))
        if error.status_code in {HTTPStatus.NOT_FOUND, HTTPStatus.METHOD_NOT_ALLOWED}:
            return problem_response(request.scope, NotFound(said("nothing_here")))
        if isinstance(cause, SaidError):  # the boundary's, raised while somebody read the body
            return problem_response(request.scope, TooLarge(cause.said))
        if (why := unreadable(error)) is not None:
            return problem_response(request.scope, Unprocessable(Unprocessable.example, why))
        return await on_anything(request, error)

    async def on_validation(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return problem_response(request.scope, Unprocessable(said("request_fields"), *field_errors(error)))

    async def on_busy(request: Request, error: Exception) -> Response:
        logger.warning("no connection to the database became free for %s: %s", request.url.path, error)
        return problem_response(request.scope, DatabaseBusy(DatabaseBusy.example, headers={"Retry-After": "5"}))

    async def on_anything(request: Request, error: Exception) -> Response:
        reference = secrets.token_hex(4)
        logger.error("unexpected error %s at %s", reference, request.url.path, exc_info=error)
        return problem_response(request.scope, Problem(said("internal", reference=reference)))

    app.add_exception_handler(Problem, on_problem)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(PoolTimeoutError, on_busy)
    app.add_exception_handler(Exception, on_anything)
