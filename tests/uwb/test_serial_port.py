"""The byte pipe: over socket pairs, where everything can be steered, and over a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
import socket
import tty
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest
from kit.port_observer import Observer

from wonderland_fira_uci.serial_port import PortError, PortTimings, ReconnectingPort, serial_opener
from wonderland_fira_uci.serial_port.port import MAX_WAITING_OCTETS

FAST = PortTimings(backoff_s=0.01, backoff_max_s=0.04, stable_s=0.05, write_timeout_s=0.1)


class Plug:
    """An opener whose device is one end of a new socket pair each time; ``far`` is the other end."""

    def __init__(self) -> None:
        self.far: socket.socket | None = None
        self.attempts: list[float] = []
        self.present = True

    def __call__(self) -> socket.socket:
        self.attempts.append(asyncio.get_running_loop().time())
        if not self.present:
            raise PortError("not there")
        if self.far is not None:
            self.far.close()
        near, self.far = socket.socketpair()
        near.setblocking(False)
        near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        return near

    def pull(self) -> None:
        self.present = False
        assert self.far is not None
        self.far.close()
        self.far = None


@pytest.fixture
async def setup() -> AsyncIterator[tuple[ReconnectingPort, Plug, Observer]]:
    plug, observer = Plug(), Observer()
    port = ReconnectingPort(plug, observer, timings=FAST)
    yield port, plug, observer
    port.close()
    if plug.far is not None:
        plug.far.close()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(3):
        while not condition():
            await asyncio.sleep(0.002)


async def test_octets_pass_both_ways(setup) -> None:
    port, plug, observer = setup
    assert not port.is_up
    port.start()
    assert observer.log == ["up"]
    port.write(b"abc")
    port.write(b"")
    assert plug.far.recv(10) == b"abc"
    plug.far.send(b"xyz")
    await until(lambda: observer.data == b"xyz")
    port.close()
    assert plug.far.recv(10) == b""
    assert observer.log == ["up"]
    port.write(b"into the void")


async def test_what_vanishes_is_looked_for_with_growing_pauses_and_found_again(setup) -> None:
    port, plug, observer = setup
    port.start()
    await asyncio.sleep(0.06)
    plug.pull()
    await until(lambda: len(plug.attempts) >= 6)
    assert observer.log == ["up", "down: the device has hung up"]
    assert port.last_error == "not there"
    port.write(b"lost")
    pauses = [b - a for a, b in zip(plug.attempts[1:], plug.attempts[2:], strict=False)]
    assert pauses[0] >= 0.019
    assert all(pause >= 0.039 for pause in pauses[1:])
    plug.present = True
    await until(lambda: port.is_up)
    assert observer.log[-1] == "up"
    assert port.last_error == ""
    port.write(b"again")
    assert plug.far.recv(10) == b"again"


async def test_what_does_not_fit_waits_and_arrives_whole(setup) -> None:
    port, plug, observer = setup
    port.start()
    sent = bytes(range(256)) * 160
    for at in range(0, len(sent), 1_000):
        port.write(sent[at : at + 1_000])
    got = b""
    plug.far.setblocking(False)
    async with asyncio.timeout(3):
        while len(got) < len(sent):
            got += await asyncio.get_running_loop().sock_recv(plug.far, 3_000)
            await asyncio.sleep(0.001)
    assert got == sent
    await asyncio.sleep(0.15)
    assert observer.log == ["up"]


async def test_a_device_that_takes_nothing_is_given_up(setup) -> None:
    port, _plug, observer = setup
    port.start()
    port.write(bytes(60_000))
    await until(lambda: len(observer.log) >= 3)
    assert observer.log[1] == "down: it took no data for 0.1 s"
    assert observer.log[2] == "up"


async def test_what_waits_is_bounded(setup) -> None:
    port, plug, observer = setup
    port.start()
    for _ in range(100):
        port.write(bytes(4_000))
    assert 0 < len(port._waiting) <= MAX_WAITING_OCTETS
    await until(lambda: "down: it takes no data" in observer.log)
    assert len(plug.attempts) >= 1


async def test_a_write_that_fails_tells_the_observer_later_not_from_within(setup) -> None:
    port, plug, observer = setup
    port.start()
    plug.pull()
    port.write(b"x")
    assert observer.log == ["up"]
    await until(lambda: len(observer.log) == 2)
    assert observer.log[1].startswith("down: ")


async def test_a_closed_port_never_opens_again(setup) -> None:
    port, plug, observer = setup
    plug.present = False
    port.start()
    port.close()
    await asyncio.sleep(0.05)
    assert len(plug.attempts) == 1
    assert observer.log == []


async def test_a_pseudo_terminal_passes_every_octet_unchanged_and_belongs_to_one(tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    link = tmp_path / "node"
    link.symlink_to(os.ttyname(slave))
    observer = Observer()
    port = ReconnectingPort(serial_opener(link), observer, timings=FAST)
    try:
        port.start()
        assert observer.log == ["up"]
        every = bytes(range(256))  # among them ^C, XON, XOFF, CR, LF, EOF
        port.write(every)
        got = b""
        while len(got) < 256:
            got += os.read(master, 512)
        assert got == every
        os.write(master, every)
        await until(lambda: len(observer.data) == 256)
        assert observer.data == every
        with pytest.raises(PortError, match="cannot be opened"):
            serial_opener(link)()
    finally:
        port.close()
        os.close(master)
        os.close(slave)


def test_what_is_not_there_or_no_serial_device_is_named(tmp_path: Path) -> None:
    with pytest.raises(PortError, match="nothing"):
        serial_opener(tmp_path / "nothing")()
    plain = tmp_path / "plain"
    plain.write_text("")
    with pytest.raises(PortError, match="plain"):
        serial_opener(plain)()
    with pytest.raises(PortError):
        serial_opener(tmp_path, baud_rate=-1)()
