"""google/pica, an UWB controller that nobody here wrote, with the nodes of a test standing where they should."""

import asyncio
import contextlib
import json
import os
import socket
import urllib.request
from pathlib import Path
from typing import Self

import pytest

VARIABLE = "PICA_BIN"
START_S = 10.0


def pica_binary() -> Path:
    """Its program ``pica-http``; skips where there is none."""
    found = os.environ.get(VARIABLE)
    if not found:
        pytest.skip(f"{VARIABLE} names no program: build google/pica with its web interface, bound to 127.0.0.1")
    return Path(found)


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        found = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in found:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in found]


class Pica:
    """One process, and a port of its own for each node: who connects there is put at the node's place.

    ``places_mm``: (east, north, up) by name of the node.
    """

    def __init__(self, places_mm: dict[str, tuple[float, float, float]], log: Path) -> None:
        self._log = log
        self._places_mm = places_mm
        self._uci_port, self._web_port = _free_ports(2)
        self._process: asyncio.subprocess.Process | None = None
        self._servers: dict[str, asyncio.Server] = {}
        self._one_at_a_time = asyncio.Lock()
        self._known: set[str] = set()
        self._joined: set[asyncio.Task[None]] = set()

    def port_of(self, name: str) -> str:
        """What an agent opens for this node."""
        return f"socket://127.0.0.1:{self._servers[name].sockets[0].getsockname()[1]}"

    async def __aenter__(self) -> Self:
        arguments = ("--uci-port", str(self._uci_port), "--web-port", str(self._web_port))
        with self._log.open("wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                str(pica_binary()), *arguments, stdout=log, stderr=asyncio.subprocess.STDOUT
            )
        async with asyncio.timeout(START_S):
            for port in (self._uci_port, self._web_port):
                while not await self._answers(port):
                    await asyncio.sleep(0.05)
        # It ends itself where nobody listens to its events.
        events, ask = await asyncio.open_connection("127.0.0.1", self._web_port)
        ask.write(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        await events.readuntil(b"\r\n\r\n")
        self._events = asyncio.create_task(_heard(events, ask))
        for name in self._places_mm:
            self._servers[name] = await asyncio.start_server(
                lambda reader, writer, name=name: self._join(name, reader, writer), "127.0.0.1", 0
            )
        return self

    async def __aexit__(self, *_: object) -> None:
        for server in self._servers.values():
            server.close()
        assert self._process is not None
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await self._process.wait()
        await self._events
        for task in self._joined:
            task.cancel()
        await asyncio.gather(*self._joined, return_exceptions=True)

    async def _answers(self, port: int) -> bool:
        """Whether somebody listens; the UCI port is not tried, because each connection there is a device."""
        listening = f":{port:04X} 00000000:0000 0A"
        return await asyncio.to_thread(lambda: listening in Path("/proc/net/tcp").read_text().upper())

    async def _join(self, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._joined.add(task)
        async with contextlib.AsyncExitStack() as ends:
            ends.push_async_callback(_closed, writer)
            async with self._one_at_a_time:
                down, up = await asyncio.open_connection("127.0.0.1", self._uci_port)
                ends.push_async_callback(_closed, up)
                await asyncio.to_thread(self._place, await self._new_device(), self._places_mm[name])
            await asyncio.gather(_relay(reader, up), _relay(down, writer), return_exceptions=True)

    async def _new_device(self) -> str:
        """The address of the device that has just appeared."""
        async with asyncio.timeout(START_S):
            while True:
                state = await asyncio.to_thread(self._ask, "get-state", b"")
                addresses = {str(device["mac_address"]) for device in json.loads(state)["devices"]}
                if new := addresses - self._known:
                    self._known |= new
                    return new.pop()
                await asyncio.sleep(0.02)

    def _place(self, address: str, place_mm: tuple[float, float, float]) -> None:
        x, y, z = (round(value / 10) for value in place_mm)
        body = f'{{"x":{x},"y":{y},"z":{z},"yaw":0,"pitch":0,"roll":0}}'
        self._ask(f"set-position/{address}", body.encode())

    def _ask(self, path: str, body: bytes) -> bytes:
        request = urllib.request.Request(f"http://127.0.0.1:{self._web_port}/{path}", data=body or None)
        with urllib.request.urlopen(request, timeout=START_S) as answer:
            return bytes(answer.read())


async def _heard(events: asyncio.StreamReader, ask: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while await events.read(4_096):
            pass
    ask.close()


async def _closed(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with contextlib.suppress(OSError):
        await writer.wait_closed()


async def _relay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(4_096):
        writer.write(data)
        await writer.drain()
    writer.close()
