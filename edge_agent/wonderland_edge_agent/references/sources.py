"""Where the drone truly is, live: by UDP, from a motion capture (NatNet), from a topic of ROS 2.

All give positions in the survey's frame (x east, y north, z up; m). What cannot be used is counted and said, and the
run goes on.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from wonderland.clock import Clock
from wonderland_edge_agent.references import LARGEST_M, STAMPED_S, Point, PositionError, SourceError, natnet
from wonderland_edge_agent.references.datagrams import PlaceOf, position

if TYPE_CHECKING:
    from wonderland_rmw_zenoh.node import Arrived

FORMS: Final = "a CSV, udp:HOST:PORT, natnet:HOST[:PORT][#BODY] or ros2:/TOPIC[@tcp/127.0.0.1:PORT]"
POSE: Final = "geometry_msgs/msg/PoseStamped"
ANSWER_S: Final = 5.0
KEEP_ALIVE_S: Final = 1.0
MAX_POSE_OCTETS: Final = 4_096


class Taker(Protocol):
    """Who is told positions."""

    def reference(self, t_s: float, point: Point) -> None:
        """One position."""
        ...


class Live:
    """A reference that runs. ``bad`` counts what was none, ``problem`` says what the last one was."""

    def __init__(self, recorder: Taker) -> None:
        self.address: tuple[str, int] = ("", 0)
        """Where it is heard, where that is an address."""
        self.bad = 0
        self.problem = ""
        self._recorder = recorder

    def position(self, t_s: float, point: Point) -> None:
        """One position."""
        if not all(math.isfinite(each) for each in (t_s, *point)):
            self.failed("a position with numbers that are none")
            return
        if max(map(abs, point)) > LARGEST_M:
            self.failed(f"a position more than {LARGEST_M / 1000:.0f} km away")
            return
        self.problem = ""
        self._recorder.reference(t_s, point)

    def failed(self, why: str) -> None:
        """Something that is no position."""
        self.bad += 1
        self.problem = why


class Source(Protocol):
    """What ``--reference`` says, if not a file."""

    def open(self, place_of: PlaceOf | None, recorder: Taker, clock: Clock) -> AbstractAsyncContextManager[Live]:
        """Positions into the recorder. Raises SourceError where nothing will come."""
        ...


@dataclass(frozen=True, slots=True)
class UdpSource:
    """One position in each datagram that comes here."""

    address: tuple[str, int]

    @contextlib.asynccontextmanager
    async def open(self, place_of: PlaceOf | None, recorder: Taker, clock: Clock) -> AsyncIterator[Live]:
        """Listens. Raises SourceError where the address is taken."""
        live = Live(recorder)

        def heard(data: bytes, _: Any) -> None:
            live.position(*position(data, place_of, clock() / 1000))

        transport = await _endpoint(_Datagrams(live, heard), f"{self.address[0]}:{self.address[1]}", self.address)
        live.address = transport.get_extra_info("sockname")[:2]
        try:
            yield live
        finally:
            transport.close()


@dataclass(frozen=True, slots=True)
class NatNetSource:
    """A rigid body of a NatNet server. ``body_id``: its streaming id; None: the only one."""

    host: str
    port: int = natnet.COMMAND_PORT
    body_id: int | None = None

    @contextlib.asynccontextmanager
    async def open(self, place_of: PlaceOf | None, recorder: Taker, clock: Clock) -> AsyncIterator[Live]:
        """Connects. Raises SourceError where no server answers."""
        del place_of
        live = Live(recorder)
        answered: asyncio.Future[natnet.Server] = asyncio.get_running_loop().create_future()

        def heard(data: bytes, sender: Any) -> None:
            if sender[0] != host:
                return  # whoever else sends here is not the motion capture
            if not answered.done():
                server = natnet.server_info(data)
                if server is not None:
                    answered.set_result(server)
                return
            found = natnet.bodies(data, answered.result().version)
            if found is not None:
                self._take(found, live, clock)

        host = await _address_of(self.host)
        here = _local_towards(host, self.port)
        async with contextlib.AsyncExitStack() as stack:
            commands = await _endpoint(_Datagrams(live, heard), here, (here, 0))
            stack.callback(commands.close)
            server = await self._connect(commands, host, answered)
            if server.group is None:
                keeping = asyncio.create_task(_keep_alive(commands, (host, self.port)))
                stack.callback(keeping.cancel)
            else:
                group = await _endpoint(_Datagrams(live, heard), server.group[0], sock=_joined(server.group, here))
                stack.callback(group.close)
            live.address = (host, self.port)
            yield live

    async def _connect(
        self, commands: asyncio.DatagramTransport, host: str, answered: asyncio.Future[natnet.Server]
    ) -> natnet.Server:
        try:
            async with asyncio.timeout(ANSWER_S):
                while True:
                    commands.sendto(natnet.CONNECT, (host, self.port))
                    with contextlib.suppress(TimeoutError):
                        return await asyncio.wait_for(asyncio.shield(answered), 0.5)
        except TimeoutError:
            raise SourceError(
                f"reference: no NatNet server answers at {self.host}:{self.port}; does Motive stream (Data Streaming), "
                "on that interface?"
            ) from None

    def _take(self, found: tuple[natnet.Body, ...], live: Live, clock: Clock) -> None:
        wanted = [each for each in found if self.body_id in {None, each.body_id}]
        if len(wanted) != 1:
            ids = ", ".join(str(each.body_id) for each in found) or "none"
            live.failed(f"which rigid body is the drone? The frames have {ids}; give natnet:{self.host}#ID")
        elif wanted[0].point is None:
            live.failed(f"rigid body {wanted[0].body_id} is not tracked")
        else:
            live.position(clock() / 1000, wanted[0].point)


@dataclass(frozen=True, slots=True)
class Ros2Source:
    """``geometry_msgs/PoseStamped`` of ROS 2, in the survey's frame."""

    topic: str
    router: str = ""

    @contextlib.asynccontextmanager
    async def open(self, place_of: PlaceOf | None, recorder: Taker, clock: Clock) -> AsyncIterator[Live]:
        """Subscribes. Raises SourceError where that cannot be."""
        del place_of
        try:
            from wonderland_rmw_zenoh.errors import Ros2Error  # noqa: PLC0415 - an extra
            from wonderland_rmw_zenoh.interfaces import Interfaces  # noqa: PLC0415
            from wonderland_rmw_zenoh.node import Node  # noqa: PLC0415
            from wonderland_rmw_zenoh.session import ROUTER, Link  # noqa: PLC0415
            from wonderland_rmw_zenoh.wire import is_name  # noqa: PLC0415
        except ImportError:
            raise SourceError(
                '--reference ros2:…: install what it needs: pip install "wonderland-edge-agent[ros2]"'
            ) from None
        link = Link(connect=(self.router or ROUTER,))
        problem = link.problem() if is_name(self.topic) else f"{self.topic[:100]!r} is no topic"
        if problem:
            raise SourceError(f"--reference ros2:{self.topic[:100]}: {problem}; give {FORMS}")
        live, types = Live(recorder), Interfaces()

        async def heard(arrived: Arrived) -> None:
            kind = types.of_hash(arrived.type, arrived.type_hash)
            if kind.name != POSE:
                live.failed(f"{self.topic} has {kind.name}, not {POSE}")
                return
            pose = kind.codec.decode(arrived.data)
            now_ms = clock()
            stamp_ms = pose.header.stamp.sec * 1_000 + pose.header.stamp.nanosec / 1e6
            t_ms = stamp_ms if abs(now_ms - stamp_ms) <= 1000 * STAMPED_S else now_ms
            place = pose.pose.position
            live.position(t_ms / 1000, (float(place.x), float(place.y), float(place.z)))

        try:
            async with Node("/wonderland_reference", link) as node:
                node.subscribe(self.topic, heard, kind=types.message(POSE), max_message_bytes=MAX_POSE_OCTETS)
                yield live
        except Ros2Error as cause:
            raise SourceError(f"--reference ros2:{self.topic}: {cause}") from cause


