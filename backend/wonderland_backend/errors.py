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
from pydantic import Field
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException

from wonderland_backend.languages import Language, language_of
from wonderland_backend.problem_texts import in_language, said, title_in
from wonderland_backend.schemas import ApiModel

logger = logging.getLogger(__name__)

MEDIA_TYPE: Final = "application/problem+json"
TYPE_BASE: Final = "urn:wonderland:problem:"
PROBLEM_SCHEMA: Final = "#/components/schemas/ProblemDetails"
BINARY: Final = {"type": "string", "format": "binary"}
"""The schema of an answer that is bytes."""
_RENAMED: Final = {413: "Content Too Large", 422: "Unprocessable Content"}
NOT_MODIFIED: Final = "The client has it already."


class BackendError(Exception):
    """Base of what the backend raises on purpose."""


class SettingsError(BackendError):
    """A setting, an option or a file named by one is wrong; the text names it."""


class DatabaseError(BackendError):
    """The database is of another channel, of a later version, or cannot be used."""


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


class Problem(BackendError):  # noqa: N818 - the standard's own word
    """Raised by an endpoint; becomes a problem+json answer."""

    status: HTTPStatus = HTTPStatus.INTERNAL_SERVER_ERROR
    code: str = "internal"
    example: str = "An unexpected error; the server's log has it under 5f0c21aa."
    """What it may say, for the description."""

    def __init__(self, detail: str, *errors: tuple[str, str], headers: dict[str, str] | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.errors = errors
        self.headers = headers or {}


class NotFound(Problem):
    """There is no such thing, as far as the ledger was mirrored."""

    status, code = HTTPStatus.NOT_FOUND, "not-found"
    example = "There is no such thing here, or none that is yours to see."


class SwitchedOff(Problem):
    """This server's administrator has switched it off; `GET /status` says what is on."""

    status, code = HTTPStatus.NOT_FOUND, "switched-off"
    example = said("live_geojson_off")


class BadRequest(Problem):
    """A cursor or a combination of parameters that means nothing."""

    status, code = HTTPStatus.BAD_REQUEST, "bad-request"
    example = "`cursor` is not one of this list's; pass the `next` of the page before, unchanged."


class SignInRequired(Problem):
    """Nobody is signed in."""

    status, code = HTTPStatus.UNAUTHORIZED, "sign-in-required"
    example = said("sign_in_first")


class Forbidden(Problem):
    """Not allowed to whoever is signed in."""

    status, code = HTTPStatus.FORBIDDEN, "forbidden"
    example = "This needs the role inspector; yours: viewer. An administrator can change it."


class Conflict(Problem):
    """Somebody else was quicker; nothing was overwritten."""

    status, code = HTTPStatus.CONFLICT, "conflict"
    example = "Somebody else has changed it since you looked; look at it again."


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
    example = "The ledger cannot be asked just now; try again in a moment."


class TooManyRequests(Problem):
    """Too many requests; try again later."""

    status, code = HTTPStatus.TOO_MANY_REQUESTS, "too-many-requests"
    example = "More than 600 requests in a minute; go on in 12 s."


class TooLarge(Problem):
    """The body is larger than this server takes."""

    status, code = HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too-large"
    example = "The body is larger than the 65536 bytes allowed here."


def title_of(status: int) -> str:
    """The status as RFC 9110 names it; Python has older names for some, and not the same in every version."""
    return _RENAMED.get(status) or HTTPStatus(status).phrase


def problem_response(
    path: str,
    status: int,
    code: str,
    detail: str,
    *,
    errors: Any = (),
    headers: dict[str, str] | None = None,
    language: Language = "en",
) -> Response:
    """An answer in problem+json."""
    title, detail = title_in(code, language) or title_of(status), in_language(detail, language)
    body: dict[str, Any] = {
        "type": TYPE_BASE + code,
        "title": title,
        "status": status,
        "detail": detail,
        "instance": path,
    }
    if errors:
        body["errors"] = [{"path": where, "message": message} for where, message in errors]
    return Response(orjson.dumps(body), status, headers, MEDIA_TYPE)


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
    detail = problem.example if isinstance(problem, type) else problem.detail
    found = {
        "type": TYPE_BASE + problem.code,
        "title": title_of(problem.status),
        "status": int(problem.status),
        "detail": detail,
        "instance": "/",
    }
    if isinstance(problem, Problem) and problem.errors:
        found["errors"] = [{"path": where, "message": message} for where, message in problem.errors]
    return found


_CODES: Final = {404: "not-found", 405: "method-not-allowed", 413: "too-large", 400: "bad-request"}
_DETAILS: Final = {
    404: said("nothing_here"),
    405: said("method_not_allowed"),
}


def install(app: FastAPI) -> None:
    """Make every error of the application a problem+json answer."""

    async def on_problem(request: Request, error: Exception) -> Response:
        assert isinstance(error, Problem)
        return problem_response(
            request.url.path,
            int(error.status),
            error.code,
            error.detail,
            errors=error.errors,
            headers=error.headers,
            language=language_of(request),
        )

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        phrase = HTTPStatus(error.status_code).phrase
        told = error.detail if error.detail and error.detail != phrase else ""
        return problem_response(
            request.url.path,
            error.status_code,
            _CODES.get(error.status_code, phrase.lower().replace(" ", "-")),
            told or _DETAILS.get(error.status_code, phrase),
            headers=dict(error.headers or {}),
            language=language_of(request),
        )

    async def on_validation(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        errors = [(".".join(str(part) for part in each["loc"]), str(each["msg"])) for each in error.errors()[:20]]
        detail = said("request_fields")
        return problem_response(
            request.url.path, 422, "invalid-request", detail, errors=errors, language=language_of(request)
        )

    async def on_busy(request: Request, error: Exception) -> Response:
        logger.warning("no connection to the database became free for %s: %s", request.url.path, error)
        detail = said("database_busy")
        return problem_response(
            request.url.path, 503, "database-busy", detail, headers={"Retry-After": "5"}, language=language_of(request)
        )

    async def on_anything(request: Request, error: Exception) -> Response:
        reference = secrets.token_hex(4)
        logger.error("unexpected error %s at %s", reference, request.url.path, exc_info=error)
        detail = f"An unexpected error; the server's log has it under {reference}."
        return problem_response(request.url.path, 500, "internal", detail, language=language_of(request))

    app.add_exception_handler(Problem, on_problem)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(PoolTimeoutError, on_busy)
    app.add_exception_handler(Exception, on_anything)
