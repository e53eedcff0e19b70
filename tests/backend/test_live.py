"""The live interface: the state once, then what changes; resumable, and nothing unbounded."""

from __future__ import annotations

import asyncio
import json
import zlib

import pytest
import websockets

from wonderland_backend.live import hub as hub_module
from wonderland_backend.live.aside import Aside
from wonderland_backend.live.hub import Client, Hub

START_MS = 1_800_000_000_000
TRACK = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi"}


async def receive(socket):
    return json.loads(await asyncio.wait_for(socket.recv(), 5))


async def snapshot(socket):
    """(hello, merged parts)"""
    hello = await receive(socket)
    merged = {}
    if not hello["resumed"]:
        part = 0
        of = 1
        while part < of:
            frame = await receive(socket)
            assert frame["type"] == "snapshot"
            assert frame["part"] == part + 1
            part, of = frame["part"], frame["of"]
            for kind, items in frame.items():
                if isinstance(items, list):
                    merged.setdefault(kind, []).extend(items)
                elif kind == "status":
                    merged["status"] = items
    return hello, merged


async def deltas(socket, *kinds):
    """The next delta that has one of these kinds."""
    while True:
        frame = await receive(socket)
        assert frame["type"] == "delta"
        if any(kind in frame for kind in kinds):
            return frame


async def test_hello_and_the_whole_state(running, number):
    async with running.live() as socket:
        hello, state = await snapshot(socket)
        assert hello["epoch"] == running.context.epoch
        assert hello["resumed"] is False
        assert [pad["pad_id"] for pad in state["pads"]] == ["pad-1", "pad-2"]
        assert len(state["pads"][0]["anchors"]) == 4
        assert [each["session_id"] for each in state["sessions"]] == [
            number("session", name) for name in ("one", "two", "three")
        ]
        assert [each["outcome"] for each in state["verdicts"]] == ["verified", "refuted"]
        assert state["verdicts"][0]["block"] == 3
        assert state["status"]["ledger"]["mirrored"] == 7


async def test_long_frames_packed_for_who_asks(running):
    async with running.live() as plain, running.live(packed=True) as packed:
        assert (await receive(plain))["type"] == "hello"
        hello = await asyncio.wait_for(packed.recv(), 5)
        assert isinstance(hello, str), "short frames stay text"
        theirs = await asyncio.wait_for(packed.recv(), 5)
        assert isinstance(theirs, bytes)
        as_text = await asyncio.wait_for(plain.recv(), 5)
        assert len(theirs) < len(as_text) / 2
        there, here = json.loads(zlib.decompress(theirs)), json.loads(as_text)
        assert [pad["pad_id"] for pad in there["pads"]] == [pad["pad_id"] for pad in here["pads"]]


async def test_a_restart_shows_the_same_state(running, new_backend, serving, source_of, chain):
    async with running.live() as socket:
        _, before = await snapshot(socket)
    async with serving(new_backend(source_of(chain))) as again:
        await again.mirrored(chain.height)
        async with again.live() as socket:
            hello, after = await snapshot(socket)
            assert hello["epoch"] != running.context.epoch
        for kind in ("pads", "sessions", "verdicts"):
            assert after[kind] == before[kind]


async def test_a_proof_appears_as_it_happens(running, chain, facts, number):
    session_id = number("session", "four")
    async with running.live() as socket:
        hello, _ = await snapshot(socket)
        chain.add(facts.request("four", t_ms=START_MS + 30_000))
        first = await deltas(socket, "sessions")
        assert first["seq"] > hello["seq"]
        assert [(each["session_id"], each["state"]) for each in first["sessions"]] == [(session_id, "requested")]
        chain.add(facts.decide("four", t_ms=START_MS + 30_000))
        second = await deltas(socket, "verdicts")
        (verdict,) = second["verdicts"]
        assert (verdict["session_id"], verdict["permission"], verdict["block"]) == (session_id, "granted", 8)
        (session,) = second["sessions"]
        assert (session["state"], session["outcome"], session["verdict_tx"]) == (
            "decided",
            "verified",
            verdict["tx_id"],
        )
        chain.add(facts.complete("four", t_ms=START_MS + 30_000))
        (session,) = (await deltas(socket, "sessions"))["sessions"]
        assert session["state"] == "completed"
        assert session["outcome"] == "verified"
        assert session["verdict_tx"] == verdict["tx_id"] != session["complete_tx"]
        assert session == (await running.json(f"/sessions/{session_id}"))["summary"]


