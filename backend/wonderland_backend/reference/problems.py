"""All types of problems that this server can answer, for programs: what a client has to tell apart, in one place."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response
from pydantic import Field

from wonderland.messages import Language
from wonderland_backend import errors
from wonderland_backend.errors import Problem
from wonderland_backend.languages import language_of
from wonderland_backend.problem_texts import TYPE_BASE, title_in
from wonderland_backend.reference.openapi import Document, operations
from wonderland_backend.responses import resource
from wonderland_backend.schemas import ApiModel

router = APIRouter(tags=["server"])


class ProblemType(ApiModel):
    """A kind of problem."""

    type: str = Field(examples=["urn:wonderland:problem:conflict"], description="As problems have it; it never changes")
    title: str = Field(examples=["Conflict"])
    status: int = Field(examples=[409])
    description: str = Field(examples=["Somebody else was quicker; nothing was overwritten."])
    detail: str = Field(description="What such a problem may say", examples=["Somebody changed it meanwhile."])
    anywhere: bool = Field(description="Any operation may answer it")
    operations: list[str] = Field(
        description="Operations (`operationId`) that answer it for reasons of their own", examples=[["act_on_alert"]]
    )


class ProblemTypes(ApiModel):
    """All kinds of problems, by type."""

    items: list[ProblemType]


@router.get("/problems", response_model=ProblemTypes, responses={304: {"description": errors.NOT_MODIFIED}})
def list_problem_types(request: Request) -> Response:
    """All types of problems that this server can answer; needs no sign-in.

    More may come at any time: treat one that you do not know by its status.
    """
    return resource(request, {"items": catalogue(language_of(request), request.app.openapi())})


def catalogue(language: Language, openapi: Document) -> list[dict[str, Any]]:
    """Each type of problem, by code, as `ProblemType` has it; `openapi` says which operations answer it."""
    by_code: dict[str, dict[str, Any]] = {}
    used = _operations_by_code(openapi)
    for kind in kinds():
        described = inspect.cleandoc(kind.__doc__ or "")
        if kind.code in by_code:  # the same for a client, of two causes
            by_code[kind.code]["description"] += f" {described}"
            continue
        by_code[kind.code] = {
            "type": TYPE_BASE + kind.code,
            "title": title_in(kind.code, language) or errors.title_of(kind.status),
            "status": int(kind.status),
            "description": described,
            "detail": kind.example.text(language),
            "anywhere": kind in errors.ANYWHERE,
            "operations": sorted(used.get(kind.code, ())),
        }
    return [by_code[code] for code in sorted(by_code)]


def kinds() -> Iterator[type[Problem]]:
    """Every kind of problem that this program has."""
    waiting = [Problem]
    while waiting:
        kind = waiting.pop()
        yield kind
        waiting += sorted(kind.__subclasses__(), key=lambda each: each.__qualname__, reverse=True)


def _operations_by_code(document: Document) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for _, _, operation in operations(document):
        for response in operation["responses"].values():
            for code in response.get("content", {}).get(errors.MEDIA_TYPE, {}).get("examples", ()):
                found.setdefault(code, set()).add(operation["operationId"])
    return found
