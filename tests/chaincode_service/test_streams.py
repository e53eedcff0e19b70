"""What lies between peer and service: registration, bad bytes, reconnection, TLS, and the end of a service."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import socket
import ssl

import grpc
import pytest
from fabric_protos.peer import chaincode_pb2

from wonderland_chaincode.service import ContractServer, Limits, Tls
from wonderland_chaincode.service.errors import SettingsError, StreamProtocolError
from wonderland_chaincode.service.metrics import Metrics
from wonderland_chaincode.service.stream import PeerStream


async def ending(stream):
    """Status code and text with which the service ends a stream."""
    async with asyncio.timeout(10):
        with contextlib.suppress(grpc.aio.AioRpcError):
            while await stream.read() is not grpc.aio.EOF:
                pass
        return await stream.code(), await stream.details()


async def eventually(condition):
    async with asyncio.timeout(10):
        while not condition():
            await asyncio.sleep(0.01)


async def test_the_service_registers_under_its_package_id(tools, world):
    peer = await world.peer()
    assert peer.package_id == tools.PACKAGE_ID
    await eventually(lambda: world.server.peers)
    assert world.count("streams") == 1
    await peer.close()
    assert await peer.stream.code() == grpc.StatusCode.OK
    await eventually(lambda: not world.server.peers)
    assert world.count("streams") == 0


async def test_a_peer_comes_back_as_often_as_it_likes(tools, world):
    for number in range(1, 6):
        peer = await world.peer(tools.State(a="1"))
        assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"
        peer.stream.cancel()
        await eventually(lambda: not world.server.peers)
        assert world.count("connections_total") == number


async def test_several_peers_are_served_side_by_side(tools, world):
    peers = [await world.peer(tools.State(a=str(number))) for number in range(3)]
    call = tools.Call("get", ("a",))  # the same transaction on each, as when an organisation has several peers
    ended = await asyncio.gather(*(peer.run(call) for peer in peers))
    assert [each.payload for each in ended] == [b"0", b"1", b"2"]


async def test_a_peer_that_goes_leaves_nothing_behind(tools, world):
    peer = await world.peer(tools.State(a="1"), delay_s=30)
    for _ in range(5):
        await peer.begin(tools.Call("get", ("a",)))
    await eventually(lambda: world.server.in_flight == 5)
    peer.stream.cancel()
    await eventually(lambda: world.server.in_flight == 0 and world.count("streams") == 0)
    assert world.count("transactions_in_flight") == 0
    other = await world.peer(tools.State(a="1"))
    assert (await other.run(tools.Call("get", ("a",)))).payload == b"1"


async def test_a_keepalive_comes_back(tools, world):
    peer = await world.peer()
    await peer.send(tools.M(type=tools.M.KEEPALIVE))
    await eventually(lambda: peer.keepalives == 1)


async def test_a_keepalive_may_come_before_the_registration(tools, world):
    stream = world.open_stream()
    peer = tools.FakePeer(stream, tools.State(a="1"))
    await peer.send(tools.M(type=tools.M.KEEPALIVE))
    assert (await peer.receive()).type == tools.M.REGISTER
    assert (await peer.receive()).type == tools.M.KEEPALIVE
    await peer.send(tools.M(type=tools.M.REGISTERED))
    await peer.send(tools.M(type=tools.M.READY))
    peer.reader = asyncio.create_task(peer.read_all())
    ended = await peer.run(tools.Call("fill", ("k", "2")))
    assert ended.calls == ["PUT_STATE", "PUT_STATE"]  # a READY without parameters offers no batches


@pytest.mark.parametrize("kind", ["PUT_STATE", "REGISTERED", "COMPLETED", "RESPONSE", 77])
async def test_messages_that_have_no_business_here_are_ignored(tools, world, kind):
    peer = await world.peer(tools.State(a="1"))
    number = tools.M.Type.Value(kind) if isinstance(kind, str) else kind
    await peer.send(tools.M(type=number, txid="00", channel_id="x", payload=b"?"))
    assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"
    assert world.count("unexpected_messages_total") == 1


async def test_garbage_ends_that_stream_and_no_other(tools, world):
    good, bad = await world.peer(tools.State(a="1")), await world.peer()
    await bad.send(b"\xff\xff\xff")
    with contextlib.suppress(grpc.aio.AioRpcError):
        await asyncio.wait_for(bad.reader, 10)
    assert await bad.stream.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert "message of the peer" in await bad.stream.details()
    assert (await good.run(tools.Call("get", ("a",)))).payload == b"1"
    assert world.count("protocol_errors_total") == 1


@pytest.mark.parametrize(
    ("messages", "said"),
    [
        (["READY"], "READY came where REGISTERED should"),
        (["TRANSACTION"], "TRANSACTION came where REGISTERED should"),
        (["REGISTERED", "REGISTERED"], "REGISTERED came where READY should"),
        (["ERROR"], "ERROR came where REGISTERED should: not wanted here"),
        ([99], "message type 99 came where REGISTERED should"),
    ],
)
async def test_a_registration_in_another_order_is_none(tools, world, messages, said):
    stream = world.open_stream()
    for kind in messages:
        number = tools.M.Type.Value(kind) if isinstance(kind, str) else kind
        await stream.write(tools.M(type=number, payload=b"not wanted here").SerializeToString())
    code, details = await ending(stream)
    assert code == grpc.StatusCode.INVALID_ARGUMENT
    assert said in details


async def test_parameters_that_are_none_end_the_stream(tools, world):
    stream = world.open_stream()
    for message in (tools.M(type=tools.M.REGISTERED), tools.M(type=tools.M.READY, payload=b"\xff")):
        await stream.write(message.SerializeToString())
    assert (await ending(stream))[0] == grpc.StatusCode.INVALID_ARGUMENT


async def test_a_peer_that_never_registers_is_let_go(toy, serving):
    async with serving(toy, limits=Limits(handshake_s=0.1, drain_s=1)) as world:
        code, details = await ending(world.open_stream())
        assert (code, details) == (grpc.StatusCode.INVALID_ARGUMENT, "not registered after 0 s")


async def test_a_peer_that_hangs_up_while_registering_is_logged_with_the_package(tools, world, caplog):
    caplog.set_level("WARNING")
    stream = world.open_stream()
    await stream.done_writing()
    assert (await ending(stream))[0] == grpc.StatusCode.OK
    assert f"does it have a package {tools.PACKAGE_ID}?" in caplog.text


async def test_streams_are_counted_and_bounded(toy, serving):
    async with serving(toy, limits=Limits(max_streams=2, drain_s=1)) as world:
        for _ in range(2):
            await world.peer()
        code, details = await ending(world.open_stream())
        assert (code, details) == (grpc.StatusCode.UNAVAILABLE, "too many streams are open")


async def test_a_peer_that_asks_without_reading_is_let_go(tools, toy):
    """Without a network: nothing of what the service writes is ever taken."""
    incoming = asyncio.Queue()
    register = asyncio.Event()

    async def write(data):
        if register.is_set():
            await asyncio.Event().wait()
        register.set()

    stream = PeerStream(
        "test", incoming.get, write, package_id=tools.PACKAGE_ID, contract=toy, limits=Limits(max_in_flight=10, answer_s=0.2),
        metrics=Metrics(), now_ms=lambda: tools.START_MS,
    )  # fmt: skip
    for kind in (tools.M.REGISTERED, tools.M.READY):
        incoming.put_nowait(tools.M(type=kind).SerializeToString())
    for _ in range(200):
        incoming.put_nowait(tools.M(type=tools.M.KEEPALIVE).SerializeToString())
    with pytest.raises(StreamProtocolError, match="does not read"):
        await asyncio.wait_for(stream.serve(), 10)


async def test_a_stopping_service_ends_what_is_under_way_and_begins_nothing(tools, toy, serving):
    async with serving(toy, limits=Limits(drain_s=10)) as world:
        peer = await world.peer(tools.State(a="1", b="2"), delay_s=0.3)
        slow = [tools.Call("range", ("a", "c")) for _ in range(3)]
        began = [await peer.begin(call) for call in slow]
        await eventually(lambda: world.server.in_flight == 3)
        stopping = asyncio.create_task(world.server.stop())
        await eventually(lambda: world.server.draining)
        late = await peer.run(tools.Call("get", ("a",)))
        assert late.kind == tools.M.ERROR
        assert "is stopping; another peer can endorse" in late.text
        ended = [await peer.end(call, begun) for call, begun in zip(slow, began, strict=True)]
        assert [each.status for each in ended] == [200, 200, 200]
        await asyncio.wait_for(peer.reader, 5)
        assert await peer.stream.code() == grpc.StatusCode.OK
        await asyncio.wait_for(stopping, 5)
        with pytest.raises(grpc.aio.AioRpcError):
            await world.peer()


async def test_a_stopping_service_waits_no_longer_than_told(tools, toy, serving):
    async with serving(toy, limits=Limits(drain_s=0.2)) as world:
        peer = await world.peer(tools.State(a="1"), delay_s=60)
        await peer.begin(tools.Call("get", ("a",)))
        await eventually(lambda: world.server.in_flight == 1)
        async with asyncio.timeout(5):
            await world.server.stop()
        await eventually(lambda: world.server.in_flight == 0)


async def test_an_idle_service_stops_at_once(toy, serving):
    async with serving(toy, limits=Limits(drain_s=60)) as world:
        await world.peer()
        await eventually(lambda: world.server.peers)
        async with asyncio.timeout(5):
            await world.server.stop()


async def test_a_taken_port_is_said_and_not_shared(toy, world):
    second = ContractServer(toy, world.server.package_id)
    with pytest.raises(SettingsError, match="the port is taken"):
        await second.start(world.server.address)
    await second.stop()


async def test_pings_on_an_idle_stream_do_not_end_it(tools, world):
    """grpc's own default ends a connection after three pings without data; a peer pings as long as it lives."""
    options = [
        ("grpc.keepalive_time_ms", 100), ("grpc.http2.min_sent_ping_interval_without_data_ms", 100),
        ("grpc.http2.max_pings_without_data", 0), ("grpc.keepalive_permit_without_calls", 1),
    ]  # fmt: skip
    channel = grpc.aio.insecure_channel(world.server.address, options)
    world.channels.append(channel)
    peer = await tools.FakePeer(channel.stream_stream("/protos.Chaincode/Connect")(), tools.State(a="1")).register()
    await asyncio.sleep(1.5)
    assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"
    assert world.count("connections_total") == 1