async def test_positions_are_coalesced_and_session_changes_are_not(running, agent_client, chain, facts):
    async with running.live() as socket, running.connect("/ingest") as other:
        await snapshot(socket)
        agent = agent_client(other)
        await agent.hello()
        running.parts.hub._tick_s = 0.3
        await asyncio.sleep(0.1)
        chain.add(facts.request("four"), facts.decide("five"), facts.complete("five"))
        await running.mirrored(chain.height)
        await agent.report(*(("track", TRACK | {"lat_e7": index}) for index in range(50)))
        tracks, sessions = [], []
        while len(sessions) < 3 or not tracks:
            frame = await deltas(socket, "tracks", "sessions")
            tracks += frame.get("tracks", [])
            sessions += [each["state"] for each in frame.get("sessions", [])]
        assert sessions == ["requested", "decided", "completed"]
        assert [track["lat_e7"] for track in tracks] == [49]
        assert tracks[0]["verified"] is False


async def test_steps_fill_in_also_when_they_come_before_the_block(running, agent_client, chain, facts, number):
    session_id = number("session", "early")
    body = {"session_id": session_id, "uav_id": "uav-1", "step": "poll", "t_ms": START_MS + 7, "ok": True}
    async with running.live() as socket, running.connect("/ingest") as other:
        await snapshot(socket)
        agent = agent_client(other)
        await agent.hello()
        await agent.report(("step", body))
        chain.add(facts.request("early"))
        frame = await deltas(socket, "sessions")
        assert [each["step"] for each in frame["sessions"][0]["steps"]] == ["request", "poll"]
        await agent.report(("step", body | {"step": "range", "ok": False, "detail": "anchors silent"}))
        frame = await deltas(socket, "sessions")
        assert frame["sessions"][0]["steps"][-1]["detail"] == "anchors silent"


async def test_health_and_connection_of_a_pad(running, agent_client):
    async with running.live() as socket:
        await snapshot(socket)
        async with running.connect("/ingest") as other:
            agent = agent_client(other)
            await agent.hello()
            await agent.report(("health", {"anchors": [{"anchor_id": "A0", "state": "up"}]}))
            while True:
                (pad,) = (await deltas(socket, "pads"))["pads"]
                if "health" in pad:
                    break
            assert pad["health"]["connected"] is True
            assert pad["health"]["verified"] is False
        (pad,) = (await deltas(socket, "pads"))["pads"]
        assert pad["health"]["connected"] is False


async def test_resuming_misses_nothing(running, chain, facts):
    async with running.live() as socket:
        hello, _ = await snapshot(socket)
        chain.add(facts.request("four"))
        frame = await deltas(socket, "sessions")
    chain.add(facts.decide("four"))
    await running.mirrored(chain.height)
    await asyncio.sleep(0.1)
    async with running.live(f"{hello['epoch']}:{frame['seq']}") as socket:
        again = await receive(socket)
        assert again["resumed"] is True
        following = await receive(socket)
        assert following["seq"] == frame["seq"] + 1
        while "verdicts" not in following:
            following = await receive(socket)
        assert len(following["verdicts"]) == 1
    for since in (f"{hello['epoch']}:{10**9}", f"{'0' * 16}:1", "rubbish", f"{hello['epoch']}:-1"):
        async with running.live(since) as socket:
            assert (await receive(socket))["resumed"] is False


async def test_strangers_are_closed_after_the_handshake(running):
    async with running.connect("/api/v1/live") as socket:
        with pytest.raises(websockets.ConnectionClosed) as closed:
            await asyncio.wait_for(socket.recv(), 5)
        assert closed.value.rcvd.code == 4401


async def test_foreign_origins_are_refused(running):
    with pytest.raises(websockets.InvalidStatus) as refused:
        async with running.live(origin="http://evil.example"):
            pass
    assert refused.value.response.status_code == 403
    async with running.live(origin=running.url) as socket:
        assert (await receive(socket))["type"] == "hello"


