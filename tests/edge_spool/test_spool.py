"""The spool as the agent uses it: group commit, durability when it says so, one process, closing."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from kit.outages import Killed as Outage

from wonderland_edge_agent.spool import (
    RecordRefusedError,
    Spool,
    SpoolClosedError,
    SpoolError,
    SpoolFull,
    SpoolLockedError,
    SpoolStore,
)

T0 = 1_760_000_400_000


async def open_spool(directory: Path, **options: Any) -> Spool:
    return await Spool.open(directory, **{"owner": "pad-1", "reserve_bytes": 0, **options})


async def test_evidence_is_durable_when_append_returns(tmp_path: Path) -> None:
    directory = tmp_path / "pad" / "spool"
    async with await open_spool(directory) as spool:
        seq = await spool.append("step", T0, {"step": "poll", "ok": True}, evidence=True)
        assert seq == 1
        # Another connection sees it: it is in the file, not in this process.
        import sqlite3

        other = sqlite3.connect(directory / "spool.db")
        rows = other.execute("SELECT seq, kind, t_ms, body FROM records").fetchall()
        other.close()
        assert rows == [(1, "step", T0, b'{"ok":true,"step":"poll"}')]
        assert spool.status.last_seq == 1
        assert len(spool.id) == 32


async def test_telemetry_shares_flushes_and_keeps_its_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    batches: list[int] = []
    write = SpoolStore.write

    def counted(self: SpoolStore, entries: Any, lost: int = 0) -> Any:
        batches.append(len(entries))
        return write(self, entries, lost)

    monkeypatch.setattr(SpoolStore, "write", counted)
    async with await open_spool(tmp_path, linger_s=0.05) as spool:
        for index in range(100):
            spool.offer("track", T0 + index, {"n": index})
        spool.offer("estimate", T0, {"n": 100})
        seq = await spool.append("step", T0, {"n": 101}, evidence=True)
        assert seq == 102  # evidence is not flushed before what was there first
        assert batches == [102]
        records = await spool.pending(0, max_records=1000)
        assert [record.seq for record in records] == list(range(1, 103))
        assert [record.t_ms for record in records[:100]] == [T0 + index for index in range(100)]


async def test_offered_telemetry_is_flushed_without_company(tmp_path: Path) -> None:
    async with await open_spool(tmp_path, linger_s=0.01) as spool:
        spool.offer("track", T0, {"n": 1})
        async with asyncio.timeout(5):
            await spool.wait_beyond(0)
        assert [record.kind for record in await spool.pending()] == ["track"]
        assert await spool.append("track", T0, {"n": 2}, evidence=False) == 2


async def test_closing_stores_what_is_queued(tmp_path: Path) -> None:
    spool = await open_spool(tmp_path, linger_s=10)
    for index in range(2_000):
        spool.offer("track", T0, {"n": index})
    await spool.close()
    await spool.close()
    with pytest.raises(SpoolClosedError):
        spool.offer("track", T0, {})
    with pytest.raises(SpoolClosedError):
        await spool.append("step", T0, {}, evidence=True)
    with pytest.raises(SpoolClosedError):
        await spool.pending()
    async with await open_spool(tmp_path) as spool:
        assert spool.status.records == 2_000


async def test_waiting_ends_with_the_spool(tmp_path: Path) -> None:
    spool = await open_spool(tmp_path)
    waiter = asyncio.create_task(spool.wait_beyond(0))
    await asyncio.sleep(0.01)
    await spool.close()
    async with asyncio.timeout(5):
        await waiter


async def test_a_queue_that_overflows_drops_telemetry_and_says_so(tmp_path: Path) -> None:
    async with await open_spool(tmp_path, linger_s=0.01) as spool:
        for index in range(5_000):  # without a turn of the loop, so that nothing can be flushed
            spool.offer("track", T0, {"n": index})
        seq = await spool.append("step", T0, {}, evidence=True)
        assert seq == 5_001
        assert spool.status.dropped == 5_000 - 4_096
        (marker,) = [
            record for record in await spool.pending(0, max_records=10_000, max_bytes=10**8) if record.kind == "dropped"
        ]
        assert marker.body == b'{"from_seq":1,"to_seq":904}'


async def test_a_second_agent_is_refused(tmp_path: Path) -> None:
    async with await open_spool(tmp_path):
        with pytest.raises(SpoolLockedError, match=f"another agent \\(process {os.getpid()}\\)"):
            await open_spool(tmp_path)
        script = (
            "import asyncio, pathlib, sys\n"
            "from wonderland_edge_agent.spool import Spool, SpoolLockedError\n"
            "try:\n    asyncio.run(Spool.open(pathlib.Path(sys.argv[1]), owner='pad-1'))\n"
            "except SpoolLockedError as error:\n    print('locked:', error)\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=60, check=True
        )
        assert done.stdout.startswith("locked:")
    async with await open_spool(tmp_path) as spool:
        assert spool.accepts_sessions


@pytest.mark.parametrize(
    ("kind", "t_ms", "body"),
    [
        ("", T0, {}),
        ("Track", T0, {}),
        ("a" * 33, T0, {}),
        ('x"', T0, {}),
        ("track", -1, {}),
        ("track", 10**16, {}),
        ("track", T0, {"x": 1.5}),
        ("track", T0, {"x": None}),
        ("track", T0, {"x": "y" * 200_000}),
    ],
)
async def test_what_could_never_be_sent_is_refused_at_once(
    tmp_path: Path, kind: str, t_ms: int, body: dict[str, Any]
) -> None:
    async with await open_spool(tmp_path) as spool:
        with pytest.raises(RecordRefusedError):
            spool.offer(kind, t_ms, body)
        with pytest.raises(RecordRefusedError):
            await spool.append(kind, t_ms, body, evidence=True)
        assert spool.status.last_seq == 0


async def test_full_of_evidence_refuses_sessions_and_recovers(tmp_path: Path) -> None:
    async with await open_spool(tmp_path, quota_bytes=256 * 1024) as spool:
        body = {"x": "y" * 10_000}
        seq = 0
        with pytest.raises(SpoolFull):
            for _ in range(1_000):
                seq = await spool.append("step", T0, body, evidence=True)
                spool.offer("track", T0, body)
        assert spool.status.reason
        await spool.acknowledge(seq)
        assert spool.accepts_sessions
        assert await spool.append("step", T0, body, evidence=True) > seq


async def test_secrets_sessions_and_notes(tmp_path: Path) -> None:
    async with await open_spool(tmp_path) as spool:
        await spool.put_secret("prekey/1", b"\x01" * 32)
        await spool.put_secrets({"prekey/2": b"\x02" * 32})
        assert await spool.secret_names() == ["prekey/1", "prekey/2"]
        assert await spool.take_secret("prekey/1") == b"\x01" * 32
        assert await spool.take_secret("prekey/1") is None
        await spool.put_session("s1", {"step": "poll", "t_ms": T0})
        with pytest.raises(RecordRefusedError):
            await spool.put_session("s2", {"x": None})
        await spool.put_note("checkpoint", b"\x00\x01")
    async with await open_spool(tmp_path) as spool:
        assert await spool.sessions() == {"s1": {"step": "poll", "t_ms": T0}}
        assert await spool.note("checkpoint") == b"\x00\x01"
        assert await spool.note("other") is None
        await spool.append("session_end", T0, {"session_id": "s1"}, evidence=True, ends_session="s1")
        assert await spool.sessions() == {}
        await spool.remove_session("s1")


async def test_a_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(SpoolError, match="cannot be made"):
        await open_spool(tmp_path / "file" / "spool")


async def test_a_caller_that_gives_up_loses_nothing(tmp_path: Path) -> None:
    async with await open_spool(tmp_path) as spool:
        task = asyncio.create_task(spool.append("step", T0, {"n": 1}, evidence=True))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert await spool.append("step", T0, {"n": 2}, evidence=True) == 2


WRITER = """
import asyncio, os, pathlib, sys
from wonderland_edge_agent.spool import Spool

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())  # in one piece, whatever kills this process

