"""Writes the reference of the REST interface's operations from its description (``make docs``)."""

from __future__ import annotations

from typing import Any

from pages import prose, table, write

from wonderland_backend.description import openapi
from wonderland_backend.reference.openapi import operations
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


def page() -> str:
    """The whole page in Markdown."""
    lines = [
        "# Operations of the REST interface",
        "",
        "Made by `make docs` from the server’s own description; do not edit. A running server has all of it, with",
        "parameters, answers and examples: `/api/v1/reference` for people, `/api/v1/openapi.json` (OpenAPI 3.1) and",
        "`/api/v1/asyncapi.json` (AsyncAPI 3: what is pushed) for programs. What holds for all of them is in",
        "[the API](../api/README.md), what they refuse in [types of problems](problems.md).",
        "",
        "*Who*: *everybody* needs no sign-in; *people* are signed in, and a role may see less or be refused; a",
        "*machine* needs one of the scopes that are named.",
    ]
    by_tag: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
    for path, method, operation in operations(openapi(new_app(Settings(), frozenset(), None))):
        by_tag.setdefault(operation["tags"][0], []).append((path, method, operation))
    for tag in sorted(by_tag):
        rows = [
            (f"`{method.upper()} {path}`", prose(operation["description"].split("\n\n")[0]), _who(operation))
            for path, method, operation in by_tag[tag]
        ]
        lines += ["", f"## {tag[0].upper()}{tag[1:]}", "", *table(("Operation", "", "Who"), rows)]
    return "\n".join(lines) + "\n"


def _who(operation: dict[str, Any]) -> str:
    ways = [next(iter(each.items())) for each in operation["security"]]
    machines = [scope for way, scopes in ways if way == "client" for scope in scopes]
    named = {"person": "people", "metrics": "the metrics token"}
    return ", ".join([named[way] for way, _ in ways if way in named] + machines) or "everybody"


if __name__ == "__main__":
    write(page)
