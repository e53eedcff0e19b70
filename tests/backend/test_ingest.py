"""What agents report: only from whom the ledger knows, durable before it is acknowledged, never the ledger's word."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json

import pytest
import websockets
from kit.backend import furnish, serving
from kit.bus_agents import BusAgents
from kit.facts import Facts
from kit.ways import WAYS
from sqlalchemy import func, select

from wonderland_backend.db.tables.ledger import VerdictRow
from wonderland_backend.db.tables.reported import IrregularRow, SpoolRow, StepRow, TrackRow
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import OrganisationWrite
from wonderland_bus.errors import BusUnreachableError

START_MS = 1_800_000_000_000
TRACK = {
    "uav_id": "uav-1",
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 42_000,
    "accuracy_mm": 3_000,
    "transport": "wifi",
}
HEALTH = {
    "anchors": [{"anchor_id": "A0", "state": "up", "firmware": "1.0"}, {"anchor_id": "A1", "state": "silent"}],
    "spool": {"records": 3, "bytes": 900, "dropped": 0},
    "receiver": {"frames": 10, "bad": 1},
    "prekeys": 7,
    "version": "0.1.0",
}
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


def estimate(session_id, **more):
    return {
        "session_id": session_id,
        "uav_id": "uav-1",
        "lat_e7": 604_518_900,
        "lon_e7": 222_666_000,
        "east_mm": 10,
        "north_mm": 1_000,
        "ee_mm2": 100,
        "en_mm2": 5,
        "nn_mm2": 90,
        "rounds": 12,
        "likelihood_ppm": 900_000,
        "ranges": {"A0": 4_000, "A1": -1},
    } | more


def step(session_id, name="poll", **more):
    return {"session_id": session_id, "uav_id": "uav-1", "step": name, "t_ms": START_MS + 30, "ok": True} | more


@pytest.fixture(scope="module")
def bus_agents(tmp_path_factory, authorities):
    with BusAgents(tmp_path_factory.mktemp("bus") / "agents", authorities).router() as agents:
        yield agents


@pytest.fixture(params=WAYS)
async def running(request, new_backend, chain, source_of):
    """The same by WebSocket and over a bus."""
    furnish(chain)
    bus = request.getfixturevalue("bus_agents") if request.param == "zenoh" else None
    async with serving(new_backend(source_of(chain), **({} if bus is None else {"bus": bus.settings}))) as client:
        await client.mirrored(chain.height)
        if bus is not None:
            client.bus = bus
            await client.backend.bus.listener.listening.wait()
        yield client


async def count(running, model):
    async with running.context.database.read() as session:
        return (await session.execute(select(func.count()).select_from(model))).scalar_one()


@both
async def test_records_are_taken_in_and_shown_as_unverified(running, agent_client, number):
    session_id = number("session", "three")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent_id="pad-2")
        assert await agent.hello() == {"type": "welcome", "acknowledged": 0}
        answer = await agent.report(
            ("track", TRACK),
            ("track", TRACK | {"lat_e7": 604_518_001}),
            ("estimate", estimate(session_id, truth_east_mm=30, truth_north_mm=980)),
            ("step", step(session_id, "match", detail="codes agree")),
            ("health", HEALTH),
            ("session_end", {"session_id": session_id, "state": "cancelled", "end": "timeout", "steps": []}),
            ("dropped", {"from_seq": 90, "to_seq": 99}),
        )
        assert answer == {"type": "ack", "seq": 7}
        (track,) = (await running.json("/tracks"))["items"]
        assert track == TRACK | {"lat_e7": 604_518_001, "t_ms": START_MS, "pad_id": "pad-2", "verified": False}
        history = await running.json("/tracks/uav-1")
        assert [item["lat_e7"] for item in history["items"]] == [604_518_000, 604_518_001]
        assert (await running.json("/drones/uav-1"))["track"] == track
        detail = await running.json(f"/sessions/{session_id}")
        assert detail["estimates"][0]["verified"] is False
        assert detail["estimates"][0]["truth_north_mm"] == 980
        assert detail["reported_ends"] == [
            {"source": "pad", "t_ms": START_MS, "state": "cancelled", "end": "timeout", "verified": False}
        ]
        assert detail["summary"]["state"] == "requested", "an agent's word changes nothing on the ledger's record"
        steps = {each["step"]: each for each in detail["summary"]["steps"]}
        assert steps["match"] == {
            "step": "match",
            "t_ms": START_MS + 30,
            "ok": True,
            "detail": "codes agree",
            "source": "pad",
        }
        pad = await running.json("/pads/pad-2")
        assert pad["health"]["connected"] is True
        assert pad["health"]["prekeys"] == 7
        assert (await running.json("/status"))["counts"]["pads_connected"] == 1
    await gone(running, "pad-2")
    assert (await running.json("/pads/pad-2"))["health"]["connected"] is False
    assert await count(running, VerdictRow) == 2


FINDING = {"uav_id": "uav-1", "kind": "two_places", "count": 3, "distance_mm": 900_000, "other_transport": "ble5"}
DRIP = {"state": "verified", "det": "2001:30:280:1405:1:2:3:4", "format": "wrapper", "t_ms": START_MS}
DRIP |= {"covers_location": True, "bound": False}


@both
async def test_what_is_odd_about_broadcasts_is_kept_and_shown(running, agent_client, number):
    session_id = number("session", "three")
    requested_ms = (await running.json(f"/sessions/{session_id}"))["summary"]["requested_ms"]
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent_id="pad-2")
        await agent.hello()
        heard = TRACK | {
            "latency_ms": -20,
            "lost": 4,
            "duplicates": 9,
            "transports": ["ble4", "wifi-nan"],
            "drip": DRIP,
            "description": "<b>Engine</b> fire",
            "description_type": "emergency",
            "area_count": 3,
            "area_radius_mm": 120_000,
            "ua_type": 2,
            "height_accuracy_mm": 10_000,
        }
        await agent.report(
            ("track", heard), ("finding", FINDING), ("finding", FINDING | {"uav_id": "uav-2", "kind": "time_off"})
        )
        (track,) = (await running.json("/tracks"))["items"]
        assert track == heard | {"t_ms": START_MS, "pad_id": "pad-2", "verified": False}
        first = await running.json("/findings", limit=1)
        assert first["items"][0]["kind"] == "time_off"
        (second,) = (await running.json("/findings", limit=1, cursor=first["next"]))["items"]
        assert second == FINDING | {"t_ms": START_MS, "pad_id": "pad-2", "verified": False}
        assert (await running.json("/findings", drone="uav-1", pad="pad-2"))["items"] == [second]
        assert (await running.json("/findings", until_ms=START_MS - 1))["items"] == []
        wrong = await agent.report(("finding", FINDING | {"kind": "colour"}))
        assert (wrong["type"], wrong["code"]) == ("rejected", "bad_body")
        await agent.receive()
        await agent.report(("finding", FINDING), t_ms=requested_ms)
    detail = await running.json(f"/sessions/{session_id}")
    assert requested_ms in [finding["t_ms"] for finding in detail["findings"]]
    assert {finding["uav_id"] for finding in detail["findings"]} == {detail["summary"]["uav_id"]}


@both
async def test_who_signed_is_bound_to_the_session_and_apart_from_its_verdict(running, agent_client, number):
    """Only the session's own pad can say; a drone or another pad that ends it says nothing of signatures."""
    session_id = number("session", "one")
    summary = (await running.json(f"/sessions/{session_id}"))["summary"]
    end = {"session_id": session_id, "state": "decided", "steps": []}
    other = DRIP | {"format": "link", "state": "endorsed", "covers_location": False}
    for pad_id, signature in (("pad-2", other), (summary["pad_id"], DRIP | {"refused": 2})):
        async with running.connect("/ingest") as socket:
            agent = agent_client(socket, agent_id=pad_id)
            await agent.hello()
            assert (await agent.report(("session_end", end | {"signature": signature})))["type"] == "ack"
    detail = await running.json(f"/sessions/{session_id}")
    assert detail["signature"] == DRIP | {"refused": 2}
    assert detail["verdict"]["outcome"] == summary["outcome"]
    answer = await running.json("/conformance", serial=summary["uav_id"])
    assert (answer["proof"]["proof_id"], answer["signature"]) == (session_id, DRIP | {"refused": 2})


