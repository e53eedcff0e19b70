"""Counterparts of ROS 2: a router (zenohd where there is one), and peers that are none of ours."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import shutil
import socket
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from wonderland.asset_contract import AssetContract
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.session import Link
from wonderland_ros_bridge.ros2.interfaces_command import DIRECTORIES
from wonderland_ros_bridge.ros2.pad_node import PadNode
from wonderland_ros_bridge.ros2.reports import listening
from wonderland_ros_bridge.ros2.settings import PadNodeSettings

TYPES = Interfaces(DIRECTORIES)
_ROUTER = """
import json, sys, time, zenoh
config = zenoh.Config()
for name, value in {"mode": "router", "listen/endpoints": [sys.argv[1]], "scouting/multicast/enabled": False}.items():
    config.insert_json5(name, json.dumps(value))
with zenoh.open(config):
    print("ready", flush=True)
    time.sleep(3600)
"""


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Router:
    """``zenohd`` (of ZENOHD, or of the path), or a session of Zenoh's that routes, in a process of its own."""

    def __init__(self, port=None):
        self.port = port or free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self.link = Link(connect=(self.endpoint,))
        self._process = None

    async def start(self):
        binary = os.environ.get("ZENOHD") or shutil.which("zenohd")
        if binary:
            command = [binary, "--listen", self.endpoint, "--no-multicast-scouting", "--rest-http-port", "none"]
        else:
            command = [sys.executable, "-c", _ROUTER, self.endpoint]
        self._process = await asyncio.create_subprocess_exec(
            *command, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL
        )
        async with asyncio.timeout(15):
            while True:
                try:
                    _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                except OSError:
                    assert self._process.returncode is None, "the router has ended"
                    await asyncio.sleep(0.05)
                else:
                    writer.close()
                    return self

    async def stop(self):
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
            await self._process.wait()


@asynccontextmanager
async def router(port=None):
    made = Router(port)
    try:
        yield await made.start()
    finally:
        await made.stop()


@asynccontextmanager
async def pad_node(world, where, *, name="mirror", clock=None, ledger=None, **settings):
    """The node of the world's pad, as ``wonderland ros2 run`` puts it together."""
    connection = world.connection
    made_of = PadNodeSettings(**{"pad_id": "pad-1", "reports": world.directory / "reports.sock"} | settings)
    async with connection.open_channel() as channel, Node(made_of.node, where.link) as node:
        network = Gateway(channel, connection.identity(name), connection.signer(name)).network(connection.channel)
        contract = AssetContract(network, connection.chaincode)
        made = PadNode(made_of, node, ledger(contract) if ledger else contract, clock or world.clock)
        async with listening(made_of.reports, made.report):
            working = asyncio.create_task(made.run())
            try:
                async with asyncio.timeout(10):
                    await made.placed.wait()
                yield made
            finally:
                working.cancel()
                await asyncio.gather(working, return_exceptions=True)
                assert working.cancelled(), working.exception()


def parts_of(kind):
    """A type's own text and those of the types within it, as a peer that is none of ours reads them."""
    definition = TYPES.message(kind).codec.definition
    texts = {
        name: "".join(f"{field.line()}\n" for field in fields).replace("/msg/", "/")
        for name, fields in definition.fields.items()
    }
    return {"type": kind, "text": texts.pop(kind), "parts": texts}


class SdkPeer:
    """zenoh-ros2-sdk in a process of its own."""

    def __init__(self, process):
        self._process = process
        self.messages = []

    @classmethod
    @asynccontextmanager
    async def at(cls, where, domain=0):
        if importlib.util.find_spec("zenoh_ros2_sdk") is None:
            pytest.skip("zenoh-ros2-sdk is needed")
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",  # its own directory has modules that are called as Python's are
            str(Path(__file__).with_name("sdk_peer.py")),
            str(where.port),
            str(domain),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            limit=1 << 24,
        )
        try:
            yield cls(process)
        finally:
            process.kill()
            await process.wait()

    async def asked(self, do, **order):
        self._process.stdin.write(json.dumps({"do": do, **order}).encode() + b"\n")
        await self._process.stdin.drain()
        return await self._until(do)

    async def heard(self, topic, *, fits=lambda _: True, limit_s=15):
        """The first message of a topic, from now on or before, that fits."""
        for index, (name, message) in enumerate(self.messages):
            if name == topic and fits(message):
                del self.messages[index]
                return message
        async with asyncio.timeout(limit_s):
            while True:
                line = await self._line()
                if line["did"] == "message" and line["topic"] == topic and fits(line["message"]):
                    return line["message"]
                self._keep(line)

    async def _until(self, did):
        async with asyncio.timeout(20):
            while True:
                line = await self._line()
                if line["did"] == did:
                    return line
                self._keep(line)

    def _keep(self, line):
        if line["did"] == "message":
            self.messages.append((line["topic"], line["message"]))

    async def _line(self):
        line = await self._process.stdout.readline()
        assert line, "the peer has ended"
        return json.loads(line)
