"""The wire of ROS 1 among strangers: masters that hang or lie, publishers and subscribers that keep to nothing."""

from __future__ import annotations

import asyncio
import contextlib
import xmlrpc.client

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wonderland_ros_bridge.errors import WireError
from wonderland_ros_bridge.ros1 import definitions, tcpros, xml_rpc
from wonderland_ros_bridge.ros1 import node as node_module
from wonderland_ros_bridge.ros1.hosts import Hosts
from wonderland_ros_bridge.ros1.node import Node

STRING = definitions.parse("std_msgs/String", "string data\n")
HELLO = b"\x05\x00\x00\x00hello"


async def until(condition):
    async with asyncio.timeout(10):
        while not condition():
            await asyncio.sleep(0.005)


@contextlib.asynccontextmanager
async def answering(answer):
    """Something at a port that answers each connection's first bytes with bytes, or with nothing for ever."""

    async def serve(reader, writer):
        with contextlib.closing(writer), contextlib.suppress(OSError, asyncio.IncompleteReadError):
            await reader.read(65_536)
            if answer is None:
                await asyncio.Event().wait()
            writer.write(answer)
            await writer.drain()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    server.close()


def http(body, status="200 OK", length=None):
    return f"HTTP/1.0 {status}\r\nContent-Length: {len(body) if length is None else length}\r\n\r\n".encode() + body


BOMB = b"""<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<methodResponse><params><param><value>&b;</value></param></params></methodResponse>"""
OUTSIDE = b"""<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a SYSTEM "file:///etc/passwd">]><methodResponse/>"""


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (None, "no answer within 0.3 s"),
        (b"", "read on a total of"),
        (b"\x00" * 100_000, "Separator is not found|limit"),
        (http(b"", status="500 Down"), "answered 'HTTP/1.0 500 Down'"),
        (http(b"<not xml"), "no XML-RPC"),
        (http(BOMB), "document type"),
        (http(OUTSIDE), "document type"),
        (http(b"<!DOCTYPE methodResponse><methodResponse/>"), "document type"),
        (http(b"", length=1 << 30), "a body of 1073741824 bytes"),
        (http(b"", length="12z"), "a body of 12z bytes"),
        (http(b"<a/>", length=400), "read on a total of"),
        (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n", "chunks"),
        (b"HTTP/1.0 200 OK\r\n\r\n" + b"<a>" * 2_000_000, "more than 4194304 bytes"),
        (http(xmlrpc.client.dumps((3,), methodresponse=True).encode()), "not \\[code, text, value\\]"),
        (http(xmlrpc.client.dumps(([0, "no", 0],), methodresponse=True).encode()), "refused: no"),
        (http(xmlrpc.client.dumps(xmlrpc.client.Fault(1, "broken")).encode()), "fault: broken"),
        (http(b"<methodResponse><params>" + b"<param><value><array><data>" * 50_000), "no XML-RPC"),
    ],
    ids=["hangs", "hangs up", "zeros", "500", "no XML", "bomb", "file", "doctype", "says 1 GiB", "no number", "half", "chunks",
         "endless", "no triple", "refusal", "fault", "deep"],
)  # fmt: skip
async def test_an_answer_that_is_none_is_one_clear_error(answer, says):
    async with answering(answer) as uri:
        with pytest.raises(WireError, match=says):
            await xml_rpc.call(Hosts(), uri, "getPid", "/x", wait_s=0.3 if answer is None else 5)


@pytest.mark.parametrize(
    "uri",
    [
        "",
        "http://",
        "ftp://127.0.0.1:1/",
        "http://127.0.0.1:99999/",
        "http://[::1/",
        f"http://{'a' * 70}.b:1/",
        "http://a\0b:1/",
        "x" * 50,
    ],
)
async def test_an_address_that_is_none_is_refused(uri):
    with pytest.raises(WireError):
        await xml_rpc.call(Hosts(), uri, "getPid", "/x")


@pytest.mark.parametrize("host", ["192.0.2.7", "10.0.0.1", "0.0.0.0", "::ffff:10.0.0.1", "169.254.169.254"])
async def test_other_machines_are_not_even_asked(host):
    with pytest.raises(WireError, match="outside the networks"):
        await Hosts().connect(host, 80)
    assert not Hosts().allows(host)
    assert Hosts().allows("::ffff:127.0.0.1")
    assert Hosts(["192.0.2.0/24"]).allows("192.0.2.7")


