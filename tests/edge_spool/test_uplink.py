"""The uplink against a small server that behaves, breaks off, lies, stalls or refuses."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from kit.bus import Organisations, free_port
from kit.ways import WAYS, Spoken, Stand, WebSocketStand, ZenohStand, as_spoken
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

from wonderland.proofs import encoding
from wonderland.telemetry import Credentials, signed_text
from wonderland_bus.session import open_router
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Transport, Uplink, UplinkConfigurationError, UplinkTimings, WebSocketTransport
from wonderland_fabric_gateway.ca import Kind
from wonderland_fabric_gateway.ca.local import LocalCa
from wonderland_fabric_gateway.signing import key_signer, verify

KEY = ec.derive_private_key(7, ec.SECP256R1())
CREDENTIALS = Credentials(agent="pad", id="pad-1", msp_id="PadMSP", certificate_pem="PEM", sign=key_signer(KEY))
T0 = 1_760_000_400_000
FAST = UplinkTimings(
    backoff_s=0.01, backoff_max_s=0.05, greeting_timeout_s=10, stall_timeout_s=10, window_records=50, batch_records=10
)
IMPATIENT = replace(FAST, greeting_timeout_s=0.5, stall_timeout_s=0.3)
NONCE = encoding.to_base64url(bytes(range(32)))


class Ingest:
    """A server as docs/seams.md has it: durable (in a dictionary), cumulative acknowledgements; faults by hand."""

    def __init__(self) -> None:
        self.held: dict[str, int] = {}
        self.records: dict[str, list[dict[str, Any]]] = {}
        self.connections = 0
        self.break_after: int | None = None
        self.say_first: list[dict[str, Any]] = []
        self.refuse: str | None = None
        self.acknowledges = True
        self.silent = False
        self.reject: int | None = None
        self.live: set[Spoken] = set()

    async def handle(self, connection: Spoken) -> None:
        self.connections += 1
        self.live.add(connection)
        try:
            with contextlib.suppress(ConnectionError, ConnectionClosed):
                await self._talk(connection)
        finally:
            self.live.discard(connection)

    async def _talk(self, connection: Spoken) -> None:
        if self.silent:
            await connection.receive()
            return
        await connection.send(json.dumps({"type": "challenge", "nonce": NONCE, "server": "wonderland", "t_ms": T0}))
        hello = json.loads(await connection.receive())
        signed = signed_text(
            nonce=NONCE,
            agent=hello["agent"],
            agent_id=hello["id"],
            spool=hello["spool"],
            end_point=hello["tls_server_end_point"],
        )
        verify(KEY.public_key(), signed, encoding.from_base64url(hello["signature"]))
        if self.refuse:
            await connection.send(json.dumps({"type": "refused", "code": self.refuse, "message": "no"}))
            await connection.close(4403)
            return
        for message in self.say_first:
            await connection.send(json.dumps(message))
        spool = hello["spool"]
        await connection.send(json.dumps({"type": "welcome", "acknowledged": self.held.get(spool, 0)}))
        while True:
            text = await connection.receive()
            for record in json.loads(text)["records"]:
                # No duplicate, no gap that is not accounted for.
                start = record["body"]["from_seq"] if record["kind"] == "dropped" else record["seq"]
                assert start == self.held.get(spool, 0) + 1
                self.held[spool] = record["seq"]
                self.records.setdefault(spool, []).append(record)
                if self.reject == record["seq"]:
                    await connection.send(json.dumps({"type": "rejected", "seq": record["seq"], "code": "bad_body"}))
                if self.break_after is not None:
                    self.break_after -= 1
                    if self.break_after <= 0:
                        self.break_after = None
                        connection.abort()
                        return
            if self.acknowledges:
                await connection.send(json.dumps({"type": "ack", "seq": self.held[spool]}))


@pytest.fixture
def ingest() -> Ingest:
    return Ingest()


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Organisations, int]]:
    organisations, port = Organisations(tmp_path_factory.mktemp("organisations")), free_port()
    with open_router(organisations.router(port)):
        yield organisations, port


@pytest.fixture(params=WAYS)
def stand(request: pytest.FixtureRequest) -> Stand:
    if request.param == "websocket":
        return WebSocketStand(free_port())
    return ZenohStand(*request.getfixturevalue("bus"))


@pytest.fixture
async def server(ingest: Ingest, stand: Stand) -> AsyncIterator[Stand]:
    async with stand.serve(ingest.handle):
        yield stand


@pytest.fixture
async def spool(tmp_path: Path) -> AsyncIterator[Spool]:
    async with await Spool.open(tmp_path, owner="pad-1", reserve_bytes=0, linger_s=0.002) as opened:
        yield opened


StartUplink = Callable[..., Awaitable[Uplink]]


@pytest.fixture
async def start(spool: Spool) -> AsyncIterator[StartUplink]:
    running: list[Uplink] = []

    async def start_uplink(way: Transport, **options: Any) -> Uplink:
        uplink = Uplink(way, CREDENTIALS, spool, **{"timings": FAST, "randomness": random.Random(1), **options})
        running.append(uplink)
        await uplink.start()
        return uplink

    yield start_uplink
    for uplink in running:
        await uplink.close()


async def until(condition: Callable[[], object], timeout_s: float = 10.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():
            await asyncio.sleep(0.005)


async def fill(spool: Spool, count: int) -> None:
    for index in range(count):
        spool.offer("track", T0 + index, {"n": index})
    await spool.append("step", T0, {"n": count}, evidence=True)


async def test_everything_arrives_in_order_and_is_forgotten(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    await fill(spool, 500)
    uplink = await start(server.way())
    await until(lambda: spool.status.records == 0)
    assert [record["seq"] for record in ingest.records[spool.id]] == list(range(1, 502))
    assert ingest.records[spool.id][500]["kind"] == "step"
    assert uplink.status.connected
    assert uplink.status.acknowledged_seq == 501
    assert uplink.status.sent_records == 501
    # What comes later goes at once.
    await spool.append("step", T0, {"n": 1}, evidence=True)
    await until(lambda: spool.status.records == 0)
    assert ingest.connections == 1


async def test_a_connection_that_breaks_again_and_again_loses_and_doubles_nothing(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    await start(server.way())
    await fill(spool, 50)
    for count in (1, 7, 13, 29, 31, 60):
        ingest.break_after = count
        await fill(spool, 60)
        await until(lambda: spool.status.records == 0)
    seqs = [record["seq"] for record in ingest.records[spool.id]]
    assert seqs == list(range(1, spool.status.last_seq + 1))
    assert ingest.connections >= 6


async def test_a_server_that_comes_late_and_restarts(
    ingest: Ingest, stand: Stand, spool: Spool, start: StartUplink
) -> None:
    uplink = await start(stand.way())
    await until(lambda: "no connection to" in uplink.status.error)
    await fill(spool, 30)
    async with stand.serve(ingest.handle):
        await until(lambda: spool.status.records == 0)
    await until(lambda: not uplink.status.connected)
    await fill(spool, 30)
    async with stand.serve(ingest.handle):
        await until(lambda: spool.status.records == 0)
    assert len(ingest.records[spool.id]) == 62


async def test_what_was_dropped_is_said(ingest: Ingest, server: Stand, tmp_path: Path) -> None:
    async with await Spool.open(
        tmp_path / "small", owner="pad-1", quota_bytes=256 * 1024, reserve_bytes=0, linger_s=0.002
    ) as spool:
        for index in range(3_000):
            spool.offer("track", T0, {"n": index, "x": "y" * 200})
        await spool.append("step", T0, {}, evidence=True)
        assert spool.status.dropped > 0
        uplink = Uplink(server.way(), CREDENTIALS, spool, timings=FAST)
        await uplink.start()
        await until(lambda: spool.status.records == 0)
        await uplink.close()
        kinds = [record["kind"] for record in ingest.records[spool.id]]
        assert kinds[0] == "dropped"
        assert kinds[-1] == "step"


async def test_a_refusal_is_said_and_tried_again(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink, caplog: pytest.LogCaptureFixture
) -> None:
    ingest.refuse = "duplicate_agent"
    await fill(spool, 3)
    seen: list[str] = []
    uplink = await start(server.way(), on_status=lambda status: seen.append(status.refusal))
    await until(lambda: ingest.connections >= 3)
    assert uplink.status.refusal == "duplicate_agent"
    assert not uplink.status.connected
    assert len([line for line in caplog.messages if "duplicate_agent" in line]) == 1  # said once, not at each attempt
    ingest.refuse = None
    await until(lambda: spool.status.records == 0)
    assert uplink.status.refusal == ""
    assert "duplicate_agent" in seen


async def test_a_rejected_record_blocks_nothing(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    ingest.reject = 5
    await fill(spool, 20)
    uplink = await start(server.way())
    await until(lambda: spool.status.records == 0)
    assert uplink.status.rejected_records == 1


async def test_a_server_that_acknowledges_nothing_is_left(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    ingest.acknowledges = False
    await fill(spool, 200)
    uplink = await start(server.way(), timings=IMPATIENT)
    await until(lambda: "acknowledged nothing" in uplink.status.error)
    # No more than the window was under way; and the server's word at the next welcome counts.
    assert 0 < uplink.status.sent_records <= 100
    ingest.acknowledges = True
    await until(lambda: spool.status.records == 0)
    assert [record["seq"] for record in ingest.records[spool.id]] == list(range(1, 202))


async def test_a_server_that_says_nothing_is_left(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    ingest.silent = True
    uplink = await start(server.way(), timings=IMPATIENT)
    await until(lambda: "did not finish the greeting" in uplink.status.error)
    assert ingest.connections >= 1


async def test_a_server_that_breaks_the_protocol_is_left(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    ingest.say_first = [{"type": "welcome", "acknowledged": 0}, {"type": "ack", "seq": 99}]
    uplink = await start(server.way())
    await until(lambda: "acknowledged 99" in uplink.status.error)
    assert spool.status.acknowledged == 0


async def test_a_server_that_knows_more_than_a_restored_spool(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink
) -> None:
    before = spool.id
    ingest.held[before] = 1_000
    await fill(spool, 10)
    await start(server.way())
    await until(lambda: spool.status.records == 0)
    assert spool.id != before
    assert before not in ingest.records
    assert [record["seq"] for record in ingest.records[spool.id]] == list(range(1, 12))


async def test_an_http_server_that_is_no_ingest(spool: Spool, start: StartUplink) -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        await writer.drain()
        writer.close()

    async with await asyncio.start_server(answer, "127.0.0.1", 0) as other:
        uplink = await start(WebSocketTransport(f"ws://127.0.0.1:{other.sockets[0].getsockname()[1]}/ingest"))
        await until(lambda: "HTTP 404" in uplink.status.error)
        await uplink.close()


async def test_an_encrypted_connection_and_a_server_that_nobody_vouches_for(
    ingest: Ingest, spool: Spool, start: StartUplink, tmp_path: Path
) -> None:
    authority = LocalCa.create(tmp_path / "ca", "AuthorityMSP")
    issued = authority.enrol("ingest", kind=Kind.TLS, hosts=["localhost"])
    assert issued.private_key_pem is not None
    (tmp_path / "server.pem").write_bytes(issued.certificate_pem + issued.private_key_pem)
    serving = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    serving.load_cert_chain(tmp_path / "server.pem")
    trusting = ssl.create_default_context(cadata=authority.root_pem(Kind.TLS).decode())
    async with serve(lambda socket: ingest.handle(as_spoken(socket)), "localhost", 0, ssl=serving) as server:
        address = f"wss://localhost:{next(iter(server.sockets)).getsockname()[1]}/ingest"
        await fill(spool, 5)
        doubting = await start(WebSocketTransport(address))
        await until(lambda: "certificate verify failed" in doubting.status.error.lower())
        await doubting.close()
        assert spool.status.records == 6
        await start(WebSocketTransport(address, ssl_context=trusting))
        await until(lambda: spool.status.records == 0)
        assert len(ingest.records[spool.id]) == 6


async def test_a_mistake_in_the_agent_does_not_silence_it(
    ingest: Ingest, server: Stand, spool: Spool, start: StartUplink, monkeypatch: pytest.MonkeyPatch
) -> None:
    pending, faults = Spool.pending, iter([RuntimeError("a mistake")])

    async def failing(self: Spool, *args: Any, **options: Any) -> Any:
        for fault in faults:
            raise fault
        return await pending(self, *args, **options)

    monkeypatch.setattr(Spool, "pending", failing)
    await fill(spool, 5)
    errors: list[str] = []
    await start(server.way(), on_status=lambda status: errors.append(status.error))
    await until(lambda: spool.status.records == 0)
    assert any("a mistake" in error for error in errors)


async def test_the_spool_may_be_closed_first(ingest: Ingest, server: Stand, tmp_path: Path) -> None:
    spool = await Spool.open(tmp_path / "other", owner="pad-1", reserve_bytes=0)
    uplink = Uplink(server.way(), CREDENTIALS, spool, timings=FAST)
    await uplink.start()
    await until(lambda: uplink.status.connected)
    await spool.close()
    await until(lambda: not uplink.status.connected)
    await uplink.close()


def test_waiting_grows_with_jitter_and_has_an_end() -> None:
    uplink = Uplink(WebSocketTransport("ws://127.0.0.1:1/"), CREDENTIALS, None, randomness=random.Random(5))  # type: ignore[arg-type]
    delays = [uplink._delay_s(attempt) for attempt in range(40)]
    assert 0.25 <= delays[0] <= 0.5
    assert all(15 <= delay <= 30 for delay in delays[7:])
    assert len(set(delays[7:])) > 20


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("http://example.org/ingest", "wss://"),
        ("ws://example.org/ingest", "not encrypted"),
        ("ws://10.0.0.1/ingest", "not encrypted"),
        ("wss://user:secret@example.org/", "no password"),
        ("wss://", "and a host"),
        ("wss://example.org:port/", "cannot be read"),
    ],
)
def test_addresses_with_which_nothing_can_work(address: str, says: str) -> None:
    with pytest.raises(UplinkConfigurationError, match=says) as caught:
        WebSocketTransport(address)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    "address", ["ws://localhost:1/", "ws://127.0.0.9/", "ws://[::1]:80/", "WSS://example.org/ingest"]
)
def test_addresses_that_are_fine(address: str) -> None:
    WebSocketTransport(address)
    WebSocketTransport("ws://10.0.0.1/", allow_plaintext=True)