async def gone(running, pad_id):
    async with asyncio.timeout(5):
        while running.parts.agents.is_connected(pad_id):
            await asyncio.sleep(0.01)


async def test_after_a_reconnect_nothing_is_lost_or_doubled(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        assert (await agent.report(("track", TRACK), ("track", TRACK)))["seq"] == 2
    await gone(running, "pad-1")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        assert (await agent.hello())["acknowledged"] == 2
        assert (await agent.report(("track", TRACK), ("track", TRACK), ("track", TRACK)))["seq"] == 3
        agent.seq = 0
        assert (await agent.report(("track", TRACK)))["seq"] == 3
    assert await count(running, TrackRow) == 3
    await gone(running, "pad-1")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, spool="1" * 32)
        assert (await agent.hello())["acknowledged"] == 0, "another spool counts for itself"


async def test_the_same_agent_replaces_its_hanging_connection(running, agent_client):
    async with running.connect("/ingest") as first, running.connect("/ingest") as second:
        await agent_client(first).hello()
        assert (await agent_client(second).hello())["type"] == "welcome"
        with pytest.raises(websockets.ConnectionClosed) as closed:
            await asyncio.wait_for(first.recv(), 5)
        assert closed.value.rcvd.code == 4409
        assert running.parts.agents.is_connected("pad-1")