def parse_source(text: str) -> Source | None:
    """What ``--reference`` names, None for a file. Raises ValueError, whose text says what is wrong."""
    kind, _, rest = text.partition(":")
    if kind == "udp":
        host, _, port = rest.rpartition(":")
        return UdpSource((host.strip("[]") or "0.0.0.0", _port(text, port)))  # noqa: S104 - who knows it sends it
    if kind == "natnet":
        server, _, body = rest.partition("#")
        host, _, port = server.partition(":")
        if not host or (body and not (body.isascii() and body.isdigit())):
            raise ValueError(f"{text}: is not natnet:HOST[:PORT][#BODY], as natnet:192.0.2.7#3")
        return NatNetSource(host, _port(text, port) if port else natnet.COMMAND_PORT, int(body) if body else None)
    if kind == "ros2":
        topic, _, router = rest.partition("@")
        return Ros2Source(topic, router)
    return None


def _port(text: str, port: str) -> int:
    if not (port.isascii() and port.isdigit() and int(port) < 65_536):
        raise ValueError(f"{text}: is not {text.partition(':')[0]}:HOST:PORT, as udp:0.0.0.0:5490")
    return int(port)


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, live: Live, heard: Any) -> None:
        self._live = live
        self._heard = heard

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Hand it on; what is none is counted, and why is kept."""
        try:
            self._heard(data, addr)
        except PositionError as error:
            self._live.failed(str(error))


async def _endpoint(
    protocol: asyncio.DatagramProtocol, name: str, address: tuple[str, int] | None = None, **more: Any
) -> asyncio.DatagramTransport:
    try:
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: protocol, local_addr=address, **more
        )
    except OSError as error:
        raise SourceError(f"reference: {name} cannot be listened to ({error.strerror or error})") from error
    return transport


async def _address_of(host: str) -> str:
    try:
        found = await asyncio.get_running_loop().getaddrinfo(host, None, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise SourceError(f"reference: {host} is not known ({error.strerror or error})") from error
    return str(found[0][4][0])


def _local_towards(host: str, port: int) -> str:
    """The address of the interface by which the server is reached: nothing is listened to on others."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, port))
        except OSError as error:
            raise SourceError(f"reference: {host} cannot be reached ({error.strerror or error})") from error
        return str(probe.getsockname()[0])


def _joined(group: tuple[str, int], here: str) -> socket.socket:
    """A socket that hears what the server sends to all. Raises SourceError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(group)
        member = struct.pack("4s4s", socket.inet_aton(group[0]), socket.inet_aton(here))
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        made.setblocking(False)
    except OSError as error:
        made.close()
        raise SourceError(f"reference: {group[0]}:{group[1]} cannot be joined ({error.strerror or error})") from error
    return made


async def _keep_alive(commands: asyncio.DatagramTransport, server: tuple[str, int]) -> None:
    while True:
        commands.sendto(natnet.KEEP_ALIVE, server)
        await asyncio.sleep(KEEP_ALIVE_S)
