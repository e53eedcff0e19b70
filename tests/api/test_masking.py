"""One operator's numbers, looked for in everything that leaves this server: masked alike wherever they come out."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import re
import zipfile

import httpx
import pytest
import websockets
from kit import PLAIN
from kit.chain import START_MS
from kit.description import document
from kit.openings import NUMBER, opening
from kit.webhooks import SCOPES, Receiver, ca, poster, webhooks
from sqlalchemy import select

from wonderland.proofs import encoding
from wonderland.proofs.records import uavs
from wonderland_backend.db.tables.alerts import AlertRow
from wonderland_backend.masking import masked

__all__ = ["ca", "poster", "webhooks"]

REGISTRATION = NUMBER
BROADCAST = "SWE00zqbroadcst1"
OPERATOR = "zq-aviation-of-one-pilot"
PAD_OPERATOR = "zq-harbour"
STREAM = {"Accept": "text/event-stream"}
WINDOW = {"from_ms": START_MS, "until_ms": START_MS + 60_000}
QUERY = {
    "kind": "drone", "id": "uav-1", "q": "uav", "since_ms": START_MS, "bin_ms": 60_000, "at_ms": START_MS + 30_000,
    "direction": "after", "serial": "uav-1", "lat": 60.45, "lon": 22.26, "view": "60.44,22.25,60.46,22.28",
} | WINDOW  # fmt: skip
BYTES = re.compile(r"/blocks/\d+/data$|/evidence$")
"""What was signed cannot be masked: for officers only, which the roles' tests hold."""
HIDDEN = {
    "viewer": (REGISTRATION, BROADCAST, OPERATOR),
    "pad_operator": (REGISTRATION, BROADCAST, OPERATOR),
    "fleet_operator": (REGISTRATION, BROADCAST, OPERATOR),
    "inspector": (REGISTRATION, BROADCAST),
    "admin": (REGISTRATION, BROADCAST),
}
MSP = {"pad_operator": "PadMSP", "fleet_operator": "OtherFleetMSP"}
ROLES = list(HIDDEN)


@pytest.fixture
async def running(new_backend, chain, source_of, serving, facts, tx, agent_client):
    """A drone of a recognisable operator: registered, proved, refuted, heard."""
    pad, uav = facts.put_pad(operator_id=PAD_OPERATOR), facts.put_uav(operator_id=OPERATOR)
    for each, name in ((pad, "PadRegistered"), (uav, "UavRegistered")):
        (record,) = each.writes.values()
        each.event = (name, b'{"kind":"%s","record":%s}' % (name.encode(), record))
    commitment = opening("uav-1", REGISTRATION).commitment
    uav.argument = {
        "uav_id": "uav-1", "operator_id": OPERATOR, "registration_commitment": commitment, "model": "M300",
    }  # fmt: skip
    chain.add(pad, uav, facts.put_uav("uav-2", msp_id="OtherFleetMSP", registration="", operator_id="another"))
    chain.add(facts.grant(), facts.set_policy(), facts.request("one"))
    chain.add(facts.decide("one", outcome="refuted"))
    changed = encoding.encode({"record": facts.uav(operator_id=OPERATOR, status="suspended").to_json()})
    chain.add(tx("SetUavStatus", {}, {}, ("UavStatusSet", changed)))
    backend = new_backend(source_of(chain), outputs={"live_geojson": True})
    async with serving(backend) as client:
        await client.mirrored(chain.height)
        async with client.connect("/ingest") as socket:
            agent = agent_client(socket)
            await agent.hello()
            track = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi_beacon"}
            spoken = {"operator_id": BROADCAST, "operator_lat_e7": 604_511_117, "operator_lon_e7": 222_611_117}
            assert (await agent.report(("track", track | spoken), t_ms=START_MS + 1_000))["type"] == "ack"
        yield client


@contextlib.asynccontextmanager
async def signed_in(running, role, msp_id=""):
    async with httpx.AsyncClient(base_url=running.url, trust_env=False, verify=PLAIN, timeout=30) as http:
        token = await running.parts.sign_ins.new_token(f"P {role}", (role,), msp_id=msp_id)
        assert (await http.post("/api/v1/session", json={"token": token})).status_code == 200
        yield http