async def test_a_second_agent_of_the_same_pad_is_refused(running, agent_client):
    async with running.connect("/ingest") as first, running.connect("/ingest") as second:
        agent = agent_client(first)
        await agent.hello()
        refused = await agent_client(second, spool="1" * 32).hello()
        assert refused["code"] == "duplicate_agent"
        await closed_with(second, 4403)
        assert (await agent.report(("track", TRACK)))["type"] == "ack"


async def closed_with(socket, code):
    with pytest.raises(websockets.ConnectionClosed) as closed:
        await asyncio.wait_for(socket.recv(), 5)
    assert closed.value.rcvd.code == code


@pytest.mark.parametrize(
    ("who", "change", "code", "closed"),
    [
        ({}, {"signature": base64.urlsafe_b64encode(b"x" * 70).rstrip(b"=").decode()}, "not_authenticated", 4401),
        ({"agent_id": "pad-1"}, {"id": "pad-2"}, "not_authenticated", 4401),
        ({}, {"spool": "2" * 32}, "not_authenticated", 4401),
        ({}, {"msp_id": "NoMSP"}, "unknown_organisation", 4401),
        ({}, {"msp_id": "FleetMSP"}, "not_authenticated", 4401),
        ({}, {"msp_id": "OrdererMSP"}, "not_authenticated", 4401),
        ({}, {"certificate": "no certificate"}, "not_authenticated", 4401),
        ({}, {"protocol": "wonderland-ingest/9"}, "bad_hello", 4401),
        ({}, {"extra": 1}, "bad_hello", 4401),
        ({}, {"spool": "short"}, "bad_hello", 4401),
    ],
)
async def test_agents_that_are_refused(running, agent_client, who, change, code, closed):
    async with running.connect("/ingest") as socket:
        refused = await agent_client(socket, **who).hello(**change)
        assert (refused["type"], refused["code"]) == ("refused", code), refused
        await closed_with(socket, closed)
    assert len(running.parts.agents) == 0


async def test_the_certificate_must_be_of_that_agent(running, agent_client, authorities):
    for enrolment in (
        authorities.enrol("pad_operator", "PadMSP", role="pad_operator", id="pad-1"),
        authorities.enrol("pad-9", "PadMSP", role="pad", id="pad-9"),
        authorities.enrol("plain", "PadMSP"),
    ):
        async with running.connect("/ingest") as socket:
            refused = await agent_client(socket, enrolment=enrolment).hello()
            assert refused["code"] == "wrong_role"
            await closed_with(socket, 4403)


