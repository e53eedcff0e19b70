"""The wire of ROS 2: names, hashes and frames against other implementations; and peers that keep to nothing."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import socket

import pytest
import trustme
from hypothesis import given
from hypothesis import strategies as st
from kit.ros2 import SdkPeer, free_port, parts_of, router
from rosbags.typesys import Stores, get_typestore

from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.definitions import Codec, parse
from wonderland_rmw_zenoh.errors import CallError, DefinitionError, Ros2Error, SessionError, WireError
from wonderland_rmw_zenoh.interfaces import Interfaces, of_text
from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.session import Link, Tls, open_session
from wonderland_rmw_zenoh.wire import Attachment, Endpoint, Qos

TYPES = Interfaces()
STRING = TYPES.message("std_msgs/msg/String")
STORE = get_typestore(Stores.ROS2_JAZZY)
WITH_CHAR = {  # rosbags hashes a char of a .msg file as IDL's char; rosidl makes it a uint8
    "rmw_dds_common/msg/Gid",
    "rmw_dds_common/msg/NodeEntitiesInfo",
    "rmw_dds_common/msg/ParticipantEntitiesInfo",
    "service_msgs/msg/ServiceEventInfo",
    "std_msgs/msg/Char",
}
names = st.from_regex(wire._NAME, fullmatch=True).filter(wire.is_name)


@pytest.mark.parametrize("kind", sorted(STORE.fielddefs.keys() - WITH_CHAR))
def test_hashes_are_those_of_another_implementation(kind):
    assert TYPES.message(kind).hash == STORE.hash_rihs01(kind)


@pytest.mark.parametrize(
    ("kind", "known"),
    [
        ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Char", "3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9"),
    ],
)
def test_hashes_are_those_that_ros_prints(kind, known):
    assert TYPES.message(kind).hash == f"RIHS01_{known}"


def test_the_hash_of_a_service_is_the_one_in_rmw_zenohs_own_documentation(tmp_path):
    directory = tmp_path / "share" / "example_interfaces" / "srv"
    directory.mkdir(parents=True)
    (directory / "AddTwoInts.srv").write_text("int64 a\nint64 b\n---\nint64 sum\n")
    found = Interfaces([tmp_path]).service("example_interfaces/srv/AddTwoInts")
    assert found.hash == "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"


def test_tokens_are_those_of_rmw_zenohs_own_documentation():
    hashed = f"RIHS01_{'e1' * 32}"
    token = f"@ros2_lv/2/f9980ee0/0/10/SS/%/%/server/%add_two_ints/a_b::srv::dds_::AddTwoInts_/{hashed}/::,10:,:,:,,"
    found = wire.parse_token(token)
    assert (found.node, found.name, found.type) == ("/server", "/add_two_ints", "a_b/srv/AddTwoInts")
    assert found.token() == token


@given(
    node=names,
    name=names,
    kind=st.sampled_from(("MP", "MS", "SS", "SC")),
    qos=st.builds(Qos, st.booleans(), st.booleans(), st.integers(0, 10_000)),
)
def test_tokens_come_back_as_they_went(node, name, kind, qos):
    made = Endpoint(7, "abc", 1, 2, kind, node, name, "a/msg/B", f"RIHS01_{'0' * 64}", qos)
    assert wire.parse_token(made.token()) == made


@given(st.text(max_size=200) | st.from_regex(r"@ros2_lv/.{0,40}/.{0,9}/.{0,9}/.{0,9}/(NN|MP)/.{0,9}/.{0,9}/.{0,9}"))
def test_any_text_is_a_token_or_refused(text):
    with contextlib.suppress(WireError):
        wire.parse_token(text)


@given(st.none() | st.binary(max_size=80))
def test_any_bytes_are_an_attachment_or_refused(data):
    try:
        assert wire.parse_attachment(data).encode() == data
    except WireError as error:
        assert "rmw_zenoh" in str(error)  # noqa: PT017


@given(st.binary(max_size=60))
def test_any_bytes_are_a_message_or_refused(data):
    for kind in ("std_msgs/msg/String", "tf2_msgs/msg/TFMessage", "std_msgs/msg/Empty", "sensor_msgs/msg/Image"):
        with contextlib.suppress(DefinitionError):
            TYPES.message(kind).codec.decode(data)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a/B x\n", "nobody here says"),
        (f"a/Loop x\n{'=' * 80}\nMSG: a/Loop\na/Loop y\n", "part of itself"),
        ("int8[70000] x\n", "more than"),
        ("string[2000] x\n", "more than"),
        ("int8 x\nint8 x\n", "one name"),
        ("int8 import os\n" * 2, "one name"),
        ("import os; print(1)\n", "no field"),
        ("wstring x\n", "not read here"),
        ("int8 x\n" * 3_000, "one name"),
        ("".join(f"int8 x{index}\n" for index in range(3_000)), "fields"),
        ("x" * 200_000, "characters"),
        ("int8<=5 x\n", "only a string"),
    ],
)
def test_definitions_that_cannot_be_used_say_why(text, says):
    with pytest.raises(DefinitionError, match=says):
        Codec(parse("a/msg/Loop" if "Loop" in text else "a/msg/T", text))


def test_a_bomb_of_nothings_fills_no_memory():
    """Four bytes that announce thousands of millions of elements."""
    codec = of_text("a/msg/T", *_hashed("a/msg/T", f"a/E[] x\n{'=' * 80}\nMSG: a/E\n")).codec
    with pytest.raises(DefinitionError):
        codec.decode(bytes.fromhex("00010000ffffffff"))


def _hashed(kind, text):
    from wonderland_rmw_zenoh.type_hash import type_hash

    return type_hash(parse(kind, text)), text


def test_a_definition_with_another_hash_is_refused():
    with pytest.raises(DefinitionError, match="one of them is wrong"):
        of_text("std_msgs/msg/String", f"RIHS01_{'0' * 64}", "string data\n")
    with pytest.raises(DefinitionError, match="those known here have"):
        TYPES.of_hash("std_msgs/msg/String", f"RIHS01_{'0' * 64}")
    with pytest.raises(DefinitionError, match=r"name the directory of its \.msg file"):
        TYPES.of_hash("px4_msgs/msg/NoSuch", f"RIHS01_{'0' * 64}")


@pytest.mark.parametrize(
    ("link", "says"),
    [
        (Link(connect=("tcp/192.168.7.1:7447",)), "another machine's"),
        (Link(listen=("tcp/0.0.0.0:7447",)), "another machine's"),
        (Link(listen=("tcp/[::]:7447",)), "another machine's"),
        (Link(connect=("tls/pad.example:7447",)), "needs certificates"),
        (Link(connect=("tcp/127.0.0.1:70000",)), "no address"),
        (Link(connect=("udp/127.0.0.1:7447",)), "no address"),
        (Link(connect=("tcp/127.0.0.1:1?iface=eth0",)), "no address"),
    ],
)
def test_ways_that_others_could_use_are_refused(link, says):
    with pytest.raises(SessionError, match=re.escape(says)):
        open_session(link)


async def until(condition, limit_s=10.0):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.02)


async def test_messages_and_calls_go_both_ways_with_a_peer_that_is_none_of_ours():
    text = TYPES.message("sensor_msgs/msg/NavSatFix")
    async with router() as where, SdkPeer.at(where) as peer, Node("/ours", where.link) as ours:
        heard = []

        async def take(arrived):
            heard.append(TYPES.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data))

        ours.subscribe("/chatter", take, kind=STRING, depth=100)  # more than is said: a busy machine hears them at once
        await peer.asked("advertise", topic="/chatter", **parts_of("std_msgs/msg/String"))
        assert await ours.wait_for("MP", "/chatter", 5) is not None
        async with asyncio.timeout(15):
            while not heard:  # what is said before two sessions are linked is lost, as ever in ROS
                await peer.asked("publish", topic="/chatter", message={"data": "is anybody there"})
        for index in range(20):
            await peer.asked("publish", topic="/chatter", message={"data": f"{index} ä"})
        await until(lambda: heard[-1].data == "19 ä")
        said = [each.data for each in heard if each.data != "is anybody there"]
        assert said == [f"{index} ä" for index in range(20)]
        await peer.asked("subscribe", topic="/fix", **parts_of("sensor_msgs/msg/NavSatFix"))
        fix = ours.advertise("/fix", text)
        assert await ours.wait_for("MS", "/fix", 5) is not None
        await asyncio.sleep(1.0)
        await fix.publish({"latitude": 60.45, "position_covariance": [0.25, *[0.0] * 8], "header": {"frame_id": "gps"}})
        found = await peer.heard("/fix")
        assert (found["latitude"], found["position_covariance"][0], found["header"]["frame_id"]) == (60.45, 0.25, "gps")


def raw(session, key, payload, attachment):
    session.put(key, payload, attachment=attachment, encoding="application/cdr")


async def test_peers_that_keep_to_nothing_are_named_and_others_go_on(caplog):
    good = Attachment(1, 2, b"g" * 16).encode()
    key = wire.data_key(0, "/chatter", STRING.name, STRING.hash)
    async with router() as where, Node("/ours", where.link) as ours, Node("/other", where.link) as other:
        heard = []

        async def take(arrived):
            kind = TYPES.of_hash(arrived.type, arrived.type_hash)
            heard.append(kind.codec.decode(arrived.data).data)

        made = ours.subscribe("/chatter", take, max_message_bytes=1_000, history=False)
        await asyncio.sleep(0.5)
        session = other.session
        payload = STRING.codec.encode({"data": "good"})
        raw(session, key, payload, None)
        raw(session, key, payload, b"\0" * 33)
        raw(session, key, payload, b"x" * 77)
        raw(session, key, b"", good)
        raw(session, key, b"\x00\x01\x00\x00\xff\xff\xff\xff", good)
        raw(session, key, b"\x00\x01" + b"x" * 2_000, good)
        raw(session, f"{key[:-64]}{'0' * 64}", payload, good)
        raw(session, "0/chatter/a_b::msg::dds_::Unknown_/RIHS01_x", payload, good)
        raw(session, "0/chatter/no type/RIHS01_x", payload, good)
        session.delete(key)
        for _ in range(2):  # two publishers that say they are one
            raw(session, key, payload, good)
        await until(lambda: len(heard) == 2)
        assert heard == ["good", "good"]
        assert sum(made.refused.values()) == 10
        told = "\n".join(each.getMessage() for each in caplog.records if "/chatter" in each.getMessage())
        for words in ("attachment", "type hash", "no type of ROS 2", "nobody here says", "more than 1000", "deletion"):
            assert words in told, words


async def test_a_hundred_megabytes_are_not_taken_and_the_next_message_is():
    async with router() as where, Node("/ours", where.link) as ours, Node("/other", where.link) as other:
        heard = []

        async def take(arrived):
            heard.append(len(arrived.data))

        ours.subscribe("/image", take, max_message_bytes=1 << 20, history=False)
        await asyncio.sleep(0.5)
        sends = other.advertise("/image", TYPES.message("sensor_msgs/msg/Image"))
        await sends.publish_bytes(b"\x00\x01\x00\x00" + bytes(100_000_000))
        await asyncio.sleep(0.5)
        async with asyncio.timeout(20):
            while not heard:
                await sends.publish_bytes(b"\x00\x01\x00\x00" + bytes(1_000))
                await asyncio.sleep(0.1)
        assert set(heard) == {1_004}


async def test_a_flood_is_bounded_and_what_is_left_out_is_counted():
    async with router() as where, Node("/ours", where.link) as ours, Node("/other", where.link) as other:
        heard, free = [], asyncio.Event()

        async def take(arrived):
            heard.append((arrived.attachment.seq, arrived.lost))
            await free.wait()

        ours.subscribe("/flood", take, depth=10, history=False)
        sends = other.advertise("/flood", STRING)
        await asyncio.sleep(0.5)
        for _ in range(5_000):
            await sends.publish({"data": "x" * 100})
        await asyncio.sleep(0.5)
        free.set()
        await until(lambda: heard[-1][0] == 5_000)
        assert len(heard) == 11
        assert sum(lost for _, lost in heard) == 5_000 - 11


async def test_a_call_that_cannot_be_answered_has_a_reason(caplog):
    kind = TYPES.service("rcl_interfaces/srv/ListParameters")

    async def fails(_):
        raise ValueError("inside")

    async with router() as where, Node("/ours", where.link) as ours, Node("/other", where.link) as other:
        ours.serve("/bad", kind, fails)
        await other.wait_for("SS", "/bad", 5)
        with pytest.raises(CallError, match="see its log"):
            await other.call("/bad", kind, {})
        with pytest.raises(CallError, match="is it there"):
            await other.call("/nowhere", kind, {}, wait_s=0.5)
        key = wire.data_key(0, "/bad", kind.name, kind.hash)
        for payload, beside in ((b"", b"x"), (None, None), (b"x", Attachment(1, 1, b"g" * 16).encode())):
            answers = await asyncio.to_thread(
                lambda p=payload, b=beside: list(other.session.get(key, payload=p, attachment=b))
            )
            assert [each.err is not None for each in answers] == [True]
        assert "inside" in caplog.text


class Certificates:
    def __init__(self, directory):
        self._directory = directory
        self.ca = trustme.CA()
        self.ca_file = directory / "ca.pem"
        self.ca.cert_pem.write_to_path(self.ca_file)

    def of(self, name, *, ca=None, names=()):
        made = (ca or self.ca).issue_cert("127.0.0.1", common_name=name)
        key, certificate = self._directory / f"{name}.key", self._directory / f"{name}.pem"
        made.private_key_pem.write_to_path(key)
        certificate.write_bytes(b"".join(each.bytes() for each in made.cert_chain_pems))
        return Tls(self.ca_file, certificate, key, names)


async def test_only_holders_of_certificates_are_heard_and_only_those_named(tmp_path):
    made = Certificates(tmp_path)
    port = free_port()
    at = f"tls/127.0.0.1:{port}"
    pad = Link(connect=(), listen=(at,), tls=made.of("pad", names=("friend",)))
    none = "tls/127.0.0.1:0"
    friend = Link(connect=(at,), listen=(none,), tls=made.of("friend"))
    stranger = Link(connect=(at,), listen=(none,), tls=made.of("stranger"))
    forger = Link(connect=(at,), listen=(none,), tls=made.of("forger", ca=trustme.CA()))
    async with Node("/pad", pad) as ours:
        heard = []

        async def take(arrived):
            heard.append(STRING.codec.decode(arrived.data).data)

        ours.subscribe("/say", take)
        for name, link in (("stranger", stranger), ("forger", forger), ("friend", friend)):
            async with Node(f"/{name}", link) as node:
                says = node.advertise("/say", STRING)
                for _ in range(5):
                    await says.publish({"data": name})
                    await asyncio.sleep(0.2)
        with socket.create_connection(("127.0.0.1", port), timeout=2) as bare:  # a peer without a certificate
            bare.sendall(b"\x0b\x00\x01\x08" + bytes(60))
            bare.settimeout(2)
            assert not bare.recv(100).startswith(b"\x0b")
        assert set(heard) == {"friend"}


async def test_nothing_is_heard_from_other_machines_without_certificates():
    """A peer whose address is not loopback is brought in by the router: it is linked, and nothing of it is heard."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has no address but loopback")
        address = probe.getsockname()[0]
    import zenoh

    config = zenoh.Config()
    outside = f"tcp/{address}:{free_port()}"
    async with router() as where, Node("/ours", Link((where.endpoint,), listen=())) as ours:
        for name, value in {
            "mode": "peer",
            "listen/endpoints": [outside],
            "connect/endpoints": [where.endpoint],
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(name, json.dumps(value))
        heard = []

        async def take(arrived):
            heard.append(arrived)

        ours.subscribe("/say", take)
        session = await asyncio.to_thread(zenoh.open, config)
        try:
            await asyncio.sleep(1.5)
            await where.stop()
            await asyncio.sleep(0.5)
            links = [(str(link.src), str(link.dst), link.interfaces) for link in ours.session.info.links()]
            linked = any(address in str(link.dst) or address in str(link.src) for link in ours.session.info.links())
            key = wire.data_key(0, "/say", STRING.name, STRING.hash)
            raw(session, key, STRING.codec.encode({"data": "x"}), Attachment(1, 1, b"g" * 16).encode())
            await asyncio.sleep(0.5)
        finally:
            await asyncio.to_thread(session.close)
        assert all(each[2] != ["lo"] for each in links)
        assert linked
        assert heard == [], "what comes by another interface is not heard"


def test_errors_are_of_one_family():
    assert all(issubclass(each, Ros2Error) for each in (WireError, DefinitionError, SessionError, CallError))
