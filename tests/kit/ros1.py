"""A real master and real rospy nodes, of Debian's packages, each in a process of its own; a bridge as a process."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import os
import shutil
import socket
import subprocess
import sys
import xmlrpc.client
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_ros_bridge.ledger.outbox_view import OutboxView

SYSTEM_PYTHON = "/usr/bin/python3"
PEER = Path(__file__).with_name("rospy_peer.py")
WAIT_S = 30


@functools.cache
def missing():
    """Why there is no real ROS here; empty where there is one."""
    if not shutil.which("roscore", path="/usr/bin:/opt/ros/noetic/bin"):
        return "no roscore: apt-get install ros-core python3-rospy (Debian 12)"
    done = subprocess.run(
        [SYSTEM_PYTHON, "-c", "import rospy, std_msgs.msg, geometry_msgs.msg, sensor_msgs.msg"],
        capture_output=True,
        env=system_environment(),
        check=False,
    )
    return "" if done.returncode == 0 else "the system's Python has no rospy: apt-get install python3-rospy"


def need_ros():
    if why := missing():
        pytest.skip(why)


def _environment(master, home):
    return {
        "PATH": "/usr/bin:/bin",
        "HOME": str(home),
        "ROS_HOME": str(home),
        "ROS_LOG_DIR": str(home),
        "ROS_IP": "127.0.0.1",
        "ROS_MASTER_URI": master,
        "PYTHONUNBUFFERED": "1",
        "LANG": "C.UTF-8",
    }


def system_environment():
    """For a program of the system's Python that needs no master."""
    return _environment("http://127.0.0.1:1", "/nowhere")


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Master:
    """A real rosmaster at one port, which can be ended and started anew."""

    def __init__(self, home):
        self.home = home
        self.port = free_port()
        self.uri = f"http://127.0.0.1:{self.port}"
        self._process = None

    async def start(self):
        self._process = await asyncio.create_subprocess_exec(
            *("/usr/bin/rosmaster", "--core", "-p", str(self.port)),
            env=_environment(self.uri, self.home),
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
        )
        async with asyncio.timeout(WAIT_S):
            while True:
                with contextlib.suppress(OSError, xmlrpc.client.Error):
                    await self.ask("getPid")
                    return
                await asyncio.sleep(0.05)

    async def ask(self, method, *parameters):
        """Ask the master itself."""
        with xmlrpc.client.ServerProxy(self.uri) as master:
            return (await asyncio.to_thread(getattr(master, method), "/test", *parameters))[2]

    async def stop(self):
        await _end(self._process)


class Peer:
    """A rospy node."""

    def __init__(self, process):
        self._process = process
        self._heard = []

    @classmethod
    async def start(cls, name, master):
        with (master.home / f"{name}.log").open("ab") as log:
            process = await asyncio.create_subprocess_exec(
                *(SYSTEM_PYTHON, "-P", str(PEER), name),  # kit has modules that are called as Python's are
                env=_environment(master.uri, master.home),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                limit=1 << 26,
            )
        made = cls(process)
        await made.until("start")
        return made

    def do(self, what, **order):
        self._process.stdin.write(json.dumps({"do": what, **order}).encode() + b"\n")

    async def asked(self, what, **order):
        """Do something, and wait until it is done."""
        self.do(what, **order)
        return await self.until(what)

    async def until(self, did, count=None):
        """The next line of a kind, or so many of them."""
        found = []
        async with asyncio.timeout(WAIT_S):
            while True:
                for line in [line for line in self._heard if line["did"] == did]:
                    self._heard.remove(line)
                    found.append(line)
                    if len(found) == (count or 1):
                        return found if count else line
                line = await self._process.stdout.readline()
                assert line, f"the rospy node ended before it did {did!r}"
                print(line)
                self._heard.append(json.loads(line))

    async def stop(self):
        await _end(self._process)


async def _end(process):
    if process is not None and process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            await asyncio.wait_for(process.wait(), 5)
        except TimeoutError:
            process.kill()
            await process.wait()


