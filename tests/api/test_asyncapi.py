"""The description of what is pushed (AsyncAPI 3): valid by its official schema, and what is pushed is as it says."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from jsonschema import Draft7Validator, Draft202012Validator
from kit.chain import START_MS
from kit.description import document

from wonderland_backend.clients.scopes import LIVE, SCOPES
from wonderland_backend.reference.asyncapi import asyncapi

DOCUMENT = asyncapi("wonderland.example.com")
OFFICIAL = Path(__file__).parents[2] / "frontend/node_modules/@asyncapi/specs/schemas/3.0.0.json"


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


@pytest.fixture(scope="module")
def official():
    if not OFFICIAL.is_file():
        pytest.skip("needs the console’s packages: make setup")
    return Draft7Validator(json.loads(OFFICIAL.read_text()))


def test_it_is_asyncapi(official):
    assert [f"{list(each.absolute_path)}: {each.message[:200]}" for each in official.iter_errors(DOCUMENT)] == []
    wrong = {**DOCUMENT, "channels": {"live": {**DOCUMENT["channels"]["live"], "messages": []}}}
    assert list(official.iter_errors(wrong)), "the official schema sees what is wrong"


def references(value):
    if isinstance(value, dict):
        yield from ([value["$ref"]] if isinstance(value.get("$ref"), str) else [])
        for each in value.values():
            yield from references(each)
    elif isinstance(value, list):
        for each in value:
            yield from references(each)


def test_every_reference_resolves_and_every_example_is_as_its_schema_says():
    for each in references(DOCUMENT):
        found = DOCUMENT
        for part in each.removeprefix("#/").split("/"):
            found = found[part]
    for name, message in DOCUMENT["components"]["messages"].items():
        for example in message["examples"]:
            conforms(name, example["payload"])


def test_its_schemas_are_those_of_the_openapi():
    assert {name: document()["components"]["schemas"][name] for name in DOCUMENT["components"]["schemas"]} == (
        DOCUMENT["components"]["schemas"]
    )


def test_it_names_the_scopes_that_are_asked_for():
    (live, _), (events, _) = (DOCUMENT["servers"][name]["security"] for name in ("live", "events"))
    assert (live["scopes"], events["scopes"]) == (list(LIVE), ["wonderland.proofs.read"])
    security = document()["paths"]["/api/v1/events"]["get"]["security"]
    assert {"client": events["scopes"]} in security
    assert set(live["flows"]["clientCredentials"]["availableScopes"]) <= set(SCOPES)


async def test_it_is_served_without_a_sign_in_for_the_address_that_was_asked(running):
    running.http.cookies.clear()
    answer = await running.get("/asyncapi.json")
    assert answer.status_code == 200
    host = running.url.partition("://")[2]
    assert answer.json() == asyncapi(host, encrypted=False)
    assert answer.json()["servers"]["live"] | {"security": []} == {"host": host, "protocol": "ws", "security": []}


async def test_live_frames_are_as_described(running, machine, chain, facts, agent_client):
    """Of a machine, over a verdict, a broadcast and a pad's word."""
    kinds = {DOCUMENT["components"]["schemas"][name]["properties"]["type"]["const"]: name for name in (
        message["$ref"].rpartition("/")[2] for message in DOCUMENT["operations"]["sendLive"]["messages"]
    )}  # fmt: skip
    seen, parts = set(), set()
    async with machine(" ".join(LIVE), role="inspector") as http:
        bearer = {"Authorization": http.headers["Authorization"]}
        async with (
            running.connect(DOCUMENT["channels"]["live"]["address"], additional_headers=bearer) as socket,
            running.connect("/ingest") as pad,
        ):
            agent = agent_client(pad)
            await agent.hello()
            track = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi_beacon"}
            assert (await agent.report(("track", track), t_ms=START_MS + 1_000))["type"] == "ack"
            chain.add(facts.decide("three", pad_id="pad-2", t_ms=START_MS + 20_000, outcome="refuted"))
            await running.mirrored(chain.height)
            async with asyncio.timeout(10):
                while not {"hello", "snapshot", "delta"} <= seen or not {"tracks", "verdicts", "alerts"} <= parts:
                    frame = json.loads(await socket.recv())
                    conforms(kinds[frame["type"]], frame)
                    seen.add(frame["type"])
                    parts |= set(frame) if frame["type"] == "delta" else set()
    assert seen == set(kinds)


async def test_the_stream_is_as_described(running, machine):
    stream = {"Accept": "text/event-stream"}
    async with machine("wonderland.proofs.read") as http:
        count = len((await http.get("/api/v1/events", params={"after": "0.0"})).json()["items"])
        address = DOCUMENT["channels"]["events"]["address"]
        told, event = [], {}
        async with http.stream("GET", address, params={"after": "0.0"}, headers=stream) as answer:
            async with asyncio.timeout(10):
                async for line in answer.aiter_lines():
                    name, _, value = line.partition(": ")
                    if line and name:
                        event[name] = value
                    if not line and "data" in event:
                        told.append(event)
                    event = event if line else {}
                    if len(told) == count:
                        break
    assert count > 5
    for each in told:
        data = json.loads(each["data"])
        conforms("LedgerEvent", data)
        assert (each["id"], each["event"]) == (data["id"], data["type"])