async def addresses(running, number):
    """Every GET of the description, with what is there filled in; path → address."""
    alert = (await running.json("/alerts"))["items"][0]["alert_id"]
    flights = (await running.json("/flights"))["items"]
    blocks = [await running.json(f"/blocks/{block}") for block in range(1, 5)]
    transactions = [each["tx_id"] for block in blocks for each in block["items"]]
    known = {
        "uav_id": ["uav-1"], "pad_id": ["pad-1"], "session_id": [number("session", "one")], "alert_id": [alert],
        "proof_id": [number("session", "one")], "number": ["1", "2", "3", "4"], "tx_id": transactions,
        "flight_id": [each["flight_id"] for each in flights],
    }  # fmt: skip
    for path, operations in document()["paths"].items():
        if "get" not in operations or "metrics" in path:
            continue
        name = re.search(r"\{(\w+)\}", path)
        for value in known.get(name[1], ["0" * 32]) if name else [""]:
            yield path, re.sub(r"\{\w+\}", value, path, count=1).replace("{sha256}", "0" * 64)


async def everything(running, http, number):
    """What this person is told by REST, as (where, text); streams for a moment only."""
    found = []
    async for path, address in addresses(running, number):
        asked = document()["paths"][path]["get"].get("parameters", [])
        wanted = {each["name"] for each in asked if each.get("required")}
        query = {name: value for name, value in QUERY.items() if name in wanted}
        if path == "/api/v1/events":
            query["after"] = "0.0"
        if path == "/api/v1/traffic" or BYTES.search(address):
            continue
        answer = await http.get(address, params=query)
        found.append((path, answer.status_code, answer.text))
    for kind in ("drone", "pad", "policy"):
        answer = await http.get(
            "/api/v1/registry/history", params={"kind": kind, "id": f"{'uav' if kind == 'drone' else 'pad'}-1"}
        )
        found.append((f"history of {kind}", answer.status_code, answer.text))
    return found + [
        ("/api/v1/search", 200, (await http.post("/api/v1/search", json={"q": text})).text)
        for text in (OPERATOR[:5], PAD_OPERATOR, "FIN", "SWE", "uav")
    ]


async def exported(http):
    for kind in ("geojson", "csv", "mfjson"):
        asked = await http.post("/api/v1/exports", json=WINDOW | {"format": kind})
        assert asked.status_code == 201, asked.text
        answer = await http.get(f"/api/v1/exports/{asked.json()['export_id']}/file")
        packed = zipfile.ZipFile(io.BytesIO(answer.content))
        yield kind, "".join(packed.read(name).decode() for name in packed.namelist())


async def live(running, http):
    """Hello, and the snapshot, which has the position that was heard."""
    cookie = "; ".join(f"{name}={value}" for name, value in http.cookies.items())
    url = running.url.replace("http", "ws", 1) + "/api/v1/live"
    async with websockets.connect(url, proxy=None, additional_headers={"Cookie": cookie}) as socket:
        return "".join([await asyncio.wait_for(socket.recv(), 5) for _ in range(2)])


async def streamed(http, count):
    lines = []
    async with http.stream("GET", "/api/v1/events", params={"after": "0.0"}, headers=STREAM) as answer:
        assert answer.status_code == 200
        async with asyncio.timeout(10):
            async for line in answer.aiter_lines():
                lines.append(line)
                if sum(each.startswith("data:") for each in lines) == count:
                    break
    return "\n".join(lines)


@pytest.mark.parametrize("role", ROLES)
async def test_no_way_out_shows_what_a_role_may_not_see(running, role, number):
    async with signed_in(running, role, MSP.get(role, "")) as http:
        told = await everything(running, http, number)
        if role == "viewer":
            assert (await http.post("/api/v1/exports", json=WINDOW | {"format": "csv"})).status_code == 403
        else:
            told += [(f"export {kind}", 200, text) async for kind, text in exported(http)]
        told.append(("live", 200, await live(running, http)))
        events = (await http.get("/api/v1/events", params={"after": "0.0"})).json()["items"]
        if events:
            told.append(("stream", 200, await streamed(http, len(events))))
    leaks = {(where, each) for where, _, text in told for each in HIDDEN[role] if each.lower() in text.lower()}
    assert leaks == set()
    where_they_stand = {where for where, _, text in told for each in ("604511117", "222611117") if each in text}
    assert where_they_stand == set(), "where an operator stands"
    answered = {where for where, status, text in told if status == 200 and "uav-1" in text}
    if role in {"viewer", "inspector", "admin"}:
        assert answered >= {
            "/api/v1/drones", "/api/v1/drones/{uav_id}", "/api/v1/registry/drones", "/api/v1/registry/drones/{uav_id}",
            "/api/v1/registry/history", "/api/v1/tracks", "/api/v1/tracks/{uav_id}", "/api/v1/search", "/api/v1/events",
            "/api/v1/sessions", "/api/v1/verdicts", "/api/v1/alerts", "/api/v1/proofs", "/api/v1/replay/state",
            "/api/v1/picture", "/api/v1/flights", "live", "stream",
        }  # fmt: skip
    if role == "viewer":
        shown = {where for where, _, text in told if PAD_OPERATOR in text}
        assert shown >= {"/api/v1/pads", "/api/v1/events", "stream", "history of pad"}, "a pad’s operator is no secret"


