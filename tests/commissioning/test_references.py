"""Live references: a motion capture's packets and server, a topic of ROS 2; and whoever else sends there."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import struct
import sys
import textwrap
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.ros2 import SdkPeer, parts_of, router

from wonderland_edge_agent.references import PositionError, SourceError, natnet, sources
from wonderland_edge_agent.references.natnet import Body, Server
from wonderland_edge_agent.references.sources import NatNetSource, Ros2Source, UdpSource, parse_source

ONE = (1.0, 0.5, -2.0)
"""As Motive has it: y points up."""
HERE = pytest.approx((1.0, 2.0, 0.5))
VERSIONS = [(2, 7), (3, 0), (3, 1), (4, 1), (4, 2)]


def frame(version, *bodies, sets=1, loose=2):
    """A frame as the SDK lays it out: marker sets, other markers, rigid bodies, and what is not read."""
    sized = version >= (4, 1)

    def listed(entries):
        data = b"".join(entries)
        return struct.pack("<I", len(entries)) + (struct.pack("<I", len(data)) if sized else b"") + data

    def body(number, point, tracked):
        data = struct.pack("<I3f4f", number, *point, 0, 0, 0, 1)
        if version < (3, 0):
            data += struct.pack("<I", 2) + bytes(2 * 12 + 2 * 4 + 2 * 4)
        return data + struct.pack("<fH", 0.001, tracked)

    marker = struct.pack("<3f", 1, 2, 3)
    content = struct.pack("<I", 7)
    content += listed([b"drone\0" + struct.pack("<I", 3) + marker * 3] * sets)
    content += listed([marker] * loose)
    content += listed([body(*each) for each in bodies])
    content += bytes(60)
    return struct.pack("<HH", 7, len(content)) + content


def info(version, group=None, freq=10_000_000):
    data = b"Motive".ljust(256, b"\0") + bytes([3, 1, 0, 0]) + bytes([*version, 0, 0])
    if version >= (3, 0):
        data += struct.pack("<QH?", freq, group[1] if group else 1511, group is not None)
        data += socket.inet_aton(group[0] if group else "0.0.0.0")
    return struct.pack("<HH", 1, len(data)) + data


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_rigid_bodies_of_a_frame(version):
    found = natnet.bodies(frame(version, (3, ONE, 1), (4, (9, 9, 9), 0), (5, (float("nan"), 0, 0), 1)), version)
    assert found == (Body(3, HERE), Body(4, None), Body(5, None))
    assert natnet.bodies(frame(version, sets=0, loose=0), version) == ()
    assert natnet.bodies(info(version), version) is None


def test_what_a_server_says_of_itself():
    assert natnet.server_info(info((3, 1), ("239.255.42.99", 1511))) == Server((3, 1), ("239.255.42.99", 1511))
    assert natnet.server_info(info((4, 1))) == Server((4, 1), None)
    assert natnet.server_info(info((2, 7))) == Server((2, 7), None)
    assert natnet.server_info(frame((3, 0))) is None
    with pytest.raises(PositionError, match="too old"):
        natnet.server_info(info((2, 5)))
    with pytest.raises(PositionError, match=r"192\.0\.2\.1"):
        natnet.server_info(info((3, 1), ("192.0.2.1", 1511)))


@given(st.binary(max_size=400), st.sampled_from(VERSIONS), st.sampled_from([1, 7]))
def test_any_bytes_are_refused_or_read_at_once(data, version, kind):
    for packet in (data, struct.pack("<HH", kind, len(data)) + data):
        with contextlib.suppress(PositionError):
            natnet.bodies(packet, version)
        with contextlib.suppress(PositionError):
            natnet.server_info(packet)


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_a_frame_cut_anywhere_is_refused_and_a_count_of_billions_costs_nothing(version):
    whole = frame(version, (3, ONE, 1))
    for end in range(len(whole)):
        with pytest.raises(PositionError):
            natnet.bodies(whole[:end], version)
    for at in range(4, len(whole) - 64, 4):
        lying = whole[:at] + b"\xff\xff\xff\xff" + whole[at + 4 :]
        began = time.monotonic()
        with contextlib.suppress(PositionError):
            natnet.bodies(lying, version)
        assert time.monotonic() - began < 1.0


CAPTURED = os.environ.get("NATNET_DIR", "")
with_natnet = pytest.mark.skipif(
    not CAPTURED, reason="NATNET_DIR names no directory: clone mje-nz/python_natnet there (its packets, its server)"
)


@with_natnet
@pytest.mark.parametrize("name", ["mocapframe_packet_v3", "mocapframe_packet_occluded_v3"])
def test_packets_of_a_real_motive_are_read_as_another_implementation_reads_them(name, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(CAPTURED) / "src"))
    protocol = pytest.importorskip("natnet").protocol
    packet = (Path(CAPTURED) / "test_data" / f"{name}.bin").read_bytes()
    theirs = protocol.deserialize(packet, protocol.Version(3)).rigid_bodies
    assert theirs
    for ours, their in zip(natnet.bodies(packet, (3, 0)), theirs, strict=True):
        x, y, z = their.position
        assert (ours.body_id, ours.point) == (their.id_, (x, -z, y))


class Recorder:
    def __init__(self):
        self.points = []

    def reference(self, t_s, point):
        self.points.append((t_s, point))


def clock():
    return time.time_ns() // 1_000_000


async def until(condition, limit_s=10):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.02)


class Motive(asyncio.DatagramProtocol):
    """Answers who connects, and streams to him, or to a group."""

    def __init__(self, version=(3, 1), group=None):
        self.version, self.group = version, group
        self.client = None
        self.alive = 0
        self.frames = ((3, ONE, 1),)

    def connection_made(self, transport):
        self.transport = transport
        self.port = transport.get_extra_info("sockname")[1]
        ours = transport.get_extra_info("socket")
        ours.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))

    def datagram_received(self, data, addr):
        if data[:2] == b"\0\0":
            self.client = addr
            self.transport.sendto(info(self.version, self.group), addr)
        elif data[:2] == b"\x0a\0":
            self.alive += 1

    def send(self):
        self.transport.sendto(frame(self.version, *self.frames), self.group or self.client)


@contextlib.asynccontextmanager
async def motive(**more):
    loop = asyncio.get_running_loop()
    transport, made = await loop.create_datagram_endpoint(lambda: Motive(**more), local_addr=("127.0.0.1", 0))
    try:
        yield made
    finally:
        transport.close()


@pytest.mark.parametrize("group", [None, ("239.255.42.99", 0)], ids=["unicast", "multicast"])
async def test_positions_of_a_rigid_body_arrive(group):
    if group is not None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            group = (group[0], probe.getsockname()[1])
    recorder = Recorder()
    async with motive(group=group) as server:
        async with NatNetSource("127.0.0.1", server.port).open(None, recorder, clock) as live:
            server.send()
            await until(lambda: recorder.points)
            t_s, point = recorder.points[0]
            assert point == HERE
            assert abs(t_s - time.time()) < 5
            await until(lambda: server.alive or group)
            # Which one, where there are two; one that is lost; and the one that is wanted.
            server.frames = ((3, ONE, 1), (4, ONE, 1))
            server.send()
            await until(lambda: "3, 4" in live.problem)
            server.frames = ((3, ONE, 0),)
            server.send()
            await until(lambda: "not tracked" in live.problem)
        recorder.points.clear()
        async with NatNetSource("127.0.0.1", server.port, 4).open(None, recorder, clock):
            server.frames = ((3, (9, 9, 9), 1), (4, ONE, 1))
            server.send()
            await until(lambda: recorder.points)
            assert recorder.points[0][1] == HERE


async def test_whoever_else_sends_there_is_not_the_motion_capture():
    recorder = Recorder()
    async with motive() as server, NatNetSource("127.0.0.1", server.port).open(None, recorder, clock) as live:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as liar:
            liar.bind(("127.0.0.2", 0))
            liar.sendto(frame((3, 1), (3, (50, 50, 50), 1)), server.client)
            liar.sendto(b"\x07", server.client)
        server.transport.sendto(b"\x07\0\xff\xff", server.client)
        await until(lambda: live.bad)
        assert "cut off" in live.problem
        server.send()
        await until(lambda: recorder.points)
        assert [point for _, point in recorder.points] == [HERE]
        assert (live.bad, live.problem) == (1, "")


async def test_where_no_server_answers_it_says_so(monkeypatch):
    monkeypatch.setattr(sources, "ANSWER_S", 0.3)
    with pytest.raises(SourceError, match="does Motive stream"):
        async with NatNetSource("127.0.0.1", 9).open(None, Recorder(), clock):
            pass
    with pytest.raises(SourceError, match=r"nowhere\.invalid is not known"):
        async with NatNetSource("nowhere.invalid").open(None, Recorder(), clock):
            pass


SERVER = """
import socket, sys, timeit
sys.path.insert(0, sys.argv[1])
from natnet import Server, protocol
from natnet.Server import ServerConnection
from natnet.protocol import MocapFrameMessage
from natnet.protocol.MocapFrameMessage import RigidBody, TimingInfo

