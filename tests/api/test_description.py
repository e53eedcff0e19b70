"""The description (OpenAPI 3.1): whole, with an example for every operation and error, each of them as its schema has it."""

from __future__ import annotations

import re

from jsonschema import Draft202012Validator
from kit.description import document

from wonderland_backend.clients.scopes import SCOPES
from wonderland_backend.errors import BINARY, Problem
from wonderland_backend.reference.openapi import operations

DOCUMENT = document()


def errors(schema, value):
    whole = {**schema, "components": DOCUMENT["components"]}
    return [f"{list(each.absolute_path)}: {each.message}" for each in Draft202012Validator(whole).iter_errors(value)]


def contents():
    for path, method, operation in operations(DOCUMENT):
        name = f"{method} {path}"
        for kind, media in operation.get("requestBody", {}).get("content", {}).items():
            yield f"{name} request {kind}", media
        for status, response in operation["responses"].items():
            if "$ref" in response:
                assert status == "default"
                continue
            assert "content" in response or status in {"204", "304"}, (name, status)
            for kind, media in response.get("content", {}).items():
                yield f"{name} {status} {kind}", media


def examples_of(media):
    return [each["value"] for each in media["examples"].values()] if "examples" in media else [media.get("example")]


def test_every_content_has_a_schema_and_an_example_that_it_allows():
    wrong = {}
    for name, media in contents():
        if not media.get("schema"):
            wrong[name] = "no schema"
        elif media["schema"] == BINARY:
            continue
        elif not all(examples_of(media)):
            wrong[name] = "no example, or an empty one"
        elif found := [each for example in examples_of(media) for each in errors(media["schema"], example)]:
            wrong[name] = found[:3]
    assert wrong == {}


def problems():
    for path, method, operation in operations(DOCUMENT):
        for status, response in operation["responses"].items():
            media = response.get("content", {}).get("application/problem+json", {})
            for code, each in media.get("examples", {}).items():
                yield f"{method} {path}", operation, status, code, each["value"]


def test_problems_are_those_of_the_operation():
    for name, operation, status, code, problem in problems():
        path = name.partition(" ")[2]
        pattern = re.sub(r"\\{\w+\\}", "[^/{}]+", re.escape(path))
        assert re.fullmatch(pattern, problem["instance"]), name
        assert (problem["status"], problem["type"]) == (int(status), f"urn:wonderland:problem:{code}"), name
        if "`cursor`" in problem["detail"]:
            assert "cursor" in {each["name"] for each in operation["parameters"]}, name
        if code == "insufficient-scope":
            scopes = sorted(scope for each in operation["security"] for scope in each.get("client", ()))
            assert problem["detail"] == f"The token lacks the scope {' '.join(scopes)}.", name


def codes(path, method="get"):
    responses = DOCUMENT["paths"][path][method]["responses"]
    return {
        status: set(content["examples"])
        for status, response in responses.items()
        if (content := response.get("content", {}).get("application/problem+json"))
    }


def test_problems_of_the_standards_have_their_names():
    assert codes("/uss/flights") == {
        "400": {"bad-view", "bad-request"},
        "401": {"invalid-token"},
        "403": {"insufficient-scope"},
        "413": {"view-too-large"},
        "429": {"too-many-requests"},
    }
    token = DOCUMENT["paths"]["/oauth/token"]["post"]["responses"]
    assert token["401"]["content"]["application/json"]["example"]["error"] == "invalid_client"
    assert codes("/oauth/token", "post")["429"] == {"too-many-requests"}
    assert codes("/api/v1/networked-flights/{flight_id}")["502"] == {"provider-away"}


def test_every_problem_has_an_example_of_its_own():
    def below(kind):
        for each in kind.__subclasses__():
            yield each
            yield from below(each)

    assert [each.__name__ for each in below(Problem) if "example" not in vars(each)] == []


async def test_headers_are_described_where_they_come(running, machine):
    told = {name.lower(): name for name in DOCUMENT["components"]["headers"]}
    async with machine(" ".join(SCOPES), role="inspector") as http:
        for path, method, operation in operations(DOCUMENT):
            required = [each for each in operation.get("parameters", ()) if each.get("required")]
            if method != "get" or required or not any("client" in each for each in operation.get("security", ())):
                continue
            answer = await http.get(path)
            described = operation["responses"][str(answer.status_code)].get("headers", {})
            come = {told[name] for name in answer.headers if name in told}
            assert come == set(described), f"{path} {answer.status_code}"
            if "ETag" in come:
                again = await http.get(path, headers={"If-None-Match": answer.headers["etag"]})
                assert (again.status_code, "304" in operation["responses"]) == (304, True)


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


def test_schemas_have_names_that_generators_can_use():
    """Two models of one name would be called by their Python paths, and differ from version to version."""
    names = DOCUMENT["components"]["schemas"]
    assert "Pad" in names
    assert [name for name in names if not re.fullmatch(r"(?:[A-Z][a-z0-9]*)+", name)] == []


def test_it_is_openapi_3_1():
    assert DOCUMENT["openapi"].startswith("3.1")


async def test_the_page_has_every_operation_and_asks_nobody_else_for_anything(running):
    answer = await running.get("/reference")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    for path, _, operation in operations(DOCUMENT):
        assert f'id="{operation["operationId"]}"' in answer.text
        assert f"<code>{path}</code>" in answer.text
    assert "urn:wonderland:problem:view-too-large" in answer.text
    assert re.search("Headers: [^\n]*?<code>ETag</code>", answer.text)
    assert "<script" not in answer.text
    assert not re.search(r'(?:src|href)="(?:https?:)?//', answer.text)
    assert "<img onerror" not in answer.text


def test_what_receivers_of_webhooks_get_is_described():
    assert set(DOCUMENT["webhooks"]) == {"event", "proof_request.created", "webhook.test", "alert"}
    for name, told in DOCUMENT["webhooks"].items():
        media = told["post"]["requestBody"]["content"]["application/json"]
        assert errors(media["schema"], media["example"]) == []
        assert name in {"event", media["example"]["type"]}
        assert set(told["post"]["responses"]) == {"204"}
