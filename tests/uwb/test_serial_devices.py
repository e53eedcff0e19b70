"""Ports that are no serial device of this machine: over TCP, over pyserial's own RFC 2217 server, character devices."""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path

import pytest
import serial
import serial.rfc2217
from kit.port_observer import Observer

from wonderland_fira_uci.dwm1001 import Dwm1001Node
from wonderland_fira_uci.errors import NodeUnavailableError
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import PortError, PortTimings, ReconnectingPort, serial_opener, url_problem
from wonderland_simulator.uci_node import Air, Measurement, VirtualNode

FAST = PortTimings(backoff_s=0.02, backoff_max_s=0.1, stable_s=0.05)
# pyserial's RFC 2217 client still names its thread as Python 2 did.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")


async def until(condition: Callable[[], bool], limit_s: float = 10.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.01)


Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@contextlib.asynccontextmanager
async def tcp_server(serve: Serve, number: int = 0) -> AsyncIterator[tuple[int, list[asyncio.StreamWriter]]]:
    """Its port's number and its connections, which all have ended when it has."""
    writers: list[asyncio.StreamWriter] = []

    async def one(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        with contextlib.suppress(ConnectionError):
            await serve(reader, writer)
        writer.close()

    server = await asyncio.start_server(one, "127.0.0.1", number)
    try:
        yield server.sockets[0].getsockname()[1], writers
    finally:
        server.close()
        for writer in writers:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()


class Rfc2217:
    """pyserial's server class on a line that echoes."""

    def __init__(self) -> None:
        self.line = serial.serial_for_url("loop://", timeout=0.05)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        self.connections: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def write(self, data: bytes) -> None:
        """Called by the server class: its own part of the telnet conversation."""
        with contextlib.suppress(OSError):
            self.connections[-1].sendall(data)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self.listener.accept()
                self.connections.append(connection)
                manager = serial.rfc2217.PortManager(self.line, self)
                threading.Thread(target=self._from_network, args=(connection, manager), daemon=True).start()
                threading.Thread(target=self._to_network, args=(connection, manager), daemon=True).start()

    def _from_network(self, connection: socket.socket, manager: serial.rfc2217.PortManager) -> None:
        with contextlib.suppress(OSError):
            while data := connection.recv(1024):
                self.line.write(b"".join(manager.filter(data)))

    def _to_network(self, connection: socket.socket, manager: serial.rfc2217.PortManager) -> None:
        with contextlib.suppress(OSError):
            while connection.fileno() >= 0:
                data = self.line.read(1)
                if data:
                    connection.sendall(b"".join(manager.escape(data + self.line.read(self.line.in_waiting))))

    def drop(self) -> None:
        """The far computer loses its network."""
        for connection in self.connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()
        self.connections.clear()

    def close(self) -> None:
        self.drop()
        self.listener.close()


@pytest.fixture
def rfc2217() -> Iterator[Rfc2217]:
    server = Rfc2217()
    yield server
    server.close()


async def test_rfc2217_passes_every_octet_sets_the_rate_and_comes_back(rfc2217: Rfc2217) -> None:
    observer = Observer()
    port = ReconnectingPort(serial_opener(f"rfc2217://{rfc2217.address}", 3_000_000), observer, timings=FAST)
    every = bytes(range(256)) * 4  # telnet's own 255 among them
    try:
        port.start()
        await until(lambda: observer.log == ["up"])
        assert rfc2217.line.baudrate == 3_000_000
        port.write(every)
        await until(lambda: len(observer.data) == len(every))
        assert observer.data == every
        rfc2217.drop()
        await until(lambda: observer.log[1:2] == ["down: the device has hung up"])
        await until(lambda: observer.log[-1] == "up", 15)
        observer.data = b""
        port.write(b"again")
        await until(lambda: observer.data == b"again")
    finally:
        port.close()


async def test_a_node_behind_a_tcp_port_is_driven_and_comes_back_when_that_vanishes() -> None:
    air = Air(lambda *_: Measurement(4_320), rng=random.Random(1))
    node = VirtualNode("far", air)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        node.transmit = writer.write
        while data := await reader.read(4096):
            node.receive(data)

    async with (
        tcp_server(serve) as (number, writers),
        UwbNode(f"socket://127.0.0.1:{number}", port_timings=FAST) as host,
    ):
        await host.wait_ready()
        assert host.name == f"socket://127.0.0.1:{number}"
        assert host.capabilities is not None
        node.power_off()
        writers[-1].transport.abort()  # a reset, as of a computer that was switched off
        await until(lambda: not host.is_ready)
        await until(lambda: host.is_ready)
        assert len(writers) == 2
    air.close()


async def test_nobody_there_is_said_without_stopping_the_loop_and_found_later() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
    observer = Observer()
    port = ReconnectingPort(serial_opener(f"socket://127.0.0.1:{number}"), observer, timings=FAST)
    try:
        port.start()
        await until(lambda: "cannot be opened" in port.last_error)
        assert observer.log == []

        async def greet(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"hello")

        async with tcp_server(greet, number):
            await until(lambda: observer.data.startswith(b"hello"))
    finally:
        port.close()


@pytest.mark.parametrize("kind", [UwbNode, Dwm1001Node])
async def test_a_node_on_a_line_that_is_refused_says_so(
    kind: type[UwbNode | Dwm1001Node], unused_tcp_port: int
) -> None:
    async with kind(f"socket://127.0.0.1:{unused_tcp_port}") as node:
        with pytest.raises(NodeUnavailableError, match="Connection refused"):
            await node.wait_ready(1.0)
        assert "refused" in node.detail


async def test_a_port_that_is_given_up_while_it_connects_is_not_used() -> None:
    accepted = asyncio.Event()
    gone = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, _writer: asyncio.StreamWriter) -> None:
        accepted.set()
        await reader.read()
        gone.set()

    observer = Observer()
    async with tcp_server(serve) as (number, _):
        port = ReconnectingPort(serial_opener(f"socket://127.0.0.1:{number}"), observer, timings=FAST)
        port.start()
        port.close()
        async with asyncio.timeout(10):
            await accepted.wait()
            await gone.wait()  # the connection is closed, not leaked
    assert observer.log == []


