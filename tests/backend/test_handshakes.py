"""Handshakes that strangers leave unfinished, against the server and the event loop that production has."""

from __future__ import annotations

import asyncio
import contextlib
import resource
import ssl
from http import HTTPStatus

import pytest
import trustme

from wonderland_backend import handshakes, listening
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings

CLIENT_HELLO_BEGINS = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"
REQUEST = b"GET /%d HTTP/1.1\r\nHost: localhost\r\n\r\n"


async def echo(scope, receive, send):
    """Answers with what was asked for, and with whom the socket is connected with."""
    sent = (scope["path"] + " " + scope["scheme"]).encode()
    size = str(len(sent)).encode()
    await send({"type": "http.response.start", "status": HTTPStatus.OK, "headers": [(b"content-length", size)]})
    await send({"type": "http.response.body", "body": sent})


@contextlib.asynccontextmanager
async def open_connections():
    """Opens connections that never finish a handshake, from addresses of this machine."""
    writers = []

    async def stranger(port, source="127.0.0.1", data=CLIENT_HELLO_BEGINS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(source, 0))
        writers.append(writer)
        writer.write(data)
        return reader

    yield stranger
    for writer in writers:
        writer.transport.abort()


@pytest.fixture
def in_production(tmp_path):
    """Runs a test's body beside a server, in the loop that `wonderland backend serve` has."""
    ca = trustme.CA()
    path = tmp_path / "own.pem"
    ca.issue_cert("localhost").private_key_and_cert_chain_pem.write_to_path(path)
    trust = ssl.create_default_context()
    ca.configure_trust(trust)

    async def serve(body):
        server = new_server(echo, Settings(public_url="https://localhost", tls_certificate=path))
        with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
            task = asyncio.create_task(server.serve([bound]))
            while not server.started:
                await asyncio.sleep(0.005)
            port = bound.getsockname()[1]

            async def honest(number=1):
                reader, writer = await asyncio.open_connection(
                    "127.0.0.1", port, ssl=trust, server_hostname="localhost"
                )
                writer.write(REQUEST % number)
                head = await reader.readuntil(b"\r\n\r\n")
                body = await reader.readexactly(len(f"/{number} https"))
                writer.transport.abort()
                return head.split(b" ")[1], body.decode()

            try:
                async with open_connections() as stranger, asyncio.timeout(40):
                    await body(port, honest, stranger)
            finally:
                server.should_exit = True
                await asyncio.wait_for(task, 30)

    def run(body):
        with asyncio.Runner(loop_factory=listening.Loop) as runner:
            runner.run(serve(body))

    return run


def test_what_comes_right_behind_a_handshake_is_answered(in_production):
    async def body(port, honest, stranger):
        answers = await asyncio.gather(*(honest(each) for each in range(100)))
        assert answers == [(b"200", f"/{each} https") for each in range(100)]

    in_production(body)


def test_one_address_cannot_push_out_the_others(in_production, monkeypatch):
    monkeypatch.setattr(handshakes.Handshakes.__init__, "__defaults__", (50, 5))

    async def body(port, honest, stranger):
        other = await stranger(port, "127.0.0.9")
        mine = [await stranger(port) for _ in range(30)]
        for each in mine[:25]:
            with contextlib.suppress(ConnectionError):
                assert await asyncio.wait_for(each.read(), 5) == b""  # let go: its address has too many
        assert not other.at_eof()
        assert await honest() == (b"200", "/1 https")

    in_production(body)


def test_of_many_addresses_the_oldest_gives_way_and_honest_ones_get_through(in_production, monkeypatch):
    monkeypatch.setattr(handshakes.Handshakes.__init__, "__defaults__", (20, 5))

    async def body(port, honest, stranger):
        first = await stranger(port, "127.0.1.1")
        for number in range(2, 60):
            await stranger(port, f"127.0.1.{number}")
            if number % 10 == 0:
                assert await honest(number) == (b"200", f"/{number} https")
        with contextlib.suppress(ConnectionError):
            assert await asyncio.wait_for(first.read(), 5) == b""

    in_production(body)


def test_a_crowd_of_unfinished_handshakes_has_a_price_that_is_known(in_production):
    """With the product's own figures: 3,000 of 100 addresses, of which 2,000 stand."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 8_000:
        pytest.skip(f"this machine lets a process have {hard} files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 8_000), hard))
    counted = []
    begin = handshakes.Handshakes.begin

    async def body(port, honest, stranger):
        for number in range(3_000):
            await stranger(port, f"127.0.2.{number % 100}")
        assert await honest() == (b"200", "/1 https")
        assert max(counted) <= handshakes.MOST

    def count(self, task, address):
        begin(self, task, address)
        counted.append(len(self._tasks))

    handshakes.Handshakes.begin = count
    try:
        in_production(body)
    finally:
        handshakes.Handshakes.begin = begin
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(
    "data", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\x16\x03\x01\xff\xff" + bytes(500)]
)
def test_what_is_no_handshake_is_let_go(in_production, monkeypatch, data):
    monkeypatch.setattr(handshakes, "HEAD_S", 0.3)

    async def body(port, honest, stranger):
        reader = await stranger(port, data=data)
        with contextlib.suppress(ConnectionError):
            await asyncio.wait_for(reader.read(), 5)
        assert await honest() == (b"200", "/1 https")

    in_production(body)


def test_a_server_that_stops_waits_for_no_handshake(in_production, monkeypatch):
    monkeypatch.setattr(handshakes, "HEAD_S", 60)  # longer than the server is given to stop
    left = []

    async def body(port, honest, stranger):
        left.append(await stranger(port))
        await honest()  # by now the stranger's is under way

    in_production(body)
    assert left[0].at_eof() or left[0].exception() is not None
