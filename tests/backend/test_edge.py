"""The server's own edge, attacked on its socket: heads, half requests, connections, bodies that unpack to gigabytes."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import time
from ipaddress import ip_network

import httpx
import pytest
import websockets
from kit.bombs import bomb, peak_kb

from wonderland_backend import http_protocol
from wonderland_backend.http import transfer
from wonderland_backend.http_protocol import MAX_HEADERS, Gate
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server


@pytest.fixture
async def at(running):
    """Opens raw connections to a running backend."""
    url = httpx.URL(running.url)
    async with contextlib.AsyncExitStack() as stack:

        async def connect():
            reader, writer = await asyncio.open_connection(url.host, url.port)
            stack.callback(writer.close)
            return reader, writer

        yield connect


async def answer_of(reader):
    """What comes until the connection is closed."""
    return await asyncio.wait_for(reader.read(), 15)


async def health_s(running):
    began = time.monotonic()
    assert (await running.get("/health")).status_code == 200
    return time.monotonic() - began


async def test_a_header_of_60_mib_keeps_nobody_waiting(running, at):
    reader, writer = await at()
    writer.write(b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")
    slowest_s, sent = 0.0, 0
    with contextlib.suppress(ConnectionError):
        for _ in range(60 * 16):
            writer.write(b"a" * 65_536)
            await writer.drain()
            sent += 65_536
            if sent % (1 << 20) == 0:
                slowest_s = max(slowest_s, await health_s(running))
    assert sent < 30 << 20, "it was refused long before"
    assert slowest_s < 5.0, "it was 9.8 s"
    with contextlib.suppress(ConnectionError):
        assert (await answer_of(reader)).startswith(b"HTTP/1.1 431 ")


@pytest.mark.parametrize(
    "head",
    [
        b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 70_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: a\r\n" * (MAX_HEADERS + 1) + b"\r\n",
    ],
    ids=["line", "header", "headers"],
)
async def test_a_head_that_is_too_large_is_refused(at, head):
    reader, writer = await at()
    writer.write(head)
    assert (await answer_of(reader)).startswith(b"HTTP/1.1 431 ")


async def test_a_head_of_usual_size_in_small_pieces_is_served(at):
    reader, writer = await at()
    head = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 8_000 + b"\r\nConnection: close\r\n\r\n"
    for start in range(0, len(head), 1_000):
        writer.write(head[start : start + 1_000])
        await writer.drain()
        await asyncio.sleep(0.001)
    assert (await answer_of(reader)).startswith(b"HTTP/1.1 200 ")


@pytest.mark.parametrize(
    "headers",
    [
        b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n",
        b"Content-Length: 4\r\nContent-Length: 5\r\n",
        b"Transfer-Encoding: chunked, identity\r\n",
        b"Content-Length: +4\r\n",
        b"Content-Length : 4\r\n",
    ],
    ids=["both", "two lengths", "not chunked at last", "a sign", "a space"],
)
async def test_a_request_whose_end_could_be_read_in_two_ways_is_refused(at, headers):
    reader, writer = await at()
    head = b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\n" + headers + b"\r\n"
    writer.write(head + b"0\r\n\r\nGET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    answer = await answer_of(reader)
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert answer.count(b"HTTP/1.1 ") == 1, "what was hidden behind it is not answered"


async def test_a_coding_that_nobody_knows_is_not_taken_for_none(at):
    reader, writer = await at()
    writer.write(b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: x, chunked\r\n\r\n0\r\n\r\n")
    assert (await answer_of(reader)).startswith(b"HTTP/1.1 501 ")


@pytest.mark.parametrize(
    ("target", "status"),
    [(b"http://127.0.0.1/api/v1/health", 200), (b"http://evil.example/api/v1/health", 400), (b"http://[/", 400)],
    ids=["its own", "another", "none"],
)
async def test_a_request_line_that_names_a_host_names_the_one_of_its_header(at, target, status):
    reader, writer = await at()
    writer.write(b"GET " + target + b" HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
    assert (await answer_of(reader)).startswith(b"HTTP/1.1 %d " % status)


async def test_a_body_that_drips_is_let_go_and_a_slow_one_is_not(at, monkeypatch):
    monkeypatch.setattr(http_protocol, "BODY_IDLE_S", 0.4)
    monkeypatch.setattr(http_protocol, "BODY_BYTES_PER_S", 500)
    answers = []
    for each in (b" ", b" " * 100):
        reader, writer = await at()
        length = len(each) * 20
        writer.write(
            b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
            b"Content-Type: application/json\r\nContent-Length: %d\r\n\r\n" % length
        )
        answer = asyncio.create_task(answer_of(reader))
        for _ in range(20):
            await asyncio.wait({answer}, timeout=0.1)
            if not answer.done():
                writer.write(each)
        answers.append((await answer)[:13])
    assert answers == [b"HTTP/1.1 408 ", b"HTTP/1.1 422 "]


async def test_text_that_is_none_ends_a_connection_and_writes_no_traceback(running, caplog):
    async with running.live() as socket:
        await asyncio.wait_for(socket.recv(), 5)
        await socket.send(b"\xff\xfe", text=True)
        with pytest.raises(websockets.ConnectionClosed) as closed:
            while True:
                await asyncio.wait_for(socket.recv(), 5)
    assert closed.value.rcvd.code == 1007
    assert [each for each in caplog.records if each.exc_info] == []


@pytest.mark.parametrize(("trusted", "address"), [(("127.0.0.1",), "192.0.2.7"), (("10.0.0.0/8",), "127.0.0.1")])
async def test_what_a_proxy_says_of_addresses_is_believed_of_trusted_ones_only(new_backend, serving, trusted, address):
    async with serving(new_backend(trusted_proxies=trusted)) as running:
        told = {"X-Forwarded-For": "203.0.113.9, 192.0.2.7", "X-Real-IP": "192.0.2.8", "Forwarded": "for=192.0.2.9"}
        assert (await running.http.post("/api/v1/session", json={"token": "x"}, headers=told)).status_code == 401
        token = await running.parts.sign_ins.new_token("Admin", ("admin",))
        await running.http.post("/api/v1/session", json={"token": token})
        failed = (await running.json("/audit", act="sign_in_failed"))["items"]
        assert {each["detail"]["address"] for each in failed} == {address}


@pytest.mark.parametrize(
    "begin",
    [
        b"",
        b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{",
        b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    ],
    ids=["nothing", "half a head", "half a body", "and then line ends"],
)
async def test_whoever_never_ends_a_request_is_let_go(at, monkeypatch, begin):
    monkeypatch.setattr(http_protocol, "HEAD_S", 0.4)
    monkeypatch.setattr(http_protocol, "BODY_IDLE_S", 0.4)
    reader, writer = await at()
    writer.write(begin)

    async def drip():
        while begin.endswith(b"\r\n\r\n") or b"{" not in begin:
            await asyncio.sleep(0.1)
            writer.write(b"\r\n" if begin.endswith(b"\r\n\r\n") else begin[:1] and b"X")

    dripping = asyncio.create_task(drip())
    try:
        answer = await answer_of(reader)
    except ConnectionError:
        answer = b"HTTP/1.1 408 "
    finally:
        dripping.cancel()
    assert b"HTTP/1.1 408 " in answer


async def test_only_what_the_client_owes_is_timed(running, monkeypatch):
    monkeypatch.setattr(http_protocol, "HEAD_S", 0.2)
    monkeypatch.setattr(http_protocol, "BODY_IDLE_S", 0.2)

    async def slow(scope, receive, send):
        await asyncio.sleep(0.6)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"at ", "more_body": True})
        await asyncio.sleep(0.6)
        await send({"type": "http.response.body", "body": b"last"})

    server = new_server(slow, running.context.settings)
    bound = Listen("127.0.0.1", 0).open()
    serving = asyncio.create_task(server.serve([bound]))
    try:
        while not server.started:
            await asyncio.sleep(0.005)
        url = f"http://127.0.0.1:{bound.getsockname()[1]}/"
        async with httpx.AsyncClient(trust_env=False, timeout=10) as http:
            assert [(await http.post(url, content=b"x")).text for _ in range(2)] == ["at last"] * 2
    finally:
        server.should_exit = True
        await serving
        bound.close()
    async with running.live() as socket:
        await asyncio.wait_for(socket.recv(), 5)
        await asyncio.sleep(0.6)
        await asyncio.wait_for(await socket.ping(), 5)


def test_a_gate_counts_in_and_out():
    gate = Gate(4, 2, [ip_network("10.0.0.0/8")])
    assert [gate.enter("192.0.2.1") for _ in range(3)] == [True, True, False]
    assert [gate.enter("10.1.1.1") for _ in range(3)] == [True, True, False], "in all there are four"
    gate.leave("10.1.1.1")
    assert [gate.enter("192.0.2.1"), gate.enter("192.0.2.2")] == [False, True]
    for address in ("192.0.2.1", "192.0.2.1", "192.0.2.2", "10.1.1.1"):
        gate.leave(address)
    assert [gate.enter("192.0.2.1") for _ in range(3)] == [True, True, False]


async def test_connections_beyond_the_limit_are_told_so_and_make_room(new_backend, serving):
    async with serving(new_backend(max_connections=5)) as running:
        url = httpx.URL(running.url)
        async with contextlib.AsyncExitStack() as stack:
            sockets = [await stack.enter_async_context(running.live()) for _ in range(3)]
            open_ones = [await asyncio.open_connection(url.host, url.port) for _ in range(4)]
            answers = [reader.read(12) for reader, _ in open_ones]
            told = await asyncio.wait_for(answers[-1], 5)
            assert told == b"HTTP/1.1 503"
            for answer in answers[:-1]:
                answer.close()
            for _, writer in open_ones:
                writer.close()
            assert len(sockets) == 3
        for _ in range(20):  # those that end as no WebSocket, too
            reader, writer = await asyncio.open_connection(url.host, url.port)
            writer.write(
                b"GET /api/v1/live HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: upgrade\r\nUpgrade: websocket\r\n\r\n"
            )
            assert (await answer_of(reader)).startswith(b"HTTP/1.1 400 ")
            writer.close()
            async with running.live() as socket:
                await asyncio.wait_for(socket.recv(), 5)


class Raw(httpx.AsyncByteStream):
    """A body in pieces, as a network brings it."""

    def __init__(self, content):
        self.content = content

    async def __aiter__(self):
        for start in range(0, len(self.content), 65_536):
            yield self.content[start : start + 65_536]


TWICE = bomb(600)
ONCE = gzip.decompress(TWICE)


@pytest.mark.parametrize(
    ("encoding", "body", "why"),
    [
        ("gzip", ONCE, "sends more than 4194304 bytes"),
        ("gzip, gzip", TWICE, "an encoding that it was not asked for"),
        ("br", b"x", "an encoding that it was not asked for"),
        ("gzip", b"no gzip", "is not gzip"),
        ("gzip", gzip.compress(b"{}")[:-4], "ended its answer early"),
        ("gzip", gzip.compress(b"{}") * 2, "more than one packed body"),
        ("", bytes(5 << 20), "sends more than 4194304 bytes"),
    ],
    ids=["bomb", "bomb in a bomb", "brotli", "no gzip", "cut", "two", "plain"],
)
async def test_what_others_answer_is_unpacked_within_bounds(encoding, body, why):
    async def app(request):
        return httpx.Response(200, headers={"Content-Encoding": encoding} if encoding else {}, stream=Raw(body))

    before_kb = peak_kb()
    async with httpx.AsyncClient(transport=httpx.MockTransport(app)) as client:
        with pytest.raises(transfer.TransferError, match=why):
            await transfer.ask(client, "GET", "http://peer.example/")
    assert peak_kb() - before_kb < 40_000


async def test_what_is_packed_once_is_read():
    async def app(request):
        assert request.headers["accept-encoding"] == "gzip"
        return httpx.Response(200, headers={"Content-Encoding": "gzip"}, stream=Raw(gzip.compress(b'{"a":1}')))

    async with httpx.AsyncClient(transport=httpx.MockTransport(app)) as client:
        assert await transfer.ask_object(client, "GET", "http://peer.example/") == {"a": 1}
