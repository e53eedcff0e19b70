"""The catalogue of problems' types: whole, the same as what is answered, and open to whoever has no token yet."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from kit.description import document

import wonderland_backend
from wonderland_backend.errors import ANYWHERE
from wonderland_backend.reference.openapi import operations
from wonderland_backend.reference.problems import kinds

DOCUMENT = document()
TYPE = "urn:wonderland:problem:"
SOURCE = Path(wonderland_backend.__file__).parent


@pytest.fixture
async def catalogue(running):
    running.http.cookies.clear()
    answer = await running.get("/problems")
    assert answer.status_code == 200, answer.text
    again = await running.get("/problems", headers={"If-None-Match": answer.headers["ETag"]})
    assert again.status_code == 304
    schema = {"$ref": "#/components/schemas/ProblemTypes", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(answer.json())] == []
    found = {each["type"]: each for each in answer.json()["items"]}
    assert len(found) == len(answer.json()["items"])
    return found


async def test_every_kind_that_the_program_has_is_in_it(catalogue):
    for module in pkgutil.walk_packages(wonderland_backend.__path__, "wonderland_backend."):
        importlib.import_module(module.name)
    ours = [each for each in kinds() if each.__module__.startswith("wonderland_backend.")]
    assert {TYPE + each.code for each in ours} == set(catalogue)
    for each in ours:
        told = catalogue[TYPE + each.code]
        assert told["status"] == each.status, "one type, one status"
        assert told["anywhere"] is (each in ANYWHERE)
        assert (each.__doc__ or "").split("\n")[0] in told["description"]


async def test_it_names_the_operations_whose_answers_are_described(catalogue):
    described = {}
    for _, _, operation in operations(DOCUMENT):
        for response in operation["responses"].values():
            media = response.get("content", {}).get("application/problem+json", {})
            for each in media.get("examples", {}).values():
                described.setdefault(each["value"]["type"], set()).add(operation["operationId"])
    assert {name: set(told["operations"]) for name, told in catalogue.items() if told["operations"]} == described
    nowhere = {name for name, told in catalogue.items() if not told["operations"] and not told["anywhere"]}
    # Of InterUSS's tests, which are switched on by a setting and then described by InterUSS.
    assert nowhere == {f"{TYPE}test-conflict"}


def test_no_answer_has_a_type_of_its_own():
    """Every answer in problem+json is written by `problem_response`, from a Problem."""
    for path in SOURCE.rglob("*.py"):
        if path.name in {"errors.py", "problem_texts.py"} and path.parent == SOURCE:
            continue
        text = path.read_text()
        assert "urn:wonderland:problem" not in text.replace('["urn:wonderland:problem:conflict"]', ""), path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and node.value == "application/problem+json":
                pytest.fail(f"{path}:{node.lineno} writes a problem by itself")


async def test_what_is_answered_is_in_it(running, catalogue):
    asked = {
        "unknown-host": await running.http.get("/api/v1/health", headers={"Host": "elsewhere.example"}),
        "foreign-origin": await running.http.post("/api/v1/session", headers={"Origin": "https://elsewhere.example"}),
        "method-not-allowed": await running.http.put("/api/v1/session"),
        "not-found": await running.get("/nowhere"),
        "sign-in-required": await running.get("/pads"),
        "invalid-token": await running.get("/pads", headers={"Authorization": "Bearer x"}),
        "invalid-request": await running.http.post("/api/v1/session", content=b"{", headers=JSON),
        "too-large": await running.http.post("/api/v1/session", content=b" " * 10_000_000, headers=JSON),
    }
    for code, answer in asked.items():
        told = catalogue[TYPE + code]
        body = answer.json()
        assert (body["type"], body["status"], body["title"]) == (told["type"], told["status"], told["title"]), code
        assert (answer.status_code, answer.headers["content-type"]) == (told["status"], "application/problem+json")
        schema = DOCUMENT["components"]["schemas"]["ProblemDetails"] | {"components": DOCUMENT["components"]}
        assert [each.message for each in Draft202012Validator(schema).iter_errors(body)] == []


JSON = {"Content-Type": "application/json"}


@pytest.mark.parametrize("body", [b"\xff", b"{", b"[" * 60_000, b'{"token": "\\ud800"}', b"nul\x00"])
async def test_what_cannot_be_read_is_a_problem_with_its_field(running, body):
    answer = await running.http.post("/api/v1/session", content=body, headers=JSON)
    assert (answer.status_code, answer.json()["type"]) == (422, f"{TYPE}invalid-request"), answer.text
    assert all(each["path"].startswith("body") for each in answer.json()["errors"])


async def test_it_is_told_in_the_language_that_is_asked_for(running):
    answer = await running.get("/problems", headers={"Accept-Language": "fi"})
    told = {each["type"]: each for each in answer.json()["items"]}[f"{TYPE}sign-in-required"]
    assert (told["title"], told["detail"]) == ("Kirjautuminen vaaditaan", "Kirjaudu ensin.")
