"""REST: what the database holds, in the shapes that the description promises; errors that say what to do."""

from __future__ import annotations

import hashlib
import json
from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from kit.description import document
from sqlalchemy import insert

from wonderland_backend.db.tables.reported import LatestTrackRow
from wonderland_backend.description import openapi
from wonderland_backend.pagination import decode_cursor
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.errors import LedgerError

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()


def conforms(schema_name, value):
    """Check against the published schema, and that nothing is sent which the schema does not name."""
    schema = {"$ref": f"#/components/schemas/{schema_name}", "components": DOCUMENT["components"]}
    errors = [f"{list(each.absolute_path)}: {each.message}" for each in Draft202012Validator(schema).iter_errors(value)]
    assert errors == []
    unnamed = sorted(_unnamed(DOCUMENT["components"]["schemas"][schema_name], value, schema_name))
    assert unnamed == []


def _unnamed(schema, value, path):
    if "$ref" in schema:
        schema = DOCUMENT["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    if isinstance(value, list) and "items" in schema:
        for item in value:
            yield from _unnamed(schema["items"], item, f"{path}[]")
    if isinstance(value, dict) and "properties" in schema:
        for name, item in value.items():
            if name not in schema["properties"]:
                yield f"{path}.{name}"
            else:
                yield from _unnamed(schema["properties"][name], item, f"{path}.{name}")


@both
async def test_every_list_and_resource_conforms_to_its_schema(running, number):
    for path, page, item in (
        ("/pads", "PadPage", "/pads/pad-1"),
        ("/drones", "DronePage", "/drones/uav-1"),
        ("/sessions", "SessionPage", f"/sessions/{number('session', 'one')}"),
        ("/verdicts", "VerdictPage", None),
        ("/tracks", "TrackPage", "/tracks/uav-1"),
        ("/blocks", "BlockPage", "/blocks/2"),
    ):
        conforms(page, await running.json(path))
        if item is not None:
            schema = DOCUMENT["paths"][f"/api/v1{path}/{{{names[path]}}}"]["get"]["responses"]["200"]
            name = schema["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
            conforms(name, await running.json(item))
    conforms("Status", await running.json("/status"))
    conforms("SignedIn", await running.json("/session"))
    conforms("LedgerTransactionDetail", await running.json(f"/transactions/{number('session', 'one')}"))


names = {"/pads": "pad_id", "/drones": "uav_id", "/sessions": "session_id", "/tracks": "uav_id", "/blocks": "number"}


@both
async def test_a_session_tells_its_whole_story(running, number):
    session_id = number("session", "one")
    detail = await running.json(f"/sessions/{session_id}")
    summary = detail["summary"]
    assert (summary["state"], summary["outcome"], summary["permission"]) == ("completed", "verified", "granted")
    steps = [(step["step"], step["source"], step["ok"]) for step in summary["steps"]]
    assert steps == [
        ("request", "ledger", True),
        ("poll", "pad", True),
        ("range", "pad", True),
        ("verdict", "ledger", True),
        ("permission", "ledger", True),
    ]
    assert [each["function"] for each in detail["transactions"]] == [
        "RequestProof",
        "SubmitProof",
        "CompleteInteraction",
    ]
    assert detail["verdict"]["tx_id"] == summary["verdict_tx"]
    assert detail["verdict"]["block"] == 3
    assert detail["evidence"]["ranges"]["anchors"][1]["range_mm"] == [4001, 4001, 4001]
    assert detail["session"]["claim"]["accuracy_mm"] == 900


async def test_a_pad_has_its_anchors_on_the_globe(running):
    pad = await running.json("/pads/pad-1")
    assert [anchor["anchor_id"] for anchor in pad["anchors"]] == ["A0", "A1", "A2", "A3"]
    first = pad["anchors"][0]
    assert first["lat_e7"] > pad["lat_e7"]
    assert first["lon_e7"] > pad["lon_e7"]
    assert "health" not in pad
    assert (await running.json("/pads/pad-2"))["anchors"] == []


@both
async def test_a_drone_has_its_authorisations_and_last_verdict(running):
    drone = await running.json("/drones/uav-1")
    assert [each["authorisation_id"] for each in drone["authorisations"]] == ["a1"]
    assert drone["verdict"]["outcome"] == "verified"
    assert (await running.json("/drones/uav-2"))["verdict"]["outcome"] == "refuted"


@both
async def test_filters(running, number):
    async def found(path, **parameters):
        return [item["session_id"] for item in (await running.json(path, **parameters))["items"]]

    one, two, three = (number("session", name) for name in ("one", "two", "three"))
    assert await found("/sessions") == [three, two, one]
    assert await found("/sessions", pad="pad-2") == [three]
    assert await found("/sessions", drone="uav-2") == [two]
    assert await found("/sessions", state="requested") == [three]
    assert await found("/sessions", outcome="refuted") == [two]
    assert await found("/sessions", action="land", drone="uav-2") == [two]
    assert await found("/sessions", action="dock") == []
    assert await found("/sessions", since_ms=START_MS + 10_000) == [three, two]
    assert await found("/sessions", until_ms=START_MS + 10_000) == [two, one]
    assert await found("/verdicts") == [two, one]
    assert await found("/verdicts", outcome="verified") == [one]
    assert await found("/verdicts", state="completed") == [one]
    assert await found("/verdicts", action="land") == [two, one]
    assert await found("/verdicts", action="takeoff") == []
    assert await found("/verdicts", pad="pad-2") == []
    assert await found("/verdicts", drone="uav-1") == [one]
    assert await found("/verdicts", since_ms=START_MS + 5_000) == [two]
    assert await found("/verdicts", after_block=-1) == [one, two]
    assert await found("/verdicts", after_block=3) == [two]


@both
@pytest.mark.parametrize("path", ["/pads", "/drones", "/sessions", "/verdicts", "/blocks", "/verdicts?after_block=0"])
async def test_pages_of_one_come_to_the_whole_list(running, path):
    whole = (await running.json(path))["items"]
    assert len(whole) >= 2
    paged, cursor = [], None
    for _ in range(20):
        separator = "&" if "?" in path else "?"
        page = await running.json(f"{path}{separator}limit=1" + (f"&cursor={cursor}" if cursor else ""))
        paged += page["items"]
        cursor = page.get("next")
        if cursor is None:
            break
    assert paged == whole


async def test_etags(running):
    first = await running.get("/drones/uav-1")
    tag = first.headers["etag"]
    again = await running.get("/drones/uav-1", headers={"If-None-Match": f'"x", W/{tag}'})
    assert (again.status_code, again.content) == (304, b"")
    assert (await running.get("/drones/uav-2", headers={"If-None-Match": tag})).status_code == 200


@both
async def test_blocks_and_transactions(running):
    blocks = (await running.json("/blocks"))["items"]
    assert [block["number"] for block in blocks] == [6, 5, 4, 3, 2, 1, 0]
    for later, earlier in pairwise(blocks):
        assert later["previous_hash"] == earlier["header_hash"]
    block = await running.json("/blocks/3")
    assert [(each["valid"], each["validation"]) for each in block["items"]] == [
        (True, "VALID"),
        (False, "MVCC_READ_CONFLICT"),
    ]
    decided = await running.json(f"/transactions/{block['items'][0]['tx_id']}")
    assert decided["event"] == "ProofDecided"
    assert json.loads(decided["event_payload"])["record"]["outcome"] == "verified"
    assert decided["endorsers"] == ["AuthorityMSP", "PadMSP"]
    assert decided["creator"]["msp_id"] == "PadMSP"


async def test_a_transaction_in_full_comes_from_the_ledger(running):
    block = await running.json("/blocks/3")
    decided, refused = (each["tx_id"] for each in block["items"])
    contents = await running.json(f"/transactions/{decided}/contents")
    conforms("TransactionContents", contents)
    function, argument = contents["arguments"]
    assert function["text"] == "SubmitProof"
    assert json.loads(argument["text"])
    assert [each["msp_id"] for each in contents["endorsements"]] == ["AuthorityMSP", "PadMSP"]
    keys = [write["key"] for access in contents["accesses"] for write in access["writes"]]
    assert any(key.startswith("verdict/") for key in keys)
    assert contents["event"]["name"] == "ProofDecided"
    assert (await running.get(f"/transactions/{refused}/contents")).status_code == 200
    genesis = (await running.json("/blocks/0"))["items"][0]
    config = await running.json(f"/transactions/{genesis['tx_id']}/contents") if genesis["tx_id"] else None
    if config is not None:
        conforms("TransactionContents", config)
        assert "PadMSP" in config["config"]["organisations"]


async def test_the_bytes_of_a_block_have_the_hash_that_its_header_names(running):
    for block in (await running.json("/blocks"))["items"]:
        answer = await running.get(f"/blocks/{block['number']}/data")
        assert answer.headers["content-type"] == "application/octet-stream"
        assert hashlib.sha256(answer.content).hexdigest() == block["data_hash"]


async def test_a_ledger_that_cannot_be_asked_is_said(running, chain):
    running.parts.source.blocks = _away
    block = await running.json("/blocks/3")
    answer = await running.get(f"/transactions/{block['items'][0]['tx_id']}/contents")
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:wonderland:problem:ledger-away")
    assert "the peer is gone" in answer.json()["detail"]
    assert (await running.get("/blocks/3/data")).status_code == 503


async def _away(start):
    raise LedgerError("the peer is gone")
    yield start


async def test_a_refused_duplicate_does_not_hide_the_valid_transaction(running, chain, facts, number):
    duplicate = facts.request("one")
    duplicate.code = 9
    chain.add(duplicate)
    await running.mirrored(chain.height)
    assert (await running.json(f"/transactions/{number('session', 'one')}"))["valid"] is True


async def test_status_says_which_ledger_and_how_far(running):
    status = await running.json("/status")
    ledger = status["ledger"]
    assert (ledger["kind"], ledger["notice"]) == ("embedded", "no multi-party trust")
    assert (ledger["height"], ledger["mirrored"], ledger["lag_ms"], ledger["halted"]) == (7, 7, 0, None)
    assert ledger["organisations"] == ["AuthorityMSP", "FleetMSP", "PadMSP"]
    counts = status["counts"]
    assert (counts["pads"], counts["drones"], counts["sessions"], counts["verdicts"]) == (2, 2, 3, 2)
    assert (counts["verified"], counts["refuted"], counts["inconclusive"]) == (1, 1, 0)


async def test_counts_are_the_same_after_a_restart(running, new_backend, serving, source_of, chain):
    before = (await running.json("/status"))["counts"]
    board = running.parts.board
    async with running.context.database.read() as session:
        await board.load(session)
    assert board.status()["counts"] == before


async def test_a_halted_mirror_is_said_and_rest_goes_on(running, chain, tx):
    chain.append([chain.envelope(tx(), "0" * 64)], b"\x00", previous=b"x" * 32)
    import asyncio

    async with asyncio.timeout(5):
        while running.parts.mirror.halted is None:
            await asyncio.sleep(0.01)
    status = await running.json("/status")
    assert "does not continue the chain" in status["ledger"]["halted"]
    assert status["ledger"]["halted_since_ms"] == running.context.clock()
    assert len((await running.json("/verdicts"))["items"]) == 2
    assert "wonderland_mirror_halted 1.0" in (await running.get("/metrics")).text


@pytest.mark.parametrize(
    ("path", "status", "code"),
    [
        ("/pads/nowhere", 404, "not-found"),
        ("/drones/nobody", 404, "not-found"),
        ("/blocks/999", 404, "not-found"),
        (f"/sessions/{'0' * 64}", 404, "not-found"),
        (f"/transactions/{'0' * 64}", 404, "not-found"),
        (f"/transactions/{'0' * 64}/contents", 404, "not-found"),
        ("/blocks/999/data", 404, "not-found"),
        ("/nothing", 404, "not-found"),
        ("/sessions/short", 422, "invalid-request"),
        ("/blocks/-1", 422, "invalid-request"),
        ("/blocks/99999999999999999999999", 422, "invalid-request"),
        ("/pads/%00", 422, "invalid-request"),
        ("/pads?limit=0", 422, "invalid-request"),
        ("/pads?limit=501", 422, "invalid-request"),
        ("/pads?colour=red", 422, "invalid-request"),
        ("/pads?cursor=%21", 400, "bad-request"),
        ("/pads?cursor=WzFd", 400, "bad-request"),
        ("/sessions?state=flying", 422, "invalid-request"),
        ("/sessions?pad=a%00b", 422, "invalid-request"),
        ("/sessions?since_ms=yesterday", 422, "invalid-request"),
        ("/verdicts?cursor=WyJhIiwgImIiXQ", 400, "bad-request"),
        ("/verdicts?cursor=WzFlOTksIDJd", 400, "bad-request"),
    ],
)
async def test_errors_are_problems(running, path, status, code):
    answer = await running.get(path)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    conforms("ProblemDetails", problem)
    assert problem["type"] == f"urn:wonderland:problem:{code}"
    assert problem["status"] == status
    if status == 422:
        assert problem["errors"]
        assert not problem["errors"][0]["message"].startswith(("Input", "Value error"))


async def test_what_is_wrong_with_a_parameter_is_said_in_finnish(running):
    answer = await running.http.get("/api/v1/sessions?limit=0", headers={"Accept-Language": "fi"})
    assert answer.json()["errors"] == [{"path": "query.limit", "message": "pitää olla vähintään 1"}]


async def test_wrong_methods_are_problems(running):
    answer = await running.http.put("/api/v1/pads")
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD")
    assert answer.json()["type"] == "urn:wonderland:problem:method-not-allowed"


async def test_an_unexpected_error_gives_a_reference_and_nothing_else(running, monkeypatch, caplog):
    def fail():
        raise RuntimeError("secret detail")

    monkeypatch.setattr(running.parts.board, "status", fail)
    answer = await running.get("/status")
    assert answer.status_code == 500
    problem = answer.json()
    assert problem["type"] == "urn:wonderland:problem:internal"
    assert "secret" not in answer.text
    reference = problem["detail"].rsplit(" ", 1)[1].rstrip(".")
    assert reference in caplog.text


async def test_health_and_metrics(running, clock):
    import httpx

    async with httpx.AsyncClient(base_url=running.url, trust_env=False) as stranger:
        assert (await stranger.get("/api/v1/health")).json() == {"status": "ok"}
        assert (await stranger.get("/api/v1/metrics")).status_code == 401
        bearer = {"Authorization": "Bearer " + "x" * 20}
        assert (await stranger.get("/api/v1/metrics", headers=bearer)).status_code == 401
    text = (await running.get("/metrics")).text
    assert "wonderland_backend_on_duty 1.0" in text
    assert "wonderland_mirror_blocks 7.0" in text
    assert "wonderland_mirror_transactions_total 14.0" in text


async def test_the_description_is_served_and_stable(running):
    answer = await running.get("/openapi.json")
    assert answer.json() == json.loads(json.dumps(DOCUMENT))
    assert json.dumps(openapi(new_app(Settings(), frozenset(), None))) == json.dumps(DOCUMENT)
    operations = [each for path in DOCUMENT["paths"].values() for each in path.values()]
    assert len({each["operationId"] for each in operations}) == len(operations)
    for name in ("LiveHello", "LiveSnapshot", "LiveDelta", "SessionSummary", "VerdictSummary"):
        assert name in DOCUMENT["components"]["schemas"]


def test_every_reference_of_the_description_resolves():
    def references(value):
        if isinstance(value, dict):
            if "$ref" in value:
                yield value["$ref"]
            for item in value.values():
                yield from references(item)
        elif isinstance(value, list):
            for item in value:
                yield from references(item)

    components = DOCUMENT["components"]
    known = {f"#/components/{kind}/{name}" for kind in ("schemas", "headers", "responses") for name in components[kind]}
    assert set(references(DOCUMENT)) <= known


@given(st.text(max_size=80))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_cursor_is_a_position_or_a_bad_request(text):
    from wonderland_backend.errors import BadRequest

    for kinds in ((int,), (str,), (int, str)):
        try:
            position = decode_cursor(text, *kinds)
        except BadRequest:
            continue
        assert [type(part) for part in position] == list(kinds)


async def heard(running, *latest):
    """Positions as the ingest keeps the last of each drone."""
    rows = [
        {"uav_id": uav_id, "pad_id": pad_id, "t_ms": t_ms, "body": f'{{"uav_id":"{uav_id}"}}'}
        for uav_id, pad_id, t_ms in latest
    ]
    async with running.context.database.write() as connection:
        await connection.execute(insert(LatestTrackRow), rows)


async def looked_for(running, text):
    answer = await running.http.post("/api/v1/search", json={"q": text})
    assert answer.status_code == 200, answer.text
    return answer.json()


@both
async def test_one_box_finds_everything_that_has_a_name(running, number):
    async def found(text):
        answer = await looked_for(running, text)
        conforms("Hits", answer)
        return [(hit["kind"], hit["id"]) for hit in answer["items"]]

    assert await found("aurajoki") == [("pad", "pad-1"), ("pad", "pad-2")]
    assert await found("UAV-2") == [("drone", "uav-2")]
    assert await found("fin87ASTRDGE12k8") == [("drone", "uav-1"), ("drone", "uav-2")]
    session = number("session", "one")
    assert (await found(session[:8]))[0] == ("session", session)
    block = await running.json("/blocks/3")
    tx_id = block["items"][1]["tx_id"]
    assert ("transaction", tx_id) in await found(tx_id)
    assert (await found("3"))[-1] == ("block", "3")
    await heard(running, ("1581F5FK-GHOST", "pad-2", START_MS), ("uav-1", "pad-1", START_MS))
    assert await found("ghost") == [("broadcast", "1581F5FK-GHOST")]
    (hit,) = (await looked_for(running, "ghost"))["items"]
    assert (hit["detail"], hit["heard_ms"]) == ("pad-2", START_MS)
    assert await found("uav-1") == [("drone", "uav-1")], "what is registered is found once"
    for nothing in ("%", "_", "record", "lat_e7", "'; DROP TABLE pads; --", "zzzzzz", "999999999"):
        assert await found(nothing) == []
    assert (await running.http.post("/api/v1/search", json={"q": ""})).status_code == 422
