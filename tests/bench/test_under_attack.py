"""What each attack on the server's edge costs everybody else: p95 of /health beside the server's at rest, and memory."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
import statistics
import time
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import trustme
from bench.bench_tools import show
from kit import PLAIN
from kit.backend_process import ledger, ready, start, stop

__all__ = ["ledger"]
pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]
LOOKS = 150
FLOOR_MS = 2.0
"""Below this a ratio says nothing: two cores serve the attacker as well."""
HALF = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n"


def resident_mb(pid):
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


async def p95_ms(http):
    """From a connection of its own, as a monitor's."""
    took = []
    for _ in range(LOOKS):
        began = time.perf_counter()
        assert (await http.get("/api/v1/health")).status_code == 200
        took.append((time.perf_counter() - began) * 1000)
        await asyncio.sleep(0.01)
    return statistics.quantiles(took, n=20)[18]


class Attacker:
    """Sockets to one port, as many as wanted, closed at the end."""

    def __init__(self, host, port):
        self.host, self.port = host, port
        self.open = []

    async def connect(self):
        connection = await asyncio.open_connection(self.host, self.port)
        self.open.append(connection[1])
        return connection

    def close(self):
        for writer in self.open:
            writer.close()

    async def header_without_end(self):
        """One header of 60 MiB, again and again."""
        while True:
            with contextlib.suppress(OSError):
                _, writer = await self.connect()
                writer.write(HALF + b"X: ")
                for _ in range(60 * 16):
                    writer.write(b"a" * 65_536)
                    await writer.drain()
            await asyncio.sleep(0.05)

    async def half_requests(self):
        """As many half-open requests as one address may have, and more."""
        while True:
            with contextlib.suppress(OSError):
                _, writer = await self.connect()
                writer.write(HALF)
            await asyncio.sleep(0.02)

    async def silent_agents(self):
        """Sockets to /ingest that never say who they are."""
        while True:
            with contextlib.suppress(OSError):
                _, writer = await self.connect()
                writer.write(
                    b"GET /ingest HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
                )
            await asyncio.sleep(0.02)

    async def half_handshakes(self):
        """TLS that is never begun, at the agents' listener."""
        while True:
            with contextlib.suppress(OSError):
                await self.connect()
            await asyncio.sleep(0.01)

    async def hellos_of_nobody(self):
        """Certificates of the attacker's own, each with a whole chain to look at."""
        ca = trustme.CA()
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        ca.issue_cert("nobody").configure_cert(context)
        while True:
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_connection(self.host, self.port, ssl=context)
                self.open.append(writer)
            await asyncio.sleep(0.02)


ATTACKS = {
    "a header without end": ("everybody", Attacker.header_without_end),
    "half requests": ("everybody", Attacker.half_requests),
    "silent agents": ("everybody", Attacker.silent_agents),
    "half TLS handshakes, agents' listener": ("agents", Attacker.half_handshakes),
    "strangers' certificates, agents' listener": ("agents", Attacker.hellos_of_nobody),
}


async def test_everybody_else_is_served_meanwhile(ledger, tmp_path, monkeypatch, unused_tcp_port):
    ca = trustme.CA()
    ca.issue_cert("localhost").private_key_and_cert_chain_pem.write_to_path(tmp_path / "server.pem")
    # The demo speaks HTTP on loopback; TLS is what the agents' listener has.
    monkeypatch.setenv("WONDERLAND_BACKEND_AGENTS__LISTEN", f"127.0.0.1:{unused_tcp_port}")
    monkeypatch.setenv("WONDERLAND_BACKEND_AGENTS__TLS_CERTIFICATE", str(tmp_path / "server.pem"))
    process = await start(tmp_path, database=f"sqlite:///{tmp_path}/attacked.db")
    try:
        told = await ready(process)
        public = urlsplit(told["url"]).port
        rows = []
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False, verify=PLAIN, timeout=30) as http:
            await p95_ms(http)
            rest_ms, rest_mb = await p95_ms(http), resident_mb(process.pid)
            rows.append(("at rest", f"{rest_ms:.1f} ms", "1", f"{rest_mb:.0f} MB"))
            for name, (which, attack) in ATTACKS.items():
                attacker = Attacker("127.0.0.1", public if which == "everybody" else unused_tcp_port)
                under_way = [asyncio.create_task(attack(attacker)) for _ in range(4)]
                await asyncio.sleep(1)
                found_ms, found_mb = await p95_ms(http), resident_mb(process.pid)
                for each in under_way:
                    each.cancel()
                results = await asyncio.gather(*under_way, return_exceptions=True)
                assert all(isinstance(each, asyncio.CancelledError) for each in results), results
                count = len(attacker.open)
                attacker.close()
                ratio = found_ms / max(rest_ms, FLOOR_MS)
                rows.append((f"{name} ({count} sockets)", f"{found_ms:.1f} ms", f"{ratio:.1f}", f"{found_mb:.0f} MB"))
        show("The edge under attack: /health p95", ("while", "p95", "of that at rest", "resident"), rows)
    finally:
        await stop(process)