async def test_signing_out_closes_live_connections(running):
    async with running.live() as socket:
        await snapshot(socket)
        assert (await running.http.delete("/api/v1/session")).status_code == 204
        with pytest.raises(websockets.ConnectionClosed) as closed:
            while True:
                await receive(socket)
        assert closed.value.rcvd.code == 4401
    assert len(running.parts.hub) == 0


async def test_stopping_the_server_says_so(running):
    async with running.live() as socket:
        await snapshot(socket)
        running.parts.hub.close()
        with pytest.raises(websockets.ConnectionClosed) as closed:
            while True:
                await receive(socket)
        assert closed.value.rcvd.code == 1001


async def test_a_client_that_does_not_read_is_closed_and_the_others_go_on(
    new_backend, serving, source_of, chain, facts
):
    chain.add(facts.put_pad())
    backend = new_backend(source_of(chain), client_queue_bytes=200_000)
    async with serving(backend) as running:
        await running.mirrored(chain.height)
        async with running.live(max_queue=1) as slow, running.live() as quick:
            await snapshot(slow)
            await snapshot(quick)
            slow.transport.pause_reading()
            reading = asyncio.create_task(read_all(quick))
            board = running.parts.board
            for index in range(4_000):
                for uav in range(20):
                    board.hear(f"uav-{uav}", START_MS + index, json.dumps(TRACK | {"detail": "x" * 500}))
                running.parts.hub.tick()
                await asyncio.sleep(0)
                if running.parts.hub.closed_slow:
                    break
            assert running.parts.hub.closed_slow == 1
            assert len(running.parts.hub) == 1
            await asyncio.sleep(0.1)
            assert not reading.done(), "the quick client is still connected"
            slow.transport.resume_reading()
            with pytest.raises(websockets.ConnectionClosed) as closed:
                while True:
                    await receive(slow)
            assert closed.value.rcvd is None or closed.value.rcvd.code == 4408
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)


async def read_all(socket):
    while True:
        await socket.recv()


async def test_large_snapshots_come_in_parts(running, number):
    board = running.parts.board
    for uav in range(2_000):
        board.hear(f"uav-{uav:04}", START_MS, json.dumps(TRACK | {"uav_id": f"uav-{uav:04}", "pad": "x" * 150}))
    async with running.live() as socket:
        hello = await receive(socket)
        frame = await receive(socket)
        assert frame["of"] > 3
        sizes = []
        for _ in range(frame["of"] - 1):
            text = await socket.recv()
            sizes.append(len(text))
        assert max(sizes) < 140_000
        assert hello["seq"] <= running.parts.hub.seq


class FakeBoard:
    """A board with whatever a test puts there."""

    def __init__(self):
        self.changes = []
        self.viewers = None
        self.taken = 0
        self.has_more_alerts = False

    def take_changes(self, *, with_status):
        self.taken += 1
        return {"tracks": self.changes.pop(0)} if self.changes else {}

    def take_aside(self):
        return Aside()

    def snapshot(self):
        return {"pads": ["p"], "tracks": []}

    def status(self):
        return {}


@pytest.fixture
def hub(clock):
    return new_hub(clock)


def new_hub(clock, **options):
    options = {"tick_ms": 20, "ring_bytes": 10_000, "client_queue_bytes": 1_000, "max_viewers": 3} | options
    return Hub(FakeBoard(), epoch="e" * 16, clock=clock, **options)


def test_nothing_changed_nothing_sent(hub):
    client = hub.join("p", None)
    hub.tick()
    assert (hub.seq, len(client.frames)) == (0, 0)


def test_a_silence_is_broken_by_a_heartbeat_of_few_bytes(hub, clock):
    client = hub.join("p", None)
    for _ in range(4):
        clock.now_ms += hub_module.HEARTBEAT_MS // 2
        hub.tick()
    beats = [json.loads(frame) for frame in client.frames]
    assert beats == [
        {"type": "delta", "seq": 1, "t_ms": clock.now_ms - hub_module.HEARTBEAT_MS},
        {"type": "delta", "seq": 2, "t_ms": clock.now_ms},
    ]
    # With 200 consoles 5 kB/s, and only while nothing else is sent.
    assert all(len(frame) < 64 for frame in client.frames)
    # A clock that is set back silences nobody.
    clock.now_ms -= 3_600_000
    hub.tick()
    assert len(client.frames) == 3


