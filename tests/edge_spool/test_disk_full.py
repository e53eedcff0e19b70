"""A disk without room: evidence of the running session still finds the reserve, and the spool recovers by itself."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from wonderland_edge_agent.spool import Spool, SpoolFull

T0 = 1_760_000_400_000
RESERVE = 512 * 1024


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 4 MiB; where none can be mounted the test is skipped."""
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() != 0:
        pytest.skip("a small file system can only be mounted by root")
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def fill(place: Path) -> Path:
    """Somebody else takes all space that is left."""
    path = place / "somebody-elses"
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(b"x" * 65_536)
        except OSError:
            pass
    return path


async def until(condition: object, timeout_s: float = 10.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # type: ignore[operator]
            await asyncio.sleep(0.02)


async def test_a_full_disk(small_disk: Path) -> None:
    body = {"x": "y" * 2_000}
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=RESERVE, linger_s=0.005) as spool:
        await spool.put_session("s1", {"step": "range"})
        first = await spool.append("step", T0, body, evidence=True)
        for _ in range(100):
            spool.offer("track", T0, body)
        await until(lambda: spool.status.last_seq == 101)
        other = fill(small_disk)

        # Telemetry notices first. It does not touch the reserve, and the pad stops taking sessions.
        while spool.accepts_sessions:
            spool.offer("track", T0, body)
            await asyncio.sleep(0.002)
        assert (small_disk / "spool" / "spool.reserve").stat().st_size == RESERVE
        assert "disk is full" in spool.status.reason

        # The running session's evidence goes into the reserve, until that is used up, too.
        stored = [first, await spool.append("step", T0, body, evidence=True)]
        with pytest.raises(SpoolFull, match="disk is full"):
            while True:
                stored.append(await spool.append("step", T0, body, evidence=True))
        assert len(stored) > 50
        assert not spool.accepts_sessions
        records = await spool.pending(0, max_records=10**6, max_bytes=10**9)
        assert [record.seq for record in records if record.kind == "step"] == stored

        # Space returns: the spool finds out by itself, and goes on.
        other.unlink()
        await until(lambda: spool.accepts_sessions)
        stored.append(await spool.append("session_end", T0, {}, evidence=True, ends_session="s1"))
        assert (small_disk / "spool" / "spool.reserve").stat().st_size == RESERVE
        records = await spool.pending(0, max_records=10**6, max_bytes=10**9)
        assert [record.seq for record in records if record.kind in {"step", "session_end"}] == stored
        accounted: list[int] = []
        for record in records:
            start = record.seq
            if record.kind == "dropped":
                start = int(record.body.split(b":")[1].split(b",")[0])
            accounted.extend(range(start, record.seq + 1))
        assert accounted == list(range(1, spool.status.last_seq + 1))
        assert spool.status.dropped > 0
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=RESERVE) as spool:
        assert await spool.sessions() == {}
        assert spool.accepts_sessions


async def test_a_start_on_a_full_disk(small_disk: Path) -> None:
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=RESERVE) as spool:
        await spool.append("step", T0, {"n": 1}, evidence=True)
        await spool.put_session("s1", {"step": "range"})
    other = fill(small_disk)
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=RESERVE) as spool:
        assert not spool.accepts_sessions
        assert [record.seq for record in await spool.pending()] == [1]
        # What was interrupted can be ended on the record,
        assert await spool.sessions() == {"s1": {"step": "range"}}
        await spool.append("session_end", T0, {}, evidence=True, ends_session="s1")
        # and the server's acknowledgement is taken.
        await spool.acknowledge(2)
        other.unlink()
        await until(lambda: spool.accepts_sessions)


async def test_a_limit_of_file_size_is_a_full_disk_too(tmp_path: Path) -> None:
    """What a disk quota looks like to a process: writing fails with an error that is not ENOSPC."""
    body = {"x": "y" * 20_000}
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        async with await Spool.open(tmp_path, owner="pad-1", reserve_bytes=0) as spool:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, before[1]))
            stored = []
            with pytest.raises(SpoolFull):
                while True:
                    stored.append(await spool.append("step", T0, body, evidence=True))
            assert not spool.accepts_sessions
            assert [record.seq for record in await spool.pending(0, max_records=10**6, max_bytes=10**9)] == stored
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
            await until(lambda: spool.accepts_sessions)
            assert await spool.append("step", T0, body, evidence=True) == stored[-1] + 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


async def test_a_start_without_any_space_says_so_and_works_later(small_disk: Path) -> None:
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=0) as spool:
        await spool.append("step", T0, {"n": 1}, evidence=True)
    other = fill(small_disk)
    with pytest.raises(SpoolFull, match="disk is full"):
        await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=0)
    other.unlink()
    async with await Spool.open(small_disk / "spool", owner="pad-1", reserve_bytes=0) as spool:
        assert [record.seq for record in await spool.pending()] == [1]