class World:
    """A master that is played, and a publisher of /t that is played."""

    def __init__(self, node, publisher_uri):
        self.node = node
        self.publisher_uri = publisher_uri
        self.taken = []
        self.calls = []

    async def take(self, arrived):
        self.taken.append(arrived.data)

    def handle(self, method, parameters):
        self.calls.append(method)
        answers = {"registerSubscriber": [self.publisher_uri], "registerPublisher": [], "lookupNode": self.node.uri}
        return 1, "", answers.get(method, 0)


@contextlib.asynccontextmanager
async def world(publish, *, max_message_bytes=1_000, master_says=None):
    """A node that subscribes to /t; ``publish(reader, writer)`` is what its publisher does once it is connected."""

    async def serve(reader, writer):
        with contextlib.closing(writer), contextlib.suppress(OSError, EOFError, WireError):
            await publish(reader, writer)

    data = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = data.sockets[0].getsockname()[1]
    api = xml_rpc.Server(Hosts(), lambda *_: (1, "", master_says or ["TCPROS", "127.0.0.1", port]))
    await api.start("127.0.0.1")
    master = xml_rpc.Server(Hosts(), lambda *call: made.handle(*call))  # noqa: PLW0108 - a test puts another there
    await master.start("127.0.0.1")
    node = Node("/bridge", f"http://127.0.0.1:{master.port}")
    made = World(node, f"http://127.0.0.1:{api.port}/")
    async with node:
        running = asyncio.create_task(node.run())
        await node.subscribe("/t", made.take, max_message_bytes=max_message_bytes)
        yield made
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    data.close()
    await api.close()
    await master.close()


def fields(**changed):
    found = {"type": "std_msgs/String", "md5sum": STRING.md5, "message_definition": STRING.text, "callerid": "/p"}
    return {name: value for name, value in (found | changed).items() if value is not None}


def says(header=None, then=b"", *, stay=False):
    async def publish(reader, writer):
        asked = await tcpros.read_header(reader)
        assert (asked["md5sum"], asked["topic"]) == ("*", "/t")
        writer.write((tcpros.header(fields()) if header is None else header) + then)
        await writer.drain()
        if stay:
            await asyncio.Event().wait()

    return publish


@pytest.mark.parametrize(
    ("publish", "trouble"),
    [
        (says(tcpros.header(fields(md5sum="0" * 32))), "one of them is wrong"),
        (says(tcpros.header(fields(message_definition="int8 x\n"))), "one of them is wrong"),
        (says(tcpros.header(fields(type="my_msgs/Own", message_definition=None))), "does not say its definition"),
        (says(tcpros.header(fields(type="*"))), "no package/Type"),
        (says(tcpros.header(fields(message_definition="rm -rf / x\n"))), "is no field"),
        (says(tcpros.header({"error": "go away"})), "refuses: go away"),
        (says(b"\xff\xff\xff\xff"), "a header of 4294967295 bytes"),
        (says(b"\x08\x00\x00\x00\xff\x00\x00\x00abcd"), "cut off in a field"),
        (says(b"\x06\x00\x00\x00\x02\x00\x00\x00ab"), "without a value"),
        (says(b"\x07\x00\x00\x00\x03\x00\x00\x00=\xff\xff"), "no UTF-8"),
        (says(b"\x10\x00"), "ended before its header"),
        (says(then=b"\x00\x00\x00\x06"), "a message of 100663296 bytes; max_message_bytes allows 1000"),
        (says(then=b"\x0a\x00\x00\x00half"), "ended within a message of 10 bytes"),
        (says(then=b"\x0a\x00"), "ended within a message's length"),
    ],
    ids=["md5", "definition", "unknown type", "type", "code", "refusal", "huge header", "cut field", "no value",
         "no UTF-8", "half header", "100 MB", "half message", "half length"],
)  # fmt: skip
async def test_a_publisher_that_keeps_to_nothing_is_named_and_not_believed(publish, trouble, caplog):
    async with world(publish) as made:
        subscription = made.node.subscriptions["/t"]
        await until(lambda: subscription.trouble)
        assert trouble in next(iter(subscription.trouble.values()))
        assert not made.taken
    assert trouble in caplog.text


