"""Writes the reference of every type of problem that the server answers, and of its operations (``make docs``)."""

from __future__ import annotations

import sys
from pathlib import Path

from wonderland_backend.description import openapi
from wonderland_backend.reference.problems import catalogue
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


def page() -> str:
    """The whole page in Markdown."""
    lines = [
        "# Types of problems",
        "",
        "Made by `make docs` from the server’s own list; do not edit. Every error of the REST interface is one of",
        "these (RFC 9457). A program tells them apart by `type`, which never changes; a running server has the same",
        "list at `GET /api/v1/problems`, in the language that is asked for. More may come at any time: treat one that",
        "you do not know by its status. What the *contract* refuses has [codes of its own](refusals.md).",
        "",
    ]
    for each in catalogue("en", openapi(new_app(Settings(), frozenset(), None))):
        where = "any operation" if each["anywhere"] else ", ".join(f"`{name}`" for name in each["operations"])
        lines += [
            f"## {each['title']} ({each['status']}): `{each['type'].rpartition(':')[2]}`",
            "",
            _prose(each["description"]),
            "",
            "| | |",
            "|---|---|",
            f"| `type` | `{each['type']}` |",
            f"| It may say | {_prose(each['detail'])} |",
            f"| Answered by | {where or 'what is no operation of the interface'} |",
            "",
        ]
    return "\n".join(lines).rstrip() + "\n"


def _prose(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
