"""Receivers of webhooks over HTTPS, and a poster that trusts their CA."""

from __future__ import annotations

import asyncio
import contextlib
import ssl

import pytest
import trustme

from wonderland_backend.http.targets import Destinations
from wonderland_backend.webhooks.deliver import Webhooks
from wonderland_backend.webhooks.post import Poster

SCOPES = "wonderland.subscriptions wonderland.proofs.read"


class Receiver:
    """An HTTPS server that keeps what it gets, and answers as told: a status, or `hang`."""

    def __init__(self):
        self.requests = []
        self.answers = []
        self.arrived = asyncio.Event()
        self.location = "https://127.0.0.1:1/"

    async def serve(self, reader, writer):
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode()
            lines = head.split("\r\n")
            headers = {name.lower(): value for name, value in (line.split(": ", 1) for line in lines[1:] if line)}
            body = await reader.readexactly(int(headers.get("content-length", 0)))
            self.requests.append((lines[0], headers, body))
            answer = self.answers.pop(0) if self.answers else 204
            self.arrived.set()
            if answer == "hang":
                await asyncio.sleep(60)
            if answer == "drip":
                for byte in b"HTTP/1.1 204 x\r\ncontent-length: 0\r\nx-y: " + b"z" * 600:
                    writer.write(bytes([byte]))
                    await writer.drain()
                    await asyncio.sleep(0.05)
            writer.write(f"HTTP/1.1 {answer} x\r\nlocation: {self.location}\r\ncontent-length: 0\r\n\r\n".encode())
            await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            writer.close()

    @contextlib.asynccontextmanager
    async def listening(self, ca, name="hooks.example"):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        ca.issue_cert(name).configure_cert(context)
        server = await asyncio.start_server(self.serve, "127.0.0.1", 0, ssl=context)
        async with server:
            yield server.sockets[0].getsockname()[1]


@pytest.fixture(scope="module")
def ca(tmp_path_factory):
    authority = trustme.CA()
    authority.path = tmp_path_factory.mktemp("ca") / "ca.pem"
    authority.cert_pem.write_to_path(authority.path)
    return authority


async def loopback(host, port):
    return ["127.0.0.1"]


@pytest.fixture
async def poster(ca, running):
    """Sends to hooks.example, whose name leads to this machine; allowed by name."""
    found = Poster(Destinations(frozenset({"hooks.example"})), ca_file=ca.path, lookup=loopback)
    app = running.backend.app
    app.state.parts = {**app.state.parts, Poster: found}
    for task in running.backend._tasks:
        if task.get_name() == "webhooks":
            task.cancel()  # These tests do its work themselves, step by step.
    yield found
    await found.close()


@pytest.fixture
async def webhooks(running, poster, clock):
    return Webhooks(running.context.database, poster, running.parts.sealing, running.parts.commits, clock)