@pytest.mark.parametrize(
    ("port", "problem"),
    [
        ("/dev/ttyACM0", ""),
        ("", "is empty; a path"),
        ("socket://10.0.0.7:5000", ""),
        ("rfc2217://[::1]:5000", ""),
        ("socket://10.0.0.7", "needs host and port"),
        ("socket://:5000", "needs host and port"),
        ("socket://host:0", "needs host and port"),
        ("rfc2217://host:99999", "needs host and port"),
        ("socket://[::1", "needs host and port"),
        ("spy:///dev/ttyACM0?file=/etc/x", "is not known"),
        ("loop://", "is not known"),
        ("://", "is not known"),
    ],
)
def test_urls(port: str, problem: str) -> None:
    assert problem in url_problem(port)
    assert bool(problem) == bool(url_problem(port))
    if "://" in port and problem:
        with pytest.raises(PortError, match=problem):
            serial_opener(port)()


async def test_a_character_device_that_is_no_terminal() -> None:
    """/dev/random is one that can be waited for, read and written; no node answers from it."""
    observer = Observer()
    port = ReconnectingPort(serial_opener("/dev/random"), observer, timings=FAST)
    try:
        port.start()
        assert observer.log == ["up"]
        await until(lambda: len(observer.data) > 0)
        port.write(b"x")
        assert observer.log == ["up"]
    finally:
        port.close()


async def test_a_character_device_that_cannot_be_waited_for_is_named() -> None:
    observer = Observer()
    port = ReconnectingPort(serial_opener("/dev/null"), observer, timings=FAST)
    try:
        before = len(list(Path("/proc/self/fd").iterdir()))
        port.start()
        assert port.last_error.startswith("/dev/null is no serial port, and no device that a node could be on")
        assert observer.log == []
        assert len(list(Path("/proc/self/fd").iterdir())) == before
    finally:
        port.close()


async def test_a_server_that_says_nothing_does_not_stop_the_loop() -> None:
    """pyserial waits three seconds for telnet's answers; the other anchors' ports go on meanwhile."""

    async def mute(reader: asyncio.StreamReader, _writer: asyncio.StreamWriter) -> None:
        await reader.read(-1)

    observer = Observer()
    loop = asyncio.get_running_loop()
    longest_s = 0.0
    async with tcp_server(mute) as (number, _), asyncio.timeout(20):
        port = ReconnectingPort(serial_opener(f"rfc2217://127.0.0.1:{number}"), observer, timings=FAST)
        port.start()
        while not port.last_error:
            before_s = loop.time()
            await asyncio.sleep(0.01)
            longest_s = max(longest_s, loop.time() - before_s)
        port.close()
    assert "RFC2217" in port.last_error
    assert observer.log == []
    assert longest_s < 1.5


@pytest.mark.parametrize("kind", [UwbNode, Dwm1001Node])
@pytest.mark.parametrize("what", ["file", "directory", "/dev/null", "rfc2217://127.0.0.1"])
async def test_what_can_never_be_a_node_is_not_waited_for(
    kind: type[UwbNode | Dwm1001Node], what: str, tmp_path: Path
) -> None:
    path = what if what.startswith(("/", "rfc2217")) else str(tmp_path / what)
    if what == "directory":
        Path(path).mkdir()
    elif what == "file":
        Path(path).write_text("no node\n")
    async with asyncio.timeout(5), kind(path) as node:
        with pytest.raises(NodeUnavailableError, match=r"no device|no serial port|needs host and port") as said:
            await node.wait_ready(60)
    assert "not ready within" not in str(said.value)


async def test_a_device_that_may_yet_come_is_waited_for(tmp_path: Path) -> None:
    async with UwbNode(tmp_path / "ttyACM0") as node:
        with pytest.raises(NodeUnavailableError, match=r"not ready within 0\.2 s"):
            await node.wait_ready(0.2)
