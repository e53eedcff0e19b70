"""The past is shown as it was: what was known then, no more and no less, byte by byte what the live map showed."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from kit.chain import Tx
from sqlalchemy import text

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.sessions import Precedence

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)

HEALTH = {
    "anchors": [{"anchor_id": "A0", "state": "up"}],
    "spool": {"records": 3, "bytes": 900, "dropped": 0},
    "receiver": {"frames": 10, "bad": 1},
    "prekeys": 7,
    "version": "0.1.0",
}


def track(uav_id="uav-1", lat_e7=604_518_000):
    return {"uav_id": uav_id, "lat_e7": lat_e7, "lon_e7": 222_666_000, "transport": "wifi"}


def estimate(session_id, **more):
    place = {"session_id": session_id, "uav_id": "uav-1", "lat_e7": 604_518_900, "lon_e7": 222_666_000}
    numbers = {"east_mm": 10, "north_mm": 1_000, "ee_mm2": 100, "en_mm2": 5, "nn_mm2": 90, "rounds": 12}
    return place | numbers | {"likelihood_ppm": 900_000, "ranges": {"A0": 4_000}} | more


def step(session_id, name, t_ms, **more):
    return {"session_id": session_id, "uav_id": "uav-1", "step": name, "t_ms": t_ms, "ok": True} | more


async def film(running, **query):
    """The frames of a film, its last line apart."""
    answer = await running.get("/replay/frames", params=query)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith("application/x-ndjson")
    lines = [json.loads(line) for line in answer.text.splitlines()]
    assert lines[-1]["type"] == "end"
    return lines[:-1], lines[-1]


class Story:
    """Things that happen one after the other; after each the live connection's state is kept, with its time."""

    def __init__(self, running, clock, recorder):
        self.running = running
        self.clock = clock
        self.recorder = recorder
        self.moments = []

    async def then(self, act=None, after_ms=1_000):
        self.clock.now_ms += after_ms
        if act is not None:
            await act
        await self.recorder.settle()
        self.moments.append((self.clock.now_ms, self.recorder.shown.text()))


async def proof(story, running, chain, facts, number, agent_client):
    """A pad connects, ranges a drone, the ledger decides; the officer acknowledges what it refuted."""
    clock = story.clock
    session_id = number("session", "four")

    async def mirrored(*transactions):
        chain.add(*transactions)
        await running.mirrored(chain.height)

    async def acts(act, which=None, **more):
        which = which or {"session": session_id, "kind": "refuted"}
        (alert,) = (await running.json("/alerts", **which))["items"]
        body = {"act": act, "revision": alert["revision"]} | more
        answer = await running.http.post(f"/api/v1/alerts/{alert['alert_id']}/acts", json=body)
        assert answer.status_code == 200, answer.text

    await story.then()
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)
        await story.then(agent.hello())
        await story.then(agent.report(("track", track()), ("health", HEALTH), t_ms=clock.now_ms))
        asked_ms = clock.now_ms
        await story.then(mirrored(facts.request("four", t_ms=asked_ms)))
        await story.then(agent.report(("step", step(session_id, "poll", clock.now_ms, ok=False)), t_ms=clock.now_ms))
        await story.then(agent.report(("step", step(session_id, "poll", clock.now_ms)), t_ms=clock.now_ms))
        await story.then(agent.report(("estimate", estimate(session_id)), t_ms=clock.now_ms))
        # Of before, but heard of only now: it was not known then, and does not take the newer one's place.
        await story.then(agent.report(("track", track(lat_e7=1)), t_ms=clock.now_ms - 60_000))
        await story.then(agent.report(("estimate", estimate(session_id, rounds=40)), t_ms=clock.now_ms))
        await story.then(mirrored(facts.decide("four", t_ms=asked_ms, outcome="refuted")))
        await story.then(acts("assign", assignee="Aino"))
        await story.then(acts("acknowledge", note="seen"))
        await story.then(acts("reopen"))
        await story.then(acts("snooze", until_ms=clock.now_ms + 9_000))
        await story.then(
            mirrored(facts.put_pad(name="Renamed"), facts.complete("four", t_ms=asked_ms, state="cancelled"))
        )
        await story.then(
            agent.report(("track", track("uav-2")), ("health", HEALTH | {"prekeys": 6}), t_ms=clock.now_ms)
        )
        clock.now_ms += 999
    await story.then(after_ms=1)
    await story.then(mirrored(facts.put_uav("uav-9"), facts.put_pad("pad-3")))
    await story.then(running.backend.watch.look_once(), after_ms=61_000)
    async with running.connect("/ingest") as socket:
        agent = agent_client(socket)

        async def come_back():
            agent.seq = (await agent.hello())["acknowledged"]

        await story.then(come_back())
        await story.then(agent.report(("health", HEALTH), t_ms=clock.now_ms))
        # The alert's cause has ended before anybody acknowledged it: it stays until somebody does.
        await story.then(running.backend.watch.look_once())
        await story.then(acts("acknowledge", {"kind": "pad_silent", "state": "returned"}))
        await story.then(acts("note", {"kind": "pad_silent", "state": "over"}, note="power cut"))
        clock.now_ms += 999
    await story.then(after_ms=1)
    return session_id