async def test_large_messages_pass(tools, serving):
    class Large:
        version = "1"

        async def invoke(self, stub, function, args):
            return b"%d" % len([None async for _ in stub.range("a", "z")])

    async with serving(Large()) as world:
        state = tools.State(**{f"k{number:02}": b"x" * (4 << 20) for number in range(12)})
        ended = await (await world.peer(state, page=100)).run(tools.Call("x"))
        assert ended.payload == b"12"


@pytest.fixture
def authority(tools, tmp_path):
    """A CA, the service's files, and a peer's."""
    ca = tools.key_and_certificate("ca", ca=True)
    server, peer = (tools.key_and_certificate(name, ca) for name in ("service", "peer"))
    stranger_ca = tools.key_and_certificate("other ca", ca=True)
    stranger = tools.key_and_certificate("stranger", stranger_ca)
    files = {"ca.pem": ca[3], "server.pem": server[3], "server.key": server[2], "other.key": peer[2]}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    return ca, peer, stranger


def load(directory, now=None, **names):
    found = {"certificate": "server.pem", "key": "server.key", "client_ca": "ca.pem"} | names
    paths = {name: None if file is None else directory / file for name, file in found.items()}
    return Tls(**paths, clock=lambda: now or dt.datetime.now(dt.UTC))


