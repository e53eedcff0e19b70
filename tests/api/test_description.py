"""The description (OpenAPI 3.1): whole, with an example for every operation and error, each of them as its schema has it."""

from __future__ import annotations

import re

from jsonschema import Draft202012Validator

from backend.clients.scopes import SCOPES
from backend.description import openapi
from backend.reference.openapi import operations
from backend.routes import new_app
from backend.settings import Settings

DOCUMENT = openapi(new_app(Settings(), frozenset(), None))


def errors(schema, value):
    whole = {**schema, "components": DOCUMENT["components"]}
    return [f"{list(each.absolute_path)}: {each.message}" for each in Draft202012Validator(whole).iter_errors(value)]


def contents():
    for path, method, operation in operations(DOCUMENT):
        name = f"{method} {path}"
        for kind, media in operation.get("requestBody", {}).get("content", {}).items():
            yield f"{name} request {kind}", media
        for status, response in operation["responses"].items():
            for kind, media in response.get("content", {}).items():
                yield f"{name} {status} {kind}", media


def test_every_content_has_an_example_that_its_schema_allows():
    wrong = {}
    for name, media in contents():
        if not media.get("schema"):
            continue
        if "example" not in media:
            wrong[name] = "no example"
        elif found := errors(media["schema"], media["example"]):
            wrong[name] = found[:3]
    assert wrong == {}


def test_every_parameter_that_has_to_be_there_has_an_example():
    wrong = {}
    for path, method, operation in operations(DOCUMENT):
        for parameter in operation.get("parameters", ()):
            if parameter.get("required") and "example" not in parameter:
                wrong[f"{method} {path} {parameter['name']}"] = "no example"
            elif "example" in parameter and (found := errors(parameter.get("schema", {}), parameter["example"])):
                wrong[f"{method} {path} {parameter['name']}"] = found
    assert wrong == {}


def test_every_operation_says_what_it_is_and_who_may():
    names = [operation["operationId"] for _, _, operation in operations(DOCUMENT)]
    assert len(set(names)) == len(names)
    for path, method, operation in operations(DOCUMENT):
        assert operation.get("summary") or operation.get("description"), (method, path)
        for each in operation.get("security", ()):
            assert set(each.get("client", ())) <= set(SCOPES)
    proofs = DOCUMENT["paths"]["/api/v1/proofs"]["get"]
    assert proofs["security"] == [{"person": []}, {"client": ["wonderland.proofs.read"]}]
    assert {"400", "401", "403", "422", "429"} <= set(proofs["responses"])


def test_it_is_openapi_3_1():
    assert DOCUMENT["openapi"].startswith("3.1")


async def test_the_page_has_every_operation_and_asks_nobody_else_for_anything(running):
    answer = await running.get("/reference")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    for path, _, operation in operations(DOCUMENT):
        assert f'id="{operation["operationId"]}"' in answer.text
        assert f"<code>{path}</code>" in answer.text
    assert "<script" not in answer.text
    assert not re.search(r'(?:src|href)="(?:https?:)?//', answer.text)
    assert "<img onerror" not in answer.text