@both
async def test_replay_is_what_the_live_map_showed(
    running, clock, chain, facts, number, agent_client, recorder, texts, new_shown
):
    _, state_text = texts
    async with running.live() as socket:
        story = Story(running, clock, recorder(socket))
        session_id = await proof(story, running, chain, facts, number, agent_client)
    assert len({text for _, text in story.moments}) > 14, "nearly every act changed what was shown"
    for t_ms, expected in story.moments:
        for later_ms in (0, 998):
            state = await running.json("/replay/state", at_ms=t_ms + later_ms)
            assert state_text(state) == expected, f"at {t_ms - START_MS} ms"
    # A film from the first moment on comes through the same states, whatever its steps.
    first_ms, last_ms = story.moments[0][0], story.moments[-1][0]
    for step_ms in (250, 1_000):
        frames, end = await film(running, from_ms=first_ms, until_ms=last_ms, step_ms=step_ms)
        assert end == {"type": "end", "t_ms": last_ms, "complete": True}
        shown = new_shown()
        rest = iter(frames)
        following = next(rest, None)
        for t_ms, expected in story.moments:
            while following is not None and following.get("t_ms", 0) <= t_ms:
                shown.take(following)
                following = next(rest, None)
            assert shown.text() == expected, f"film in steps of {step_ms} ms, at {t_ms - START_MS} ms"
    # The session's page, too, knows no more than was known.
    for t_ms, _ in story.moments:
        answer = await running.get(f"/replay/sessions/{session_id}", params={"at_ms": t_ms})
        state = await running.json("/replay/state", at_ms=t_ms)
        summaries = [each for each in state["sessions"] if each["session_id"] == session_id]
        if not summaries:
            assert answer.status_code == 404
            continue
        detail = answer.json()
        assert detail["summary"] == summaries[0]
        assert detail["session"]["state"] == summaries[0]["state"]
        known = [each for each in state["verdicts"] if each["session_id"] == session_id]
        assert ([detail["verdict"]] if "verdict" in detail else []) == known
        assert ("evidence" in detail) == bool(known)
    assert detail == (await running.json(f"/sessions/{session_id}"))


