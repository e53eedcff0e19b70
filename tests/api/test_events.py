"""Events: from a place on, nothing missed, nothing twice, as a stream and page by page."""

from __future__ import annotations

import asyncio
import contextlib
import json

import pytest
from jsonschema import Draft202012Validator
from kit.description import document

from wonderland_backend.events.queries import Place

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()
STREAM = {"Accept": "text/event-stream"}


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


class Stream:
    """What a browser's EventSource does, in a few lines."""

    def __init__(self, lines):
        self.lines = lines
        self.last_id = None

    async def event(self, seconds=5):
        fields = {}
        async with asyncio.timeout(seconds):
            async for line in self.lines:
                if not line:
                    self.last_id = fields.get("id", self.last_id)
                    if "data" in fields:
                        return fields["event"], json.loads(fields["data"])
                    fields = {}
                elif not line.startswith(":"):
                    name, _, value = line.partition(": ")
                    fields[name] = value
        raise EOFError


@contextlib.asynccontextmanager
async def stream(http, **options):
    headers = STREAM | options.pop("headers", {})
    async with http.stream("GET", "/api/v1/events", params=options, headers=headers, timeout=None) as answer:
        assert answer.status_code == 200, await answer.aread()
        assert answer.headers["content-type"].startswith("text/event-stream")
        yield Stream(answer.aiter_lines())


@both
async def test_pages_hold_every_event_once_and_in_order(running, machine):
    async with machine("wonderland.proofs.read") as http:
        whole = (await http.get("/api/v1/events", params={"after": "0.0"})).json()
        conforms("EventPage", whole)
        assert [each["type"] for each in whole["items"]] == [
            "ProofRequested", "ProofDecided", "InteractionCompleted", "ProofRequested", "ProofDecided", "ProofRequested",
        ]  # fmt: skip
        assert whole["items"][1]["record"]["outcome"] == "verified"
        found, after, more = [], "0.0", True
        while more:
            page = (await http.get("/api/v1/events", params={"after": after, "limit": 1})).json()
            found, after, more = found + page["items"], page["after"], page["more"]
        assert found == whole["items"]
        new = (await http.get("/api/v1/events")).json()
        assert (new["items"], new["more"]) == ([], False)


@pytest.mark.parametrize(
    ("query", "count"),
    [
        ({"type": "ProofDecided"}, 2),
        ({"type": ["ProofDecided", "ProofRequested"]}, 5),
        ({"drone": "uav-2"}, 2),
        ({"pad": "pad-2"}, 1),
        ({"outcome": "refuted"}, 1),
        ({"type": "Nothing"}, 0),
    ],
)
async def test_filters(running, query, count):
    answer = await running.get("/events", params={"after": "0.0", **query})
    assert answer.status_code == 200, answer.text
    assert len(answer.json()["items"]) == count


@both
async def test_a_stream_goes_on_where_it_was_broken(running, chain, facts, machine):
    async with machine("wonderland.proofs.read") as http:
        async with stream(http, after="0.0") as first:
            seen = [(await first.event())[1]["id"] for _ in range(3)]
            last = first.last_id
        assert last == seen[-1]
        chain.add(facts.request("while it was away"))
        await running.mirrored(chain.height)
        async with stream(http, headers={"Last-Event-ID": last}) as second:
            seen += [(await second.event())[1]["id"] for _ in range(4)]
            chain.add(facts.request("while it listens"), facts.request("and another"))
            for _ in range(2):
                kind, event = await second.event()
                conforms("LedgerEvent", event)
                assert kind == "ProofRequested"
                seen.append(event["id"])
        whole = (await http.get("/api/v1/events", params={"after": "0.0"})).json()
        assert seen == [each["id"] for each in whole["items"]]


async def test_a_stream_without_a_place_begins_with_what_is_new(running, chain, facts):
    async with stream(running.http) as found:
        chain.add(facts.request("new"))
        assert (await found.event())[1]["block"] == chain.height - 1


async def test_a_stream_ends_with_the_right_to_look(running, machine, monkeypatch):
    monkeypatch.setattr("wonderland_backend.rest.events.HEARTBEAT_S", 0.05)
    async with machine("wonderland.proofs.read") as http, stream(http) as found:
        async with running.context.database.write() as connection:
            await running.parts.clients.revoke(connection, http.client_id, "a test")
        with pytest.raises(EOFError):
            await found.event()
    assert running.parts.streams.count == 0


async def test_a_server_that_stops_ends_its_streams(running):
    async with stream(running.http) as found:
        running.backend.end_streams()
        with pytest.raises(EOFError):
            await found.event()


async def test_there_are_only_so_many_streams(new_backend, serving, chain, source_of):
    async with serving(new_backend(source_of(chain), max_event_streams=1)) as client, stream(client.http) as found:
        await anext(aiter(found.lines))
        answer = await client.get("/events", headers=STREAM)
        assert (answer.status_code, answer.json()["type"]) == (429, "urn:wonderland:problem:too-many-requests")


async def test_one_client_leaves_streams_to_others(new_backend, serving, chain, source_of, machine_at):
    scopes = "wonderland.proofs.read wonderland.traffic.ats"
    async with (
        serving(new_backend(source_of(chain), max_event_streams_each=1)) as client,
        machine_at(client, scopes) as greedy,
        machine_at(client, scopes, name="Other") as other,
        stream(greedy) as found,
    ):
        await anext(aiter(found.lines))
        for path in ("/api/v1/events", "/api/v1/traffic"):
            answer = await greedy.get(path, headers=STREAM)
            assert (answer.status_code, answer.json()["type"]) == (429, "urn:wonderland:problem:too-many-requests")
            assert answer.json()["detail"].startswith("You have as many streams open as anybody may (1); close one")
        async with stream(other) as another:
            assert await anext(aiter(another.lines))


async def test_an_operator_is_told_of_its_own_only_and_others_of_no_personal_data(running, chain, facts, machine, tx):
    from wonderland.proofs import encoding

    def registered(uav_id, **more):
        record = facts.uav(uav_id, **more)
        return tx("RegisterUav", {}, {}, ("UavRegistered", encoding.encode({"record": record.to_json()})))

    chain.add(facts.put_uav("uav-9", msp_id="OtherMSP"), registered("uav-9", msp_id="OtherMSP"), registered("uav-1"))
    await running.mirrored(chain.height)
    query = {"after": "0.0", "type": "UavRegistered"}
    async with machine("wonderland.proofs.read", role="fleet_operator", msp_id="OtherMSP") as http:
        (only,) = (await http.get("/api/v1/events", params=query)).json()["items"]
        assert (only["record"]["uav_id"], only["record"]["operator_id"]) == ("uav-9", "fleet")
    async with machine("wonderland.proofs.read") as http:
        first, second = (await http.get("/api/v1/events", params=query)).json()["items"]
        assert first["record"]["operator_id"] == second["record"]["operator_id"] == "---"
        assert "FIN" not in str((first, second))


@pytest.mark.parametrize("after", ["x", "1", "-1.0", "1.0.0", "9999999999999999.0", "1.9999999999"])
async def test_places_that_are_none(running, after):
    assert (await running.get("/events", params={"after": after})).status_code == 422
    answer = await running.get("/events", headers={"Last-Event-ID": after})
    assert (answer.status_code, answer.json()["type"]) == (400, "urn:wonderland:problem:bad-request")


def test_places_are_ordered_as_the_ledger_is():
    assert Place.parse("9.5") < Place.parse("10.0") < Place.parse("10.1")
    assert str(Place.parse("10.1")) == "10.1"
