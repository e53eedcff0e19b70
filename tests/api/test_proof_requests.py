"""Requests for a proof: brought to the drone's real agent connection, followed on the ledger, told to subscribers."""

from __future__ import annotations

import asyncio
import json

import pytest
from jsonschema import Draft202012Validator
from kit.backend import credentials_of
from kit.description import document
from sqlalchemy import select

from wonderland.telemetry import PleaseProve
from wonderland_backend.db.tables.webhooks import DeliveryRow
from wonderland_uav_agent.requests import Requests, RequestsError, _said
from wonderland_uav_agent.willing import Willing

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()
SCOPES = "wonderland.proofs.request wonderland.proofs.read wonderland.subscriptions"
BODY = {"uav_id": "uav-1", "pad_id": "pad-1", "action": "land", "valid_s": 600}


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


async def until(http, path, **expected):
    async with asyncio.timeout(10):
        while True:
            found = (await http.get(path)).json()
            if all(found.get(name) == value for name, value in expected.items()):
                conforms("ProofRequest", found)
                return found
            await asyncio.sleep(0.02)


def drone(running, authorities, decide, uav_id="uav-1"):
    enrolment = authorities.enrol(uav_id, "FleetMSP", role="uav", id=uav_id)
    url = running.url.replace("http", "ws", 1) + "/ingest"
    return asyncio.create_task(Requests(url, credentials_of(enrolment), decide).run())


@pytest.fixture(autouse=True)
def _after_what_is_there(clock):
    """The sessions that the ledger has already are from before every request of these tests."""
    clock.now_ms = START_MS + 60_000


@both
async def test_a_request_becomes_a_proof(running, machine, authorities, chain, facts, clock, number):
    wishes = []

    async def decide(wish):
        wishes.append(wish)
        return ""

    listening = drone(running, authorities, decide)
    async with machine(SCOPES) as http:
        answer = await http.post("/api/v1/proof-requests", json=BODY)
        assert answer.status_code == 201, answer.text
        conforms("ProofRequest", answer.json())
        path = answer.headers["location"]
        found = await until(http, path, accepted=True)
        assert (found["state"], found["told_ms"]) == ("pending", clock.now_ms)
        assert wishes == [
            PleaseProve(
                request_id=found["request_id"], pad_id="pad-1", action="land", expires_ms=clock.now_ms + 600_000
            )
        ]
        chain.add(facts.request("asked for", t_ms=clock.now_ms + 5_000))
        assert (await until(http, path, state="asked"))["session_id"] == number("session", "asked for")
        chain.add(facts.decide("asked for", t_ms=clock.now_ms + 5_000))
        assert (await until(http, path, state="decided"))["outcome"] == "verified"
        assert (await http.delete(path)).status_code == 409
        page = (await http.get("/api/v1/proof-requests?drone=uav-1")).json()
        conforms("ProofRequestPage", page)
        assert [each["state"] for each in page["items"]] == ["decided"]
        assert (await http.get("/api/v1/proof-requests?pad=pad-2")).json()["items"] == []
    listening.cancel()


async def test_a_drone_that_comes_later_is_told_then_and_may_decline(running, machine, authorities):
    async def decide(wish):
        return "the battery is low"

    async with machine(SCOPES) as http:
        path = (await http.post("/api/v1/proof-requests", json=BODY)).headers["location"]
        assert "told_ms" not in (await http.get(path)).json()
        listening = drone(running, authorities, decide)
        found = await until(http, path, state="declined")
        assert (found["accepted"], found["answer"]) == (False, "the battery is low")
    listening.cancel()


async def test_a_request_expires_or_is_taken_back(running, machine, clock, chain, facts):
    async with machine(SCOPES) as http:
        first = (await http.post("/api/v1/proof-requests", json=BODY)).headers["location"]
        second = (await http.post("/api/v1/proof-requests", json=BODY)).headers["location"]
        gone = await http.delete(first)
        assert (gone.status_code, gone.json()["state"]) == (200, "cancelled")
        clock.now_ms += 600_000
        assert (await http.get(second)).json()["state"] == "expired"
        # What the drone asks for after that is not what was asked for.
        chain.add(facts.request("later", t_ms=clock.now_ms + 1))
        await running.mirrored(chain.height)
        assert (await http.get(second)).json()["state"] == "expired"