def test_a_frame_is_packed_once_for_all_who_see_the_same(monkeypatch, clock):
    packings = []
    compress = zlib.compress
    monkeypatch.setattr(hub_module.zlib, "compress", lambda *args: packings.append(args) or compress(*args))
    hub = new_hub(clock, client_queue_bytes=10_000)
    packed = [hub.join("p", None, takes_packed=True) for _ in range(2)]
    plain = hub.join("q", None)
    hub.board.changes = [["long " * 1_000], ["short"]]
    hub.tick()
    assert len(packings) == 1
    assert packed[0].frames[0] is packed[1].frames[0]
    assert zlib.decompress(packed[0].frames[0]).decode() == plain.frames[0]
    assert packed[0].waiting_bytes < 200
    hub.tick()
    assert packed[0].frames[1] == plain.frames[1]
    assert len(packings) == 1


def test_one_encoding_for_all(hub):
    clients = [hub.join("p", None) for _ in range(3)]
    hub.board.changes = [[1, 2]]
    hub.tick()
    frames = {id(client.frames[0]) for client in clients}
    assert len(frames) == 1


def test_what_is_pending_goes_out_before_a_snapshot(hub):
    first = hub.join("p", None)
    hub.board.changes = [[1]]
    frames = hub.join("p", None).first
    assert json.loads(next(frames))["seq"] == 1
    assert len(first.frames) == 1


def test_the_ring_is_bounded(clock):
    hub = new_hub(clock, ring_bytes=600)
    hub.board.changes = [["x" * 100] for _ in range(50)]
    for _ in range(50):
        hub.tick()
    assert hub._ring_bytes <= 600
    assert sum(len(frame.text) for frame in hub._ring) == hub._ring_bytes
    frames = hub.join("p", ("e" * 16, 49)).first
    assert json.loads(next(frames))["resumed"] is True
    assert json.loads(next(frames))["seq"] == 50
    frames = hub.join("p", ("e" * 16, 1)).first
    assert json.loads(next(frames))["resumed"] is False


async def test_a_full_queue_closes_and_forgets(hub):
    client = hub.join("p", None)
    hub.board.changes = [["x" * 400] for _ in range(5)]
    for _ in range(5):
        hub.tick()
    assert client.close_code == 4408
    assert client.closing.is_set()
    assert (len(client.frames), client.waiting_bytes) == (0, 0)
    assert await client.next_frame() is None
    assert len(hub) == 0


async def test_a_server_that_cannot_keep_up_sends_less_often(clock, monkeypatch):
    monkeypatch.setattr(hub_module, "LONGEST_PAUSE_S", 1_000)
    hub = new_hub(clock, client_queue_bytes=10_000)
    clients = [hub.join("p", None) for _ in range(3)]
    for client in clients:
        client.begin(iter(()))  # they have taken the beginning
    hub.board.changes = [[number] for number in range(200)]

    async def beyond(seq):
        async with asyncio.timeout(20):
            while hub.seq <= seq:
                await asyncio.sleep(0.01)

    running = asyncio.create_task(hub.run())
    try:
        await beyond(0)
        await asyncio.sleep(0.3)
        # None of them took anything: one frame is enough.
        assert hub.seq == 1
        for _ in range(5):
            # One that stops reading holds up nobody.
            seq = hub.seq
            for client in clients[:2]:
                await client.next_frame()
            await beyond(seq)
        assert len(clients[2].frames) == hub.seq == 6
        # And in the end what waits goes out all the same.
        monkeypatch.setattr(hub_module, "LONGEST_PAUSE_S", 0)
        await beyond(8)
    finally:
        running.cancel()


def test_too_many_viewers(hub):
    for _ in range(3):
        hub.join("p", None)
    client = hub.join("p", None)
    assert client.close_code == 4429
    assert list(client.first) == []
    assert len(hub) == 3


async def test_frames_come_in_order_to_one_who_waits():
    client = Client("p", 100)
    waiting = asyncio.create_task(client.next_frame())
    await asyncio.sleep(0)
    client.offer("a")
    client.offer("b")
    assert [await waiting, await client.next_frame()] == ["a", "b"]
    assert client.waiting_bytes == 0