async def main():
    spool = await Spool.open(pathlib.Path(sys.argv[1]), owner="pad-1", reserve_bytes=65536, linger_s=0.002)
    await spool.put_secrets({f"prekey/{spool.status.last_seq}/{n}": b"k" * 32 for n in range(2_000)})
    for key in await spool.secret_names():
        n = spool.status.last_seq
        session = f"session-{n}"
        await spool.put_session(session, {"n": n})
        say("began", session)
        for _ in range(5):
            spool.offer("track", n, {"n": n})
        if await spool.take_secret(key):
            say("took", key)
        seq = await spool.append("step", n, {"n": n}, evidence=True)
        say("stored", seq)
        await spool.append("session_end", n, {"session": session}, evidence=True, ends_session=session)
        say("ended", session)
        if seq % 3 == 0:
            await spool.acknowledge(seq)

asyncio.run(main())
"""


@pytest.mark.parametrize("delay_s", [0.02, 0.05, 0.11])
async def test_an_outage_in_the_middle_loses_nothing_it_promised(outage: Outage, delay_s: float) -> None:
    stored: set[int] = set()
    began: set[str] = set()
    ended: set[str] = set()
    taken: set[str] = set()
    for awaited in (b"began", b"stored", b"stored"):
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", WRITER, str(outage.directory), stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        first = await process.stdout.readline()
        while awaited not in first:  # however busy the machine is
            first += await process.stdout.readline()
        await asyncio.sleep(delay_s)
        outage.strike(process.pid)
        output = first + await process.stdout.read()
        await process.wait()
        outage.back()
        for line in output.decode().splitlines():
            word, value = line.split()
            if word == "stored":
                stored.add(int(value))
            else:
                {"began": began, "ended": ended, "took": taken}[word].add(value)
        async with await open_spool(outage.directory) as spool:
            status = spool.status
            records = await spool.pending(0, max_records=10**6, max_bytes=10**9)
            # Every number after the acknowledged ones is there, and so is all that was said to be stored.
            assert [record.seq for record in records] == list(range(status.acknowledged + 1, status.last_seq + 1))
            assert {seq for seq in stored if seq > status.acknowledged} <= {
                record.seq for record in records if record.kind == "step"
            }
            # A secret that was taken is gone,
            assert not taken & set(await spool.secret_names())
            # and a session is either in progress or its end is on the record, never both, never neither.
            open_sessions = set(await spool.sessions())
            recorded = {record.body.decode().split('"')[3] for record in records if record.kind == "session_end"}
            assert not open_sessions & (recorded | ended)
            unacknowledged = {name for name in began if int(name.removeprefix("session-")) >= status.acknowledged}
            assert unacknowledged <= open_sessions | recorded
            for name in open_sessions:
                await spool.append("session_end", T0, {"session": name}, evidence=True, ends_session=name)
                ended.add(name)
    assert stored