async def test_another_organisations_pad_of_the_same_name_is_not_it(running, agent_client, authorities):
    """Its authority is one of the channel's: who may be called pad-1 is told by the ledger."""
    theirs = authorities.enrol("pad-1", "FleetMSP", role="pad", id="pad-1")
    drone = authorities.enrol("uav-1", "PadMSP", role="uav", id="uav-1")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        for who in (
            {"enrolment": theirs, "msp_id": "FleetMSP"},
            {"enrolment": theirs, "msp_id": "FleetMSP", "spool": "1" * 32},
            {"enrolment": drone, "agent": "uav", "agent_id": "uav-1"},
        ):
            async with running.connect("/ingest") as other:
                refused = await agent_client(other, **who).hello()
                assert (refused["type"], refused["code"]) == ("refused", "wrong_organisation"), refused
                await closed_with(other, 4403)
        assert (await agent.report(("track", TRACK)))["type"] == "ack"
    async with running.connect("/ingest") as other:
        refused = await agent_client(other, enrolment=theirs, msp_id="FleetMSP").hello()
        assert refused["message"] == "on the ledger pad-1 belongs to PadMSP, not to FleetMSP"


async def test_a_pad_that_the_ledger_gives_to_somebody_else_is_sent_away(running, agent_client, authorities, chain):
    """Until it was registered nobody was known to own it."""
    early = authorities.enrol("pad-9", "FleetMSP", role="pad", id="pad-9")
    async with running.connect("/ingest") as first:
        assert (await agent_client(first, agent_id="pad-9", enrolment=early, msp_id="FleetMSP").hello())["type"] == (
            "welcome"
        )
        chain.add(Facts().put_pad("pad-9"))
        await closed_with(first, 4401)
    async with running.connect("/ingest") as second:
        assert (await agent_client(second, agent_id="pad-9").hello())["type"] == "welcome"


