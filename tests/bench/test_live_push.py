"""What it costs to show positions to many consoles, beside a raw broadcast of the same bytes; how late they are."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import re
import sys
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import psutil
import pytest
from bench.bench_tools import p50, p95, show
from kit import environment

pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]

HERE = Path(__file__).parent
RATE = 2_500
SECONDS = 10
WARM_S = 4
# As consoles take it, as text, and the same bytes as that text without anything around them.
PATHS = {"packed": "/api/v1/live", "hub": "/api/v1/live", "raw": "/raw"}
PACKED = {"packed": "?packed=zlib"}
CLOSE, PING, PONG = 8, 9, 10
T_MS = re.compile(rb'"t_ms":(\d{13}),"pad_id"')


class Viewer:
    """A console as a socket: reads everything, looks into every so many-th position."""

    def __init__(self, looks):
        self._looks = looks
        self.bytes = 0
        self.ages_ms = []

    async def run(self, port, path, cookie):
        """Until cancelled."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 22)
        key = base64.b64encode(os.urandom(16)).decode()
        writer.write(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\nOrigin: http://127.0.0.1:{port}\r\n"
            f"Cookie: {cookie}\r\n\r\n".encode()
        )
        head = await reader.readuntil(b"\r\n\r\n")
        assert b"101" in head.split(b"\r\n")[0], head
        try:
            while True:
                opcode, content = await self._frame(reader)
                self.bytes += len(content)
                if opcode == PING:
                    # A console that does not answer is closed. The mask may be zero: nobody is between the two.
                    writer.write(bytes((0x80 | PONG, 0x80 | len(content))) + bytes(4) + content)
                assert opcode != CLOSE, f"the server closed a console: {content!r}"
                if self._looks:
                    now_ms = time.time_ns() / 1e6
                    self.ages_ms.extend(now_ms - int(found) for found in T_MS.findall(content)[::20])
        finally:
            writer.close()

    @staticmethod
    async def _frame(reader):
        """(opcode, payload) of RFC 6455; the server sends each message as one frame."""
        first, length = await reader.readexactly(2)
        if length >= 126:
            length = int.from_bytes(await reader.readexactly(2 if length == 126 else 8), "big")
        return first & 0x0F, await reader.readexactly(length)


async def cookie_of(link):
    """Signs in with a link."""
    parts = urlsplit(link)
    origin = f"{parts.scheme}://{parts.netloc}"
    async with httpx.AsyncClient(base_url=origin, headers={"Origin": origin}) as client:
        answer = await client.post("/api/v1/session", json={"token": parse_qs(parts.fragment)["token"][0]})
        assert answer.is_success, answer.text
        return "; ".join(f"{name}={value}" for name, value in answer.cookies.items())


async def measured(mode, consoles, directory):
    """(server's CPU µs a delivery, deliveries, bytes of one, ages of positions in ms)"""
    directory.mkdir()
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "bench.live_server",
        "raw" if mode == "raw" else "hub",
        str(RATE),
        str(directory),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env=environment(),
    )
    try:
        ready = json.loads(await child.stdout.readline())
        cookie = await cookie_of(ready["link"])
        viewers = [Viewer(looks=number == 0) for number in range(consoles)]
        # The one that looks into its bytes takes text.
        paths = [PATHS[mode], *[PATHS[mode] + PACKED.get(mode, "")] * (consoles - 1)]
        tasks = [
            asyncio.create_task(viewer.run(ready["port"], path, cookie))
            for viewer, path in zip(viewers, paths, strict=True)
        ]

        async def counts():
            child.stdin.write(b"\n")
            return json.loads(await child.stdout.readline())

        await asyncio.sleep(WARM_S)
        process = psutil.Process(child.pid)
        before, cpu = await counts(), sum(process.cpu_times()[:2])
        viewers[0].ages_ms.clear()
        await asyncio.sleep(SECONDS)
        after, spent = await counts(), sum(process.cpu_times()[:2]) - cpu
        ages = list(viewers[0].ages_ms)
        assert not any(task.done() for task in tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    finally:
        child.stdin.close()
        try:
            await asyncio.wait_for(child.wait(), 20)
        except TimeoutError:
            child.kill()
            await child.wait()
    deliveries = after["frames"] - before["frames"]
    return 1e6 * spent / deliveries, deliveries, (after["bytes"] - before["bytes"]) / deliveries, ages


async def test_push(tmp_path, pytestconfig, keep):
    """CPU a delivery beside the raw broadcast, and how old a position is when a console has it."""
    consoles = pytestconfig.getoption("--consoles")
    runs = {"raw": [], "hub": [], "packed": []}
    for turn in range(2):
        for mode, results in runs.items():
            results.append(await measured(mode, consoles, tmp_path / f"{mode}{turn}"))
    best = {mode: min(results) for mode, results in runs.items()}
    for _, deliveries, _, _ in best.values():
        assert deliveries > consoles
    ratio, packed_ratio = (best[mode][0] / best["raw"][0] for mode in ("hub", "packed"))
    rows = [
        (
            name,
            f"{best[mode][0]:.0f}",
            f"{best[mode][2] / 1000:.0f}",
            f"{p50(best[mode][3]):.0f}",
            f"{p95(best[mode][3]):.0f}",
        )
        for mode, name in (
            ("raw", "raw broadcast"),
            ("hub", "the live push, text"),
            ("packed", "the live push, packed"),
        )
    ]
    show(
        f"{RATE:,} positions/s to {consoles} consoles",
        ("what", "CPU µs a delivery", "kB a frame", "age p50 ms", "p95 ms"),
        [*rows, ("text to raw", f"{ratio:.2f}", "", "", ""), ("packed to raw", f"{packed_ratio:.2f}", "", "", "")],
    )
    keep(
        cpu_us=best["hub"][0],
        raw_cpu_us=best["raw"][0],
        packed_cpu_us=best["packed"][0],
        ratio=ratio,
        packed_ratio=packed_ratio,
        age_p95_ms=p95(best["packed"][3]),
        consoles=consoles,
    )