async def test_a_sessions_page_of_then_knows_nothing_that_people_did_later(running, clock, chain, facts, number):
    begin_ms = clock.now_ms = clock.now_ms + 10_000
    asked = facts.session(number("session", "five"), "pad-1", "uav-1", begin_ms)
    put = replace(asked, precedence=Precedence(by="operator", name="Ada", reason="a patient", t_ms=begin_ms + 2_000))
    ended = {"state": "cancelled", "end": "turned_away", "ended_by": "operator", "ended_ms": begin_ms + 4_000}
    for name, function, record in (
        ("ProofRequested", "RequestProof", asked),
        ("PrecedenceGiven", "GivePrecedence", put),
        ("ProofCancelled", "CancelProof", replace(put, note="being cleaned", **ended)),
    ):
        event = (name, encoding.encode({"kind": name, "record": record.to_json()}))
        writes = {keys.composite(keys.SESSION, record.session_id): record.encode()}
        tx_id = record.session_id if function == "RequestProof" else ""
        argument = {"pad_id": "pad-1"} if function == "RequestProof" else {"session_id": record.session_id}
        chain.add(Tx(function, argument, writes, event, t_ms=clock.now_ms, tx_id=tx_id))
        await running.mirrored(chain.height)
        clock.now_ms += 2_000
    late = ("precedence", "note", "ended_by", "end")
    for after_ms, known in ((0, ()), (2_000, ("precedence",)), (4_000, late)):
        path = f"/replay/sessions/{asked.session_id}"
        shown = (await running.json(path, at_ms=begin_ms + after_ms))["session"]
        assert [name for name in late if name in shown] == [name for name in late if name in known], after_ms


@both
async def test_a_ledger_mirrored_anew_leaves_the_past_as_it_was_known(
    running, clock, chain, facts, database, source_of, texts, new_backend, serving
):
    from wonderland_backend.mirror.rebuild import rebuild

    _, state_text = texts
    clock.now_ms += 5_000
    chain.add(facts.request("four", t_ms=clock.now_ms))
    await running.mirrored(chain.height)
    moments = [START_MS - 1, START_MS, clock.now_ms - 1, clock.now_ms]
    before = [state_text(await running.json("/replay/state", at_ms=t_ms)) for t_ms in moments]
    assert len(set(before)) == 3
    clock.now_ms += 100_000_000
    await rebuild(database, source_of(chain), channel="wonderland", chaincode="pol", batch_transactions=10)
    await running.sign_in()
    after = [state_text(await running.json("/replay/state", at_ms=t_ms)) for t_ms in moments]
    assert after == before


async def test_what_was_mirrored_without_a_server_is_dated_by_the_ledger(
    new_backend, serving, chain, facts, database, source_of, clock
):
    from wonderland_backend.mirror.rebuild import rebuild

    chain.add(facts.put_pad(), facts.put_uav())
    chain.add(facts.request("one", t_ms=START_MS + 5_000))
    await rebuild(database, source_of(chain), channel="wonderland", chaincode="pol", batch_transactions=10)
    clock.now_ms += 60_000
    async with serving(new_backend(source_of(chain))) as client:
        assert (await client.json("/replay/state", at_ms=START_MS + 4_999))["sessions"] == []
        assert len((await client.json("/replay/state", at_ms=START_MS + 5_000))["sessions"]) == 1


@both
async def test_marks_and_refusals_lead_to_the_moment_at_which_they_were_known(running, clock, chain, facts, database):
    clock.now_ms += 10_000
    chain.add(facts.request("four", t_ms=clock.now_ms))
    await running.mirrored(chain.height)
    clock.now_ms += 3_000
    chain.add(facts.decide("four", t_ms=clock.now_ms - 3_000, outcome="refuted"))
    await running.mirrored(chain.height)
    found = await running.json("/replay/marks", from_ms=START_MS - 1_000, until_ms=clock.now_ms + 1, buckets=4)
    refusals = [each for each in found["marks"] if each["kind"] == "refusal"]
    assert [each["t_ms"] for each in refusals] == [START_MS, clock.now_ms]
    assert refusals[-1]["outcome"] == "refuted"
    assert {each["alert"] for each in found["marks"] if each["kind"] == "alert"} == {"refuted"}
    assert sum(found["density"]["refusals"]) == 2
    assert sum(found["density"]["sessions"]) == 3
    assert len(found["density"]["alerts"]) == 4
    assert found["stored_until_ms"] == clock.now_ms

    async def beside(at_ms, direction):
        return (await running.json("/replay/refusal", at_ms=at_ms, direction=direction)).get("found", {}).get("t_ms")

    assert await beside(START_MS, "next") == clock.now_ms
    assert await beside(clock.now_ms, "next") is None
    assert await beside(clock.now_ms, "previous") == START_MS
    assert await beside(START_MS, "previous") is None
    state = await running.json("/replay/state", at_ms=clock.now_ms)
    assert refusals[-1]["session_id"] in {each["session_id"] for each in state["verdicts"]}