async def test_a_recorded_hello_serves_no_second_time(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        challenge = await agent.receive()
    async with running.connect("/ingest") as socket:
        again = agent_client(socket)
        second = await again.receive()
        assert second["nonce"] != challenge["nonce"]

        async def recorded():
            return challenge

        again.receive, real = recorded, again.receive
        again.receive = recorded
        with pytest.raises(KeyError):
            (await again.hello())["code"]
        again.receive = real
        assert (await again.receive())["code"] == "not_authenticated"


async def test_expired_and_foreign_certificates(running, agent_client, authorities, tmp_path, clock):
    from wonderland_fabric_gateway.ca.local import LocalCa

    impostor = LocalCa.create(tmp_path / "impostor", "PadMSP").enrol(
        "pad-1", attributes={"pol.role": "pad", "pol.id": "pad-1"}
    )
    async with running.connect("/ingest") as socket:
        if running.bus is None:
            refused = await agent_client(socket, enrolment=impostor).hello()
            assert refused["code"] == "not_authenticated"
        else:
            with pytest.raises(
                BusUnreachableError, match="knows an authority of that name, which did not issue this certificate"
            ):
                await agent_client(socket, enrolment=impostor).hello()
    clock.now_ms += 50 * 365 * 86_400_000
    async with running.connect("/ingest") as socket:
        refused = await agent_client(socket).hello()
        assert refused["code"] == "not_authenticated"
        assert "expired" in refused["message"]


async def test_a_revocation_on_the_ledger_shuts_the_agent_out(running, agent_client, authorities, database):
    from wonderland_backend.db.tables.ledger import OrganisationRow

    pad_id = "pad-7" if running.bus is None else "pad-8"
    enrolment = authorities.enrol(pad_id, "PadMSP", role="pad", id=pad_id)
    async with running.connect("/ingest") as socket:
        assert (await agent_client(socket, agent_id=pad_id, enrolment=enrolment).hello())["type"] == "welcome"
        running.backend.standing.check()
        assert running.parts.agents.is_connected(pad_id)
    ca = authorities.cas["PadMSP"]
    ca.revoke(serial=enrolment.certificate.serial)
    async with database.read() as session:
        definitions = {row.msp_id: json.loads(row.definition) for row in await session.scalars(select(OrganisationRow))}
    definitions["PadMSP"]["revocation_lists"] = [ca.revocation_list_pem().decode()]
    async with running.connect("/ingest") as socket, running.connect("/ingest") as other:
        await agent_client(socket, agent_id=pad_id, enrolment=enrolment).hello()
        await agent_client(other).hello()
        organisations = [
            OrganisationWrite(msp_id, json.dumps(each), block=9, tx_index=0) for msp_id, each in definitions.items()
        ]
        running.backend.standing.committed(Changes(organisations=organisations))
        await closed_with(socket, 4401)
        assert running.parts.agents.is_connected("pad-1")
    async with running.connect("/ingest") as socket:
        refused = await agent_client(socket, agent_id=pad_id, enrolment=enrolment).hello()
        assert refused["code"] == "not_authenticated"
        assert "revoked" in refused["message"]
    definitions["PadMSP"]["revocation_lists"] = ["rubbish"]
    running.parts.members.configure((msp_id, json.dumps(each)) for msp_id, each in definitions.items())
    async with running.connect("/ingest") as socket:
        refused = await agent_client(socket).hello()
        assert refused["code"] == "unknown_organisation", "a definition that cannot be read lets nobody in"


async def test_bad_records_are_refused_alone(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        answers = [
            await agent.report(
                ("track", TRACK | {"lat_e7": 910_000_000}),
                ("track", TRACK | {"colour": "red"}),
                ("track", TRACK | {"lat_e7": 1.5}),
                ("weather", {}),
                ("track", TRACK),
            )
        ]
        while answers[-1]["type"] != "ack":
            answers.append(await agent.receive())
        assert [(each["type"], each["seq"]) for each in answers] == [
            ("rejected", 1),
            ("rejected", 2),
            ("rejected", 3),
            ("rejected", 4),
            ("ack", 5),
        ]
        assert [each["code"] for each in answers[:4]] == ["bad_body", "bad_body", "bad_body", "unknown_kind"]
        assert "lat_e7" in answers[0]["message"]
    assert await count(running, TrackRow) == 1
    assert await count(running, IrregularRow) == 4


async def test_a_clock_far_ahead_does_not_hide_others(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        rejected = await agent.report(("track", TRACK), t_ms=START_MS + 3_600_000)
        assert (rejected["type"], rejected["code"]) == ("rejected", "clock")
        assert (await agent.receive())["type"] == "ack"
        assert (await agent.report(("step", step("0" * 64)), t_ms=START_MS + 3_600_000))["type"] == "ack"


async def test_older_positions_do_not_replace_newer_ones(running, agent_client):
    async with running.connect("/ingest") as first, running.connect("/ingest") as second:
        one, two = agent_client(first), agent_client(second, agent_id="pad-2")
        await one.hello()
        await two.hello()
        await one.report(("track", TRACK | {"lat_e7": 1}), t_ms=START_MS + 500)
        await two.report(("track", TRACK | {"lat_e7": 2}), t_ms=START_MS + 400)
    (track,) = (await running.json("/tracks"))["items"]
    assert track["lat_e7"] == 1
    assert await count(running, TrackRow) == 2


async def test_steps_of_other_pads_sessions_do_not_count(running, agent_client, number):
    session_id = number("session", "three")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent_id="pad-1")
        await agent.hello()
        await agent.report(("step", step(session_id, "confirm")))
    names = [each["step"] for each in (await running.json(f"/sessions/{session_id}"))["summary"]["steps"]]
    assert names == ["request"]


async def test_drones_report_their_own_steps_only(running, agent_client, number):
    session_id = number("session", "three")
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket, agent="uav", agent_id="uav-1", msp_id="FleetMSP")
        assert (await agent.hello())["type"] == "welcome"
        assert (await agent.report(("step", step(session_id, "match"))))["type"] == "ack"
        for kind, body in (("track", TRACK), ("estimate", estimate(session_id)), ("step", step("0" * 64, uav_id="x"))):
            rejected = await agent.report((kind, body))
            assert (rejected["type"], rejected["code"]) == ("rejected", "not_allowed")
            await agent.receive()
    steps = (await running.json(f"/sessions/{session_id}"))["summary"]["steps"]
    assert [(each["step"], each["source"]) for each in steps] == [("request", "ledger"), ("match", "uav")]


@pytest.mark.parametrize(
    "frame",
    [
        "no json",
        "[]",
        '{"type":"records"}',
        '{"type":"records","records":[{"seq":0,"kind":"track","t_ms":1,"body":{}}]}',
        '{"type":"records","records":[{"kind":"track","t_ms":1,"body":{}}]}',
        '{"type":"records","records":[5]}',
        '{"type":"records","records":[{"seq":2,"kind":"x","t_ms":1,"body":{}},{"seq":2,"kind":"x","t_ms":1,"body":{}}]}',
        '{"type":"records","records":[{"seq":1e99,"kind":"track","t_ms":1,"body":{}}]}',
        b"binary",
        "{" * 10_000,
        '{"type":"records","records":[{"seq":1,"kind":"track","t_ms":1,"body":{"x":NaN}}]}',
        '{"type":"records","records":[{"seq":1,"kind":"track","t_ms":1,"body":' + "[" * 60_000 + "]" * 60_000 + "}]}",
        '{"type":"answer","request_id":"' + "0" * 32 + '","accepted":true}',
        '{"type":"records","records":[{"seq":' + "9" * 5_000 + ',"kind":"track","t_ms":1,"body":{}}]}',
    ],
)
async def test_frames_that_are_none_close_the_connection(running, agent_client, frame):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.send(frame)
        refused = await agent.receive()
        assert refused["type"] == "refused"
        assert refused["code"] in {"bad_frame", "bad_order"}
        await closed_with(socket, 4400)
    assert await count(running, SpoolRow) == 0


async def test_frames_beyond_the_limit_close_the_connection(running, agent_client):
    async with running.connect("/ingest", max_size=None) as socket:
        agent = agent_client(socket)
        await agent.hello()
        with pytest.raises(websockets.ConnectionClosed) as closed:
            await agent.send('{"type":"' + "x" * 300_000)
            await agent.receive()
        assert closed.value.rcvd.code == 1009


async def test_nothing_is_acknowledged_while_the_database_fails(running, agent_client, monkeypatch):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()

        async def full(_batches):
            raise OSError("No space left on device")

        with monkeypatch.context() as patched:
            patched.setattr(running.parts.intake, "_write", full)
            await agent.send(
                {"type": "records", "records": [{"seq": 1, "kind": "track", "t_ms": START_MS, "body": TRACK}]}
            )
            await closed_with(socket, 1013)
    await gone(running, "pad-1")
    assert (await running.json("/tracks"))["items"] == []
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        assert (await agent.hello())["acknowledged"] == 0
        assert (await agent.report(("track", TRACK)))["seq"] == 1


def _track(seq):
    return {"type": "records", "records": [{"seq": seq, "kind": "track", "t_ms": START_MS, "body": TRACK}]}


async def test_what_comes_while_others_are_written_is_read_and_acknowledged_in_order(
    running, agent_client, monkeypatch
):
    write, begun, go_on, sizes = running.parts.intake._write, asyncio.Event(), asyncio.Event(), []

    async def slow(batches):
        sizes.append(len(batches))
        begun.set()
        await go_on.wait()
        await write(batches)

    monkeypatch.setattr(running.parts.intake, "_write", slow)
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.send(_track(1))
        await begun.wait()
        for seq in range(2, 6):
            await agent.send(_track(seq))
        while running.parts.intake._queue.qsize() < 4:
            await asyncio.sleep(0.005)
        go_on.set()
        assert [await agent.receive() for _ in range(5)] == [{"type": "ack", "seq": seq} for seq in range(1, 6)]
    assert sizes == [1, 4]
    assert await count(running, TrackRow) == 5


async def test_after_a_batch_that_was_lost_none_of_its_connection_is_kept(running, agent_client, monkeypatch):
    intake = running.parts.intake
    write, begun, go_on, failures = (
        intake._write,
        asyncio.Event(),
        asyncio.Event(),
        [OSError("No space left on device")],
    )

    async def fails_once(batches):
        begun.set()
        await go_on.wait()
        if failures:
            raise failures.pop()
        await write(batches)

    monkeypatch.setattr(intake, "_write", fails_once)
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.send(_track(1))
        await begun.wait()
        await agent.send(_track(2))
        while not intake._queue.qsize():
            await asyncio.sleep(0.005)
        go_on.set()
        await closed_with(socket, 1013)
    await gone(running, "pad-1")
    assert await count(running, TrackRow) == 0, "2 without 1 would be a gap that nobody fills"
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        assert (await agent.hello())["acknowledged"] == 0
        assert (await agent.report(("track", TRACK), ("track", TRACK)))["seq"] == 2


async def test_a_frame_that_is_none_is_refused_after_what_came_before_it(running, agent_client):
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.send(_track(1))
        await socket.send("no JSON")
        assert await agent.receive() == {"type": "ack", "seq": 1}
        assert (await agent.receive())["type"] == "refused"


async def test_absurd_records_are_refused_alone(running, agent_client):
    records = [
        '"kind":"track","t_ms":1,"body":{"x":' + "9" * 200 + "}",
        '"kind":"track","t_ms":1,"body":{"x":' + "[" * 150 + "]" * 150 + "}",
        '"kind":"track","t_ms":1,"body":{"lat_e7":1e400}',
        '"kind":"\\u0000' + "x" * 500 + '","t_ms":1,"body":{}',
        '"kind":"track","t_ms":-1,"body":{}',
        '"kind":"track","t_ms":1,"body":5',
        '"kind":"track"',
    ]
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        for seq, record in enumerate(records, start=1):
            await agent.send(f'{{"type":"records","records":[{{"seq":{seq},{record}}}]}}')
            rejected = await agent.receive()
            assert (rejected["type"], rejected["code"] in {"bad_body", "bad_record", "unknown_kind"}) == (
                "rejected",
                True,
            ), rejected
            assert await agent.receive() == {"type": "ack", "seq": seq}
    assert await count(running, IrregularRow) == len(records)


async def test_silent_connections_shut_no_agent_out(running, agent_client, monkeypatch):
    """Whoever opens many and says nothing loses the oldest; agents say who they are at once."""
    monkeypatch.setattr("wonderland_backend.ingest.serving.MAX_UNPROVEN", 3)
    async with contextlib.AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(running.connect("/ingest")) for _ in range(5)]
        for socket in silent:
            assert json.loads(await asyncio.wait_for(socket.recv(), 5))["type"] == "challenge"
        async with running.connect("/ingest") as socket:
            assert (await agent_client(socket).hello())["type"] == "welcome"
        for socket in silent[:3]:
            assert json.loads(await asyncio.wait_for(socket.recv(), 5))["code"] == "no_hello"
            await closed_with(socket, 4401)
        assert running.parts.agents.unproven == 2
    async with asyncio.timeout(5):
        while running.parts.agents.unproven:
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("running", ["websocket"], indirect=True)
async def test_browsers_of_other_origins_get_no_further(running):
    with pytest.raises(websockets.InvalidStatus) as refused:
        async with running.connect("/ingest", origin="http://evil.example"):
            pass
    assert refused.value.response.status_code == 403


async def test_old_telemetry_is_forgotten(running, agent_client, clock):
    from wonderland_backend.tracks.queries import Retention, forget

    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        await agent.report(("track", TRACK), ("step", step("0" * 64)), ("track", TRACK | {"lat_e7": 5.5}))
    async with running.context.database.write() as connection:
        await forget(connection, Retention(*[START_MS + 1] * 4))
    assert await count(running, TrackRow) == 0
    assert await count(running, IrregularRow) == 0
    assert await count(running, StepRow) == 1, "evidence stays"