async def test_whose_they_are_sees_them_everywhere(running, number):
    async with signed_in(running, "fleet_operator", "FleetMSP") as http:
        told = await everything(running, http, number)
    lists = {"/api/v1/drones", "/api/v1/drones/{uav_id}", "/api/v1/registry/drones", "/api/v1/registry/drones/{uav_id}"}
    for each, more in ((REGISTRATION, set()), (OPERATOR, {"/api/v1/registry/history", "/api/v1/events"})):
        assert {where for where, _, text in told if each in text} >= lists | more
    assert not {where for where, _, text in told if opening("uav-1", REGISTRATION).salt in text}
    assert BROADCAST not in "".join(text for *_, text in told)


async def test_webhooks_mask_as_events_do(running, machine, webhooks, ca):
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        body = {"url": f"https://hooks.example:{port}/in", "after": "0.0"}
        assert (await http.post("/api/v1/subscriptions", json=body)).status_code == 201
        for _ in range(4):
            await webhooks.make()
            await webhooks.send_due()
        events = (await http.get("/api/v1/events", params={"after": "0.0"})).json()["items"]
    bodies = [json.loads(each) for _, _, each in receiver.requests]
    records = {each["type"]: each["record"] for each in bodies}
    assert records == {each["type"]: each["record"] for each in events}
    assert records["UavRegistered"]["operator_id"] == records["UavStatusSet"]["operator_id"] == masked(OPERATOR)
    assert records["PadRegistered"]["operator_id"] == PAD_OPERATOR
    assert not [each for each in HIDDEN["viewer"] if each in json.dumps(bodies)]


async def test_what_is_told_of_alerts_has_no_operators(running):
    async with running.context.database.read() as database:
        rows = (await database.scalars(select(AlertRow))).all()
    assert rows
    text = " ".join(str(vars(each)) for each in rows)
    assert "uav-1" in text
    assert not [each for each in HIDDEN["viewer"] if each in text]


FILTERED = ("drones", "authorisations", "sessions", "verdicts", "proofs", "alerts", "flights", "statistics")
COUNTED = {"since_ms": START_MS, "until_ms": START_MS + 60_000, "bin_ms": 60_000}


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("operator", [OPERATOR, "nobody"])
async def test_nobody_finds_an_operator_out_by_asking_for_one(running, role, operator):
    """A filter says no more about a masked operator than a list shows."""
    async with signed_in(running, role, MSP.get(role, "")) as http:
        for path in FILTERED:
            more = COUNTED if path == "statistics" else {}
            answer = await http.get(f"/api/v1/{path}", params={"operator": operator} | more)
            if role in {"viewer", "pad_operator"}:
                assert answer.status_code == 403, (path, answer.text)
                assert "in part" in answer.json()["detail"]
                continue
            assert answer.status_code == 200, (path, answer.text)
            told = '"refuted":1' if path == "statistics" else "uav-1"
            clear = role in {"inspector", "admin"} and operator == OPERATOR
            assert (told in answer.text) is clear, (path, answer.text)


async def test_a_viewer_who_has_a_fleet_finds_its_own_by_operator(running):
    token = await running.parts.sign_ins.new_token("Both", ("viewer", "fleet_operator"), msp_id="OtherFleetMSP")
    async with httpx.AsyncClient(base_url=running.url, trust_env=False, verify=PLAIN, timeout=30) as http:
        assert (await http.post("/api/v1/session", json={"token": token})).status_code == 200
        for operator, drones in ((OPERATOR, []), ("another", ["uav-2"])):
            found = (await http.get("/api/v1/drones", params={"operator": operator})).json()["items"]
            assert [each["uav_id"] for each in found] == drones


def test_the_numbers_here_are_ones_that_a_mask_changes():
    for each in (REGISTRATION, BROADCAST, OPERATOR):
        assert each not in masked(each)
        assert uavs.normalised_registration(each) == each
