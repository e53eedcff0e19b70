"""Statements of a domain stand in its `queries` and its `store`; nowhere else does anybody speak SQL."""

from __future__ import annotations

import ast
from pathlib import Path

BACKEND = Path(__file__).resolve().parents[2] / "backend" / "wonderland_backend"
STATEMENTS = {"select", "insert", "update", "delete", "text", "union", "union_all", "exists"}
PLACES = {"queries", "store", "db"}
BESIDES = {"narrowing.py", "person.py", "leader_election/lock.py"}
"""Subqueries that narrow others' statements; a lock that is a statement."""


def statements_of(source: str) -> set[str]:
    """What a module imports from SQLAlchemy to make statements with."""
    return {
        f"{node.module}.{each.name}"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "sqlalchemy"
        for each in node.names
        if each.name in STATEMENTS
    } | {
        each.name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Import)
        for each in node.names
        if each.name.partition(".")[0] == "sqlalchemy"
    }


def test_statements_stand_in_queries_and_stores():
    places = {path: path.relative_to(BACKEND) for path in BACKEND.rglob("*.py")}
    speaking = {path: place for path, place in places.items() if statements_of(path.read_text())}
    elsewhere = [str(place) for place in speaking.values() if PLACES.isdisjoint(place.with_suffix("").parts)]
    assert set(elsewhere) == BESIDES


def test_a_statement_elsewhere_would_be_seen():
    assert statements_of("from sqlalchemy import func, select as wanted") == {"sqlalchemy.select"}
    assert statements_of("from sqlalchemy.dialects.postgresql import insert") == {
        "sqlalchemy.dialects.postgresql.insert"
    }
    assert statements_of("import sqlalchemy as sa")
    assert not statements_of("from sqlalchemy import func, or_\nfrom os import remove as delete")
