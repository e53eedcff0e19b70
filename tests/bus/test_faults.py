"""What is in a pad's spool reaches the backend once and in order, whatever is killed, hangs or is cut meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import random
import signal
import time

import pytest
from kit.bus import HOST

from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Uplink, UplinkTimings

FAST = UplinkTimings(backoff_s=0.05, backoff_max_s=0.3, greeting_timeout_s=3, stall_timeout_s=3)
TRACK = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "height_mm": 42_000, "transport": "wifi"}


class Cable:
    """Between a pad and the router: it can be cut so that nobody is told, and mended."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._whole = asyncio.Event()
        self._whole.set()
        self._ends: list[asyncio.StreamWriter] = []
        self._pumps: set[asyncio.Task[None]] = set()

    @contextlib.asynccontextmanager
    async def laid(self):
        async with await asyncio.start_server(self._carry, "127.0.0.1", 0) as server:
            yield server.sockets[0].getsockname()[1]
            server.close()
            for each in self._pumps:
                each.cancel()
            for end in self._ends:
                end.close()
            await asyncio.gather(*self._pumps, return_exceptions=True)

    def cut(self) -> None:
        self._whole.clear()

    def mend(self, *, with_what_was_on_it: bool) -> None:
        if not with_what_was_on_it:
            for end in self._ends:
                end.transport.abort()
        self._whole.set()

    async def _carry(self, reader, writer) -> None:
        with contextlib.suppress(OSError):
            await self._whole.wait()
            there, back = await asyncio.open_connection(HOST, self._port)
            self._ends += [writer, back]
            for source, sink in ((reader, back), (there, writer)):
                self._pumps.add(asyncio.create_task(self._pump(source, sink)))

    async def _pump(self, source, sink) -> None:
        with contextlib.suppress(OSError):
            while data := await source.read(65_536):
                await self._whole.wait()
                sink.write(data)
                await sink.drain()
        sink.close()


async def until(condition, timeout_s=30.0):
    async with asyncio.timeout(timeout_s):
        while not condition():
            await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def reporting(bus, tmp_path, port):
    """A pad that reports some thousand positions a second; after it all of them are compared with what is stored."""
    async with await Spool.open(tmp_path / "spool", owner="pad-1", reserve_bytes=0, linger_s=0.002) as spool:
        uplink = Uplink(bus.way(port=port), bus.credentials(), spool, timings=FAST, randomness=random.Random(1))
        start_ms, sent = time.time_ns() // 1_000_000 - 3_600_000, 0

        async def report() -> None:
            nonlocal sent
            while True:
                for _ in range(10):
                    sent += 1
                    spool.offer("track", start_ms + sent, TRACK)
                await asyncio.sleep(0.01)

        await uplink.start()
        await until(lambda: uplink.status.connected)
        working = asyncio.create_task(report())
        await until(lambda: uplink.status.acknowledged_seq > 100)
        yield uplink, spool
        await asyncio.sleep(0.3)
        working.cancel()
        await until(lambda: spool.status.last_seq == sent and spool.status.records == 0)
        await uplink.close()
        assert spool.status.dropped == 0
        assert uplink.status.rejected_records == 0
    assert await bus.tracks() == [start_ms + number for number in range(1, sent + 1)]


async def broken(uplink, before):
    """Until the uplink has found out, or (where nothing was lost) until it went on."""
    await until(lambda: uplink.status.connections > before or not uplink.status.connected)


@pytest.mark.parametrize("who", ["router", "backend"])
async def test_killed_and_started_again_in_the_middle_of_a_stream(bus, tmp_path, who):
    async with reporting(bus, tmp_path, bus.port) as (uplink, _):
        for _ in range(2):
            before = uplink.status.connections
            process = getattr(bus, who)
            await process.kill()
            await until(lambda: not uplink.status.connected)
            assert uplink.status.error
            await process.start()
            await until(lambda: uplink.status.connections > before)  # noqa: B023


@pytest.mark.parametrize("who", ["router", "backend"])
async def test_hung_and_awake_again(bus, tmp_path, who):
    async with reporting(bus, tmp_path, bus.port) as (uplink, _):
        before = uplink.status.connections
        getattr(bus, who).signal(signal.SIGSTOP)
        await until(lambda: not uplink.status.connected)
        await asyncio.sleep(2)
        getattr(bus, who).signal(signal.SIGCONT)
        await until(lambda: uplink.status.connections > before)


async def test_hung_for_a_moment_that_nobody_notices(bus, tmp_path):
    async with reporting(bus, tmp_path, bus.port) as (uplink, _):
        for who in (bus.router, bus.backend) * 3:
            who.signal(signal.SIGSTOP)
            await asyncio.sleep(0.3)
            who.signal(signal.SIGCONT)
            await asyncio.sleep(0.3)
        assert uplink.status.acknowledged_seq > 100


@pytest.mark.parametrize("with_what_was_on_it", [True, False])
async def test_a_partition(bus, tmp_path, with_what_was_on_it):
    cable = Cable(bus.port)
    async with cable.laid() as port, reporting(bus, tmp_path, port) as (uplink, _):
        before = uplink.status.connections
        cable.cut()
        await until(lambda: not uplink.status.connected)
        await asyncio.sleep(1)
        cable.mend(with_what_was_on_it=with_what_was_on_it)
        await until(lambda: uplink.status.connections > before)


async def test_everything_at_once(bus, tmp_path):
    chance = random.Random(19)
    async with reporting(bus, tmp_path, bus.port) as (uplink, _):
        for _ in range(6):
            one = chance.choice([bus.router, bus.backend])
            other = bus.backend if one is bus.router else bus.router
            other.signal(signal.SIGSTOP)
            await one.kill()
            await asyncio.sleep(chance.random())
            other.signal(signal.SIGCONT)
            before = uplink.status.connections
            await one.start()
            await until(lambda: uplink.status.connections > before)  # noqa: B023