class BridgeProcess:
    """``wonderland ros1 run``."""

    def __init__(self, process, log):
        self.process = process
        self.log = log

    @classmethod
    async def start(cls, config):
        log = config.with_suffix(".log")
        with log.open("ab") as file:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "wonderland.cli", "ros1", "run", "--config", str(config), "--json"),
                stdout=asyncio.subprocess.PIPE,
                stderr=file,
                env=os.environ | {"NO_COLOR": "1"},
            )
        made = cls(process, log)
        try:
            line = await asyncio.wait_for(process.stdout.readline(), WAIT_S)
            assert line, log.read_text()
        except BaseException:
            await _end(process)
            raise
        made.told = json.loads(line)
        return made

    async def stop(self):
        await _end(self.process)
        return self.process.returncode

    async def kill(self):
        self.process.kill()
        await self.process.wait()


@asynccontextmanager
async def running_ledger(directory, listen="127.0.0.1:0"):
    """An embedded ledger with the contract; blocks are cut at once."""
    settings = LedgerSettings(listen=listen, limits=BatchLimits(time_ms=2))
    async with EmbeddedLedger(directory, {"pol": load_contract("pol")}, settings) as ledger:
        yield ledger


def write_config(path, *, ledger, master, identity, bridge, body, more=""):
    path.write_text(
        f"""bridge = "{bridge}"
spool = "{bridge}.spool"
{more}
[ledger]
connection = "{ledger}"
identity = "{identity}"
[ros1]
master = "{master}"
node = "/{bridge.replace("-", "_")}"
{body}
"""
    )
    return path


class Route:
    """Two bridges at one ledger: what ``drone-a`` hears comes out of ``pad-b`` under /ledger/drone_a."""

    def __init__(self, directory, master, *, to_ledger='topic = "/fix"', from_ledger='senders = ["*"]', more=""):
        self.ledger_directory = directory / "ledger"
        self.listen = f"127.0.0.1:{free_port()}"
        common = {"ledger": self.ledger_directory / "connection.json", "master": master.uri}
        self.outward = write_config(
            directory / "a.toml",
            **common,
            identity="uav",
            bridge="drone-a",
            body=f"[[to_ledger]]\n{to_ledger}\n",
            more=more,
        )
        self.inward = write_config(
            directory / "b.toml", **common, identity="pad", bridge="pad-b", body=f"[[from_ledger]]\n{from_ledger}\n"
        )
        self.first = self.second = self.ledger = None
        self._stack = contextlib.AsyncExitStack()

    async def __aenter__(self):
        await self.start_ledger()
        self.first, self.second = await asyncio.gather(
            BridgeProcess.start(self.outward), BridgeProcess.start(self.inward)
        )
        return self

    async def __aexit__(self, *_):
        for bridge in (self.first, self.second):
            if bridge is not None:
                await bridge.stop()
        await self.stop_ledger()

    async def start_ledger(self):
        self.ledger = await self._stack.enter_async_context(running_ledger(self.ledger_directory, self.listen))

    async def stop_ledger(self):
        await self._stack.aclose()

    def status(self, bridge="drone-a"):
        """What ``wonderland ros1 status`` says of a bridge."""
        with OutboxView(self.outward.parent / f"{bridge}.spool") as view:
            return view.summary()

    async def kept(self):
        """Until the receiving bridge has written down that it has published all that is on the ledger."""
        async with asyncio.timeout(WAIT_S):
            while self.status("pad-b")["next_block"] != self.ledger.chain.height:
                await asyncio.sleep(0.02)

    async def waiting(self, count):
        """Until so many messages wait for the ledger."""
        async with asyncio.timeout(WAIT_S):
            while self.status()["waiting"] != count:
                await asyncio.sleep(0.02)

    async def through(self, count):
        """Until so many messages were received, and none waits any more."""
        async with asyncio.timeout(WAIT_S):
            while True:
                now = self.status()
                if now["waiting"] == 0 and sum(each["received"] for each in now["topics"]) == count:
                    return
                await asyncio.sleep(0.02)
