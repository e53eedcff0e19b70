"""Writes the reference of every type of problem that the server answers, and of its operations (``make docs``)."""

from __future__ import annotations

from pages import prose, table, write

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
            prose(each["description"]),
            "",
            *table(
                ("", ""),
                [
                    ("`type`", f"`{each['type']}`"),
                    ("It may say", prose(each["detail"])),
                    ("Answered by", where or "what is no operation of the interface"),
                ],
            ),
            "",
        ]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    write(page)