async def test_a_pads_connection_to_a_server_that_died_is_not_believed_for_ever(running, clock, database, texts):
    row = "INSERT INTO pad_connections VALUES ('pad-1', 'dead', :from_ms, :until_ms, false)"
    async with database.write() as connection:
        await connection.execute(text(row), {"from_ms": START_MS + 1_000, "until_ms": START_MS + 60_000})
        health = "INSERT INTO pad_health (pad_id, t_ms, received_ms, body) VALUES ('pad-1', 1, :t, :body)"
        await connection.execute(text(health), {"t": START_MS, "body": '{"t_ms":1}'})

    async def connected(at_ms):
        (pad,) = [
            each for each in (await running.json("/replay/state", at_ms=at_ms))["pads"] if each["pad_id"] == "pad-1"
        ]
        return pad["health"]["connected"]

    assert [await connected(START_MS + each) for each in (999, 1_000, 60_000, 89_999, 90_000)] == [
        False, True, True, True, False,
    ]  # fmt: skip
    frames, _ = await film(running, from_ms=START_MS, until_ms=START_MS + 100_000, step_ms=1_000)
    told = [(each["t_ms"] - START_MS, each["pads"][0]["health"]["connected"]) for each in frames[2:] if "pads" in each]
    assert told == [(1_000, True), (90_000, False)]


@pytest.mark.parametrize(
    ("path", "query", "said"),
    [
        ("state", {}, "query.at_ms"),
        ("state", {"at_ms": -1}, "query.at_ms"),
        ("state", {"at_ms": 10**18}, "query.at_ms"),
        ("state", {"at_ms": 1, "t": 2}, "query.t"),
        ("frames", {"from_ms": 5, "until_ms": 5}, "query"),
        ("frames", {"from_ms": 0, "until_ms": 10**9, "step_ms": 50}, "query"),
        ("frames", {"from_ms": 0, "until_ms": 10, "step_ms": 0}, "query.step_ms"),
        ("marks", {"from_ms": 0, "until_ms": 10, "buckets": 100_000}, "query.buckets"),
        ("refusal", {"at_ms": 0, "direction": "sideways"}, "query.direction"),
        (f"sessions/{'0' * 63}g", {"at_ms": 0}, "path.session_id"),
    ],
)
async def test_what_cannot_be_meant_is_refused_by_name(running, path, query, said):
    answer = await running.get(f"/replay/{path}", params=query)
    assert answer.status_code == 422
    assert said in [each["path"] for each in answer.json()["errors"]]


async def test_a_time_before_everything_is_empty_and_nobody_sees_it_unsigned(running):
    state = await running.json("/replay/state", at_ms=0)
    assert {name: value for name, value in state.items() if name not in {"status", "t_ms"}} == {
        "block": -1, "pads": [], "tracks": [], "estimates": [], "sessions": [], "verdicts": [], "alerts": [],
    }  # fmt: skip
    running.http.cookies.clear()
    for path in ("state?at_ms=0", "frames?from_ms=0&until_ms=9", "marks?from_ms=0&until_ms=9"):
        assert (await running.get(f"/replay/{path}")).status_code == 401