def listen(cls, command_port=1510, inner=ServerConnection.listen.__func__):
    made = inner(cls, int(sys.argv[2]))
    made._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    return made

ServerConnection.listen = classmethod(listen)

class WithDrone(Server):
    def _send_frame(self):
        now = timeit.default_timer()
        ticks = int(now * 1e9)
        self._last_frame_time = now
        self._last_frame_number += 1
        self._conn.send_message(MocapFrameMessage(
            frame_number=self._last_frame_number, markersets=[], skeletons=[], labelled_markers=[], force_plates=[],
            rigid_bodies=[RigidBody(7, (1.0, 0.5, -2.0), (0, 0, 0, 1), 0.001, 1)], devices=[], params=0,
            timing_info=TimingInfo(0, 0, now, ticks, ticks, ticks),
        ))

WithDrone().run(rate=50)
"""


@with_natnet
async def test_a_server_that_is_none_of_ours():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-c", textwrap.dedent(SERVER), str(Path(CAPTURED) / "src"), str(port)]
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.DEVNULL)
    recorder = Recorder()
    try:
        async with NatNetSource("127.0.0.1", port, 7).open(None, recorder, clock):
            await until(lambda: len(recorder.points) >= 20)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
    assert {point for _, point in recorder.points} == {(1.0, 2.0, 0.5)}


async def test_a_pose_of_ros_2_from_a_peer_that_is_none_of_ours():
    recorder = Recorder()
    async with (
        router() as where,
        Ros2Source("/drone/pose", where.endpoint).open(None, recorder, clock) as live,
        SdkPeer.at(where) as peer,
    ):
        await peer.asked("advertise", topic="/drone/pose", **parts_of(sources.POSE))
        await asyncio.sleep(0.5)
        seconds = int(time.time()) - 1
        for stamped, east in ((seconds, 1.0), (5, 2.0)):
            header = {"stamp": {"sec": stamped, "nanosec": 250_000_000}, "frame_id": "pad"}
            turned = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
            place = {"position": {"x": east, "y": 2.0, "z": 0.5}, "orientation": turned}
            before = len(recorder.points)
            await peer.asked("publish", topic="/drone/pose", message={"header": header, "pose": place})
            await until(lambda before=before: len(recorder.points) > before)
        (own_s, own), (arrived_s, other) = recorder.points
        assert (own_s, own, other) == (seconds + 0.25, (1.0, 2.0, 0.5), (2.0, 2.0, 0.5))
        assert abs(arrived_s - time.time()) < 5, "a stamp of another clock is none"
        await peer.asked("advertise", topic="/other", **parts_of("std_msgs/msg/String"))
        assert live.problem == ""


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("udp:127.0.0.1:5490", UdpSource(("127.0.0.1", 5490))),
        ("udp::5490", UdpSource(("0.0.0.0", 5490))),
        ("natnet:192.0.2.7", NatNetSource("192.0.2.7", 1510, None)),
        ("natnet:mocap.local:1520#3", NatNetSource("mocap.local", 1520, 3)),
        ("ros2:/drone/pose", Ros2Source("/drone/pose", "")),
        ("ros2:/p@tcp/127.0.0.1:7447", Ros2Source("/p", "tcp/127.0.0.1:7447")),
        ("track.csv", None),
    ],
)
def test_what_a_reference_may_be(text, found):
    assert parse_source(text) == found


@pytest.mark.parametrize("text", ["udp:h:x", "natnet:", "natnet:h#x", "natnet:h:99999"])
def test_what_is_none_says_what_to_give(text):
    with pytest.raises(ValueError, match=r"is not (udp|natnet):HOST"):
        parse_source(text)


async def test_a_topic_that_is_none():
    with pytest.raises(SourceError, match="no topic"):
        async with Ros2Source("pose").open(None, Recorder(), clock):
            pass