async def test_with_mutual_tls_only_the_organisations_peers_get_in(tools, toy, serving, authority, tmp_path):
    ca, peer, stranger = authority
    async with serving(toy, tls=load(tmp_path)) as world:
        good = grpc.ssl_channel_credentials(ca[3], peer[2], peer[3])
        known = await world.peer(tools.State(a="1"), good)
        assert (await known.run(tools.Call("get", ("a",)))).payload == b"1"
        for credentials in (
            grpc.ssl_channel_credentials(ca[3]),
            grpc.ssl_channel_credentials(ca[3], stranger[2], stranger[3]),
            None,
        ):
            with pytest.raises(grpc.aio.AioRpcError) as refused:
                await world.peer(credentials=credentials)
            assert refused.value.code() == grpc.StatusCode.UNAVAILABLE
        assert world.count("connections_total") == 1


async def test_without_a_client_ca_the_service_alone_is_proved(tools, toy, serving, authority, tmp_path):
    ca, _, _ = authority
    async with serving(toy, tls=load(tmp_path, client_ca=None)) as world:
        peer = await world.peer(tools.State(a="1"), grpc.ssl_channel_credentials(ca[3]))
        assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"


def shown(address, ca, peer, directory):
    """Common name of the certificate that the service shows to a peer that connects now."""
    context = ssl.create_default_context(cadata=ca[3].decode())
    context.check_hostname = False
    (directory / "peer.pem").write_bytes(peer[2] + peer[3])
    context.load_cert_chain(directory / "peer.pem")
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port)), 10) as plain, context.wrap_socket(plain) as connection:
        return dict(pair[0] for pair in connection.getpeercert()["subject"])["commonName"]