@pytest.mark.parametrize(
    ("answer", "trouble"),
    [
        (["UDPROS", "127.0.0.1", 1], "does not offer TCPROS"),
        (["TCPROS", "127.0.0.1"], "does not offer TCPROS"),
        (["TCPROS", "127.0.0.1", -5], "does not offer TCPROS"),
        (["TCPROS", "192.0.2.1", 80], "outside the networks"),
    ],
)
async def test_a_publisher_that_sends_elsewhere_is_not_followed(answer, trouble):
    async with world(says(), master_says=answer) as made:
        subscription = made.node.subscriptions["/t"]
        await until(lambda: subscription.trouble)
        assert trouble in next(iter(subscription.trouble.values()))


async def test_a_header_or_a_message_that_does_not_come_ends_the_connection(monkeypatch):
    monkeypatch.setattr(tcpros, "HEADER_S", 0.1)
    monkeypatch.setattr(tcpros, "FRAME_S", 0.1)
    half = says(then=b"\x0a\x00\x00\x00h", stay=True)
    for publish, trouble in ((says(b"", stay=True), "no header within"), (half, "did not come within")):
        async with world(publish) as made:
            found = made.node.subscriptions["/t"].trouble
            await until(found.__len__)
            assert trouble in next(iter(found.values()))


async def test_messages_come_and_a_lost_publisher_is_heard_again():
    async with world(says(then=tcpros.frame(HELLO) * 3)) as made:
        await until(lambda: len(made.taken) >= 6)
        assert set(made.taken) == {HELLO}


async def test_what_is_not_taken_is_not_read():
    """Back-pressure: the publisher's writes stop when nobody takes, and all of it comes when somebody does."""
    written = 0
    frame = tcpros.frame(b"x" * 100_000)

    async def publish(reader, writer):
        nonlocal written
        await tcpros.read_header(reader)
        writer.write(tcpros.header(fields()))
        for _ in range(400):
            writer.write(frame)
            await writer.drain()
            written += 1
        await asyncio.Event().wait()

    go = asyncio.Event()
    async with world(publish, max_message_bytes=200_000) as made:
        taken = made.take

        async def slowly(arrived):
            await go.wait()
            await taken(arrived)

        made.node.subscriptions["/t"]._take = slowly
        seen = -1
        while seen != written or written == 0:
            seen = written
            await asyncio.sleep(0.2)
        assert written < 200, "40 MB do not fit into buffers of a few"
        go.set()
        await until(lambda: len(made.taken) == 400)


async def connect(publication_port, header):
    reader, writer = await asyncio.open_connection("127.0.0.1", publication_port)
    writer.write(header)
    return reader, writer


async def port_of(node):
    return (await xml_rpc.call(Hosts(), node.uri, "requestTopic", "/x", "/out", [["TCPROS"]]))[2]


async def test_subscribers_get_what_fits_and_others_a_reason():
    async with world(says()) as made:
        publication = await made.node.advertise("/out", STRING, latch=True)
        publication.publish(HELLO)
        port = await port_of(made.node)
        for wanted in ({"md5sum": "*", "type": "*"}, {"md5sum": STRING.md5, "type": STRING.type}):
            reader, writer = await connect(port, tcpros.header({"topic": "/out", "callerid": "/s", **wanted}))
            told = await tcpros.read_header(reader)
            assert told["message_definition"] == STRING.text
            assert await tcpros.read_message(reader, 100) == HELLO, "the last message, for who comes later"
            writer.close()
        for wanted, why in (
            ({"topic": "/out", "md5sum": "0" * 32}, "has md5sum"),
            ({"topic": "/out", "type": "a/B"}, "has type std_msgs/String"),
            ({"topic": "/other"}, "no publisher of '/other'"),
            ({"service": "/s"}, "no publisher"),
        ):
            reader, writer = await connect(port, tcpros.header(wanted))
            assert why in (await tcpros.read_header(reader))["error"]
            writer.close()
        for junk in (b"POST / HTTP/1.0\r\n\r\n", b"\xff" * 40, b"\x05\x00"):
            reader, writer = await connect(port, junk)
            writer.write_eof()
            assert await reader.read() == b""
            writer.close()
        with pytest.raises(WireError, match="cannot be a/B too"):
            await made.node.advertise("/out", definitions.parse("a/B", "int8 x\n"), latch=False)