async def test_who_may_ask_for_what(running, machine, chain, facts):
    chain.add(facts.put_uav("uav-9", msp_id="OtherMSP"))
    await running.mirrored(chain.height)
    async with machine(SCOPES, role="fleet_operator", msp_id="OtherMSP") as http:
        assert (await http.post("/api/v1/proof-requests", json=BODY)).status_code == 404
        mine = await http.post("/api/v1/proof-requests", json=BODY | {"uav_id": "uav-9"})
        assert mine.status_code == 201
    async with machine(SCOPES) as other:
        assert (await other.delete(mine.headers["location"])).status_code == 404, "it is somebody else's"
        for change in ({"uav_id": "nobody"}, {"pad_id": "nowhere"}):
            assert (await other.post("/api/v1/proof-requests", json=BODY | change)).status_code == 404
        for change in ({"action": "hover"}, {"valid_s": 1}, {"uav_id": "a b"}, {"note": "x" * 501}, {"more": 1}):
            assert (await other.post("/api/v1/proof-requests", json=BODY | change)).status_code == 422
    async with machine("wonderland.proofs.read") as reader:
        assert (await reader.post("/api/v1/proof-requests", json=BODY)).status_code == 403
        assert (await reader.get("/api/v1/proof-requests")).status_code == 200
    token = await running.parts.sign_ins.new_token("Looker", ("viewer",))
    await running.http.post("/api/v1/session", json={"token": token})
    assert (await running.http.post("/api/v1/proof-requests", json=BODY)).status_code == 403


@both
async def test_subscribers_are_told_if_they_may_see_it(running, machine, chain, facts, monkeypatch):
    async def allowed(self, url):
        return None

    monkeypatch.setattr("wonderland_backend.webhooks.post.Poster.target", allowed)
    hook = {"url": "https://hooks.example/", "types": ["proof_request.created"]}
    async with machine(SCOPES) as all_seeing, machine(SCOPES, role="fleet_operator", msp_id="OtherMSP") as stranger:
        paths = [
            (await each.post("/api/v1/subscriptions", json=hook)).headers["location"] for each in (all_seeing, stranger)
        ]
        asked = (await all_seeing.post("/api/v1/proof-requests", json=BODY)).json()
        told, untold = [
            (await http.get(f"{path}/deliveries")).json()["items"]
            for http, path in zip((all_seeing, stranger), paths, strict=True)
        ]
        assert [(each["type"], each["event_id"]) for each in told] == [("proof_request.created", asked["request_id"])]
        assert untold == []
    async with running.context.database.read() as database:
        (body,) = await database.scalars(select(DeliveryRow.body))
    conforms("ProofRequestCreated", json.loads(body))


async def test_an_agent_that_does_not_take_requests_is_sent_none(running, machine, agent_client):
    async with running.connect("/ingest") as socket, machine(SCOPES) as http:
        agent = agent_client(socket, agent="uav", agent_id="uav-1", msp_id="FleetMSP")
        assert (await agent.hello())["type"] == "welcome"
        answer = await http.post("/api/v1/proof-requests", json=BODY)
        assert "told_ms" not in answer.json()
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(socket.recv(), 0.2)


async def test_answers_to_what_was_asked_of_another_count_for_nothing(running, machine, agent_client):
    async with running.connect("/ingest") as socket, machine(SCOPES) as http:
        path = (await http.post("/api/v1/proof-requests", json=BODY)).headers["location"]
        agent = agent_client(socket, agent="uav", agent_id="uav-2", msp_id="FleetMSP")
        assert (await agent.hello(takes=["please_prove"]))["type"] == "welcome"
        request_id = path.rpartition("/")[2]
        await agent.send({"type": "answer", "request_id": request_id, "accepted": False, "text": "no"})
        await agent.send({"type": "answer", "request_id": "short", "accepted": True})
        assert (await agent.receive())["code"] == "bad_frame"
        assert (await http.get(path)).json()["state"] == "pending"


def wish(digit, pad_id, action):
    return PleaseProve(request_id=digit * 32, pad_id=pad_id, action=action, expires_ms=0)


async def test_a_willing_drone_does_one_proof_at_a_time():
    gate, asked = asyncio.Event(), []

    class Agent:
        async def prove(self, pad_id, action):
            asked.append((pad_id, action))
            await gate.wait()

            class Result:
                state, end = "completed", "done"

            return Result()

        def stop(self, reason="drone_stopped"):
            gate.set()

    willing = Willing(Agent(), frozenset({"pad-1"}))
    assert await willing.decide(wish("1", "pad-1", "land")) == ""
    assert "another proof" in await willing.decide(wish("2", "pad-1", "land"))
    assert "pad-9" in await willing.decide(wish("3", "pad-9", "land"))
    await asyncio.sleep(0)
    gate.set()
    await asyncio.sleep(0.01)
    assert await willing.decide(wish("4", "pad-1", "dock")) == ""
    await willing.stop()
    assert asked == [("pad-1", "land"), ("pad-1", "dock")]


@pytest.mark.parametrize(
    "change", [{"request_id": 1}, {"request_id": "x"}, {"pad_id": None}, {"action": "hover"}, {"expires_ms": "soon"}]
)
def test_a_server_that_talks_nonsense(change):
    message = {"type": "please_prove", "request_id": "0" * 32, "pad_id": "p", "action": "land", "expires_ms": 1}
    assert _said(json.dumps(message)).pad_id == "p"
    with pytest.raises(RequestsError):
        _said(json.dumps(message | change))
    for text in ("", "[]", "x", json.dumps("y"), b"\xff", "{}"):
        with pytest.raises(RequestsError):
            _said(text)
    assert _said('{"type":"something later","x":null}') is None