async def test_a_renewed_certificate_is_taken_without_a_restart(tools, toy, serving, authority, tmp_path, caplog):
    ca, peer, _ = authority
    caplog.set_level("INFO")
    async with serving(toy, tls=load(tmp_path)) as world:
        credentials = grpc.ssl_channel_credentials(ca[3], peer[2], peer[3])
        before = await world.peer(tools.State(a="1"), credentials)
        renewed = tools.key_and_certificate("renewed", ca)
        (tmp_path / "server.pem").write_bytes(renewed[3])
        # The key is not there yet: the former pair goes on.
        assert await asyncio.to_thread(shown, world.server.address, ca, peer, tmp_path) == "service"
        assert "does not belong to the certificate" in caplog.text
        (tmp_path / "server.key").write_bytes(renewed[2])
        assert await asyncio.to_thread(shown, world.server.address, ca, peer, tmp_path) == "renewed"
        assert "new TLS certificate" in caplog.text
        (tmp_path / "server.key").unlink()
        assert await asyncio.to_thread(shown, world.server.address, ca, peer, tmp_path) == "renewed"
        assert (await before.run(tools.Call("get", ("a",)))).payload == b"1"
        after = await world.peer(tools.State(a="2"), credentials)
        assert (await after.run(tools.Call("get", ("a",)))).payload == b"2"


def test_tls_files_that_cannot_serve_are_named(tools, authority, tmp_path):
    now = dt.datetime.now(dt.UTC)
    (tmp_path / "garbage").write_bytes(b"-----BEGIN nothing")
    (tmp_path / "encrypted").write_bytes(
        b"-----BEGIN ENCRYPTED PRIVATE KEY-----\nAA==\n-----END ENCRYPTED PRIVATE KEY-----\n"
    )
    for change, said in (
        ({"certificate": "missing"}, "TLS certificate: cannot read"),
        ({"certificate": "garbage"}, "holds no PEM certificate"),
        ({"client_ca": "garbage"}, "holds no PEM certificate"),
        ({"key": "garbage"}, "is no PEM key without a password"),
        ({"key": "encrypted"}, "is no PEM key without a password"),
        ({"key": "other.key"}, "does not belong to the certificate"),
        ({"now": now + dt.timedelta(days=60)}, "renew it, or set this machine's clock"),
        ({"now": now - dt.timedelta(days=60)}, "renew it, or set this machine's clock"),
    ):
        with pytest.raises(SettingsError, match=said):
            load(tmp_path, **change)


def test_the_shim_offers_what_this_service_reads():
    """The fields by their numbers, as Fabric's peer sends them (``ChaincodeAdditionalParams``)."""
    offered = chaincode_pb2.ChaincodeAdditionalParams.FromString(b"\x08\x01\x10\xe8\x07\x18\x01 \xe8\x07")
    assert (offered.use_write_batch, offered.max_size_write_batch) == (True, 1000)
