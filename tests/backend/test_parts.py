"""What an endpoint names is there; and nobody learns what a backend lacks before they have shown that they may ask."""

from __future__ import annotations

import httpx
import pytest
from fastapi import FastAPI
from fastapi.routing import iter_route_contexts
from starlette.requests import Request

from wonderland_backend.auth.gate import SetUpGate

NO_LEDGER = [
    ("GET", "/signing-keys", None),
    ("POST", "/signing-keys/enrol", {"msp_id": "PadMSP", "request": "no PEM", "secret": "s"}),
    ("POST", "/signing-keys/demo", {"role": "inspector", "request": "no PEM"}),
    ("POST", "/transactions/proposals", {"function": "RegisterPad", "argument": {}, "certificate_sha256": "0" * 64}),
    ("GET", f"/transactions/proposals/{'0' * 64}", None),
    ("POST", f"/transactions/proposals/{'0' * 64}/endorse", {"signature": "AA"}),
    ("POST", f"/transactions/proposals/{'0' * 64}/submit", {"signature": "AA"}),
]


@pytest.fixture
async def without_ledger(new_backend, serving):
    async with serving(new_backend()) as running:
        yield running


def dependencies_within(dependant):
    for each in dependant.dependencies:
        yield each.call
        yield from dependencies_within(each)


def named_parts(app):
    """Every `find` that `wonderland_backend.context.part` has made for some endpoint."""
    effective = [each._effective_route for each in iter_route_contexts(app.routes)]
    dependants = [each.dependant for each in effective if getattr(each, "dependant", None) is not None]
    calls = {call for dependant in dependants for call in dependencies_within(dependant)}
    return {call for call in calls if call.__qualname__.startswith("part.<locals>")}


async def test_every_part_that_an_endpoint_names_is_there(without_ledger):
    app = without_ledger.backend.app
    found = [await find(Request({"type": "http", "app": app, "headers": []})) for find in named_parts(app)]
    kinds = {type(each).__name__ for each in found}
    assert {"Context", "Hub", "Board", "SignIns", "Machines", "USpace", "Members", "Intake"} <= kinds
    assert len(kinds) == len(found), "a part was found under another's type"


async def test_a_part_that_stands_in_for_another_is_found_under_the_declared_type(new_backend):
    backend = new_backend()

    class Other(type(backend.parts.sign_ins)):
        pass

    backend.parts.sign_ins.__class__ = Other
    assert backend.parts.by_type(backend.context)[Other.__mro__[1]] is backend.parts.sign_ins


@pytest.mark.parametrize(("method", "path", "body"), NO_LEDGER)
async def test_strangers_and_viewers_do_not_learn_that_there_is_no_ledger(without_ledger, method, path, body):
    async with httpx.AsyncClient(base_url=without_ledger.url, trust_env=False) as http:
        assert (await http.request(method, f"/api/v1{path}", json=body)).status_code == 401
        token = await without_ledger.parts.sign_ins.new_token("Viewer", ("viewer",))
        assert (await http.post("/api/v1/session", json={"token": token})).status_code == 200
        assert (await http.request(method, f"/api/v1{path}", json=body)).status_code == 403
    answer = await without_ledger.http.request(method, f"/api/v1{path}", json=body)
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:wonderland:problem:ledger-away")


async def test_a_backend_that_knows_nobody_who_could_sign_in_stays_shut():
    async def served(scope, receive, send):
        raise AssertionError("it was open")

    app = FastAPI()
    app.state.parts = {}
    with pytest.raises(KeyError, match="SignIns"):
        await SetUpGate(served)(
            {"type": "http", "method": "GET", "path": "/api/v1/pads", "headers": [], "app": app}, None, None
        )