async def test_a_subscriber_that_does_not_read_is_let_go(monkeypatch):
    from wonderland_ros_bridge.ros1 import publication as module

    monkeypatch.setattr(module, "MAX_BEHIND_BYTES", 1 << 20)
    async with world(says()) as made:
        publication = await made.node.advertise("/out", STRING, latch=False)
        _, writer = await connect(await port_of(made.node), tcpros.header({"topic": "/out"}))
        await publication.wait_for(1, 5)
        data = (1 << 19).to_bytes(4, "little") + b"x" * (1 << 19)
        for _ in range(64):
            publication.publish(data)
            await asyncio.sleep(0)
        assert publication.subscribers == 0
        writer.close()


@pytest.mark.parametrize(
    "request_bytes",
    [b"GET / HTTP/1.0\r\n\r\n", b"POST / HTTP/1.0\r\n\r\n", b"POST / HTTP/1.0\r\nContent-Length: 99999999\r\n\r\n",
     b"POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n%s" % (len(BOMB), BOMB), b"\x00" * 40_000, b""],
)  # fmt: skip
async def test_the_nodes_own_api_answers_only_calls(request_bytes):
    async with world(says()) as made:
        reader, writer = await connect(made.node._api.port, request_bytes)
        writer.write_eof()
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b""
        writer.close()
        assert await xml_rpc.call(Hosts(), made.node.uri, "getPid", "/x") > 0


async def test_methods_and_parameters_that_there_are_not_are_refused():
    async with world(says()) as made:
        for method, parameters in (("nothing", ()), ("requestTopic", ("/x",)), ("publisherUpdate", ("/m", "/t", "x"))):
            with pytest.raises(WireError, match="no method"):
                await xml_rpc.call(Hosts(), made.node.uri, method, *parameters)
        with pytest.raises(WireError, match="no publisher of /t"):
            await xml_rpc.call(Hosts(), made.node.uri, "requestTopic", "/x", "/t", [["TCPROS"]])
        await xml_rpc.call(Hosts(), made.node.uri, "publisherUpdate", "/m", "/t", [7, {"a": 1}, "http://192.0.2.1:1/"])
        subscription = made.node.subscriptions["/t"]
        await until(lambda: "http://192.0.2.1:1/" in subscription.trouble)


async def test_a_tool_of_ros_can_end_the_node():
    async with world(says()) as made:
        running = asyncio.create_task(made.node.run())
        await xml_rpc.call(Hosts(), made.node.uri, "shutdown", "/rosnode", "user request")
        with pytest.raises(Exception, match=r"/rosnode ended this node \(user request\)"):
            await asyncio.wait_for(running, 5)


async def test_a_master_that_knows_the_node_no_more_is_told_again(monkeypatch):
    monkeypatch.setattr(node_module, "LOOK_S", 0.02)
    async with world(says(stay=True)) as made:
        await until(lambda: made.calls.count("registerSubscriber") == 1)
        answer = made.handle
        made.handle = lambda method, parameters: (
            (-1, "unknown node", 0) if method == "lookupNode" else answer(method, parameters)
        )
        await until(lambda: made.calls.count("registerSubscriber") >= 3)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_header_or_refused(data):
    with contextlib.suppress(WireError):
        found = tcpros.parse_header(data)
        assert tcpros.parse_header(tcpros.header(found)[4:]) == found


@given(st.binary(max_size=300), st.sampled_from([b"", b"<methodResponse>", b"<methodCall><methodName>a</methodName>"]))
def test_any_bytes_are_xml_rpc_or_refused(data, before):
    with contextlib.suppress(WireError):
        xml_rpc._unmarshal(before + data)


async def test_names_that_ros_does_not_allow_are_not_taken_from_a_master():
    said = [["/a/b_1", "x/Y"], ["/a\nb", "x/Y"], ["a", "x/Y"], ["/", "x/Y"], ["/a//b", "x/Y"], ["/" + "a" * 300, "x/Y"],
            ["/1", "x/Y"], "no pair", ["/a", 7], ["/a"]]  # fmt: skip
    assert node_module._topics(said) == [("/a/b_1", "x/Y")]
    assert node_module._topics("none") == []
