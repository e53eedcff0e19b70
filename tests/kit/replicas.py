"""Two backends as processes on one database, one ledger and one bus, and consoles that look at what each of them shows."""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import json
import os
import signal
import sys
from contextlib import asynccontextmanager, suppress
from urllib.parse import urlsplit

import httpx
import websockets

from kit import PLAIN, environment
from kit.backend_process import WONDERLAND
from kit.bus import Organisations, free_port
from kit.bus_router import written


class Process:
    """A process that says in lines of JSON how it does."""

    def __init__(self, process):
        self.process = process
        self.url = ""

    @property
    def pid(self):
        return self.process.pid

    async def told(self, within_s=60):
        line = await asyncio.wait_for(self.process.stdout.readline(), within_s)
        if not line:
            raise AssertionError((await self.process.stderr.read()).decode()[-4000:])
        found = json.loads(line)
        self.url = found["url"]
        return found

    async def kill(self):
        if self.process.returncode is None:
            self.process.kill()
        await self.process.communicate()

    def stop(self):
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self):
        self.process.send_signal(signal.SIGCONT)


class Bus:
    """A router that can be killed and started again at the same address."""

    def __init__(self, directory):
        self.organisations = Organisations(directory / "bus")
        self.port = free_port()
        self.process = None

    async def start(self):
        settings = written(self.organisations.router(self.port))
        self.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "kit.bus_router",
            settings,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=environment(),
        )
        assert await asyncio.wait_for(self.process.stdout.readline(), 30) == b"up\n"

    async def kill(self):
        self.process.kill()
        await self.process.wait()

    def settings(self, name):
        """Of a backend on the bus, for its environment."""
        tls = self.organisations.tls("AuthorityMSP", name)
        return {
            "WONDERLAND_BACKEND_BUS__ROUTERS": json.dumps([f"tls/localhost:{self.port}"]),
            "WONDERLAND_BACKEND_BUS__CA": str(tls.ca),
            "WONDERLAND_BACKEND_BUS__CERTIFICATE": str(tls.certificate),
            "WONDERLAND_BACKEND_BUS__KEY": str(tls.key),
        }


class Pair:
    """Where backends of one database are begun."""

    def __init__(self, directory, database, bus):
        self.directory = directory
        self.database = database
        self.bus = bus
        self.running = []
        self.errors = directory / "backends.log"

    async def begin(self, name, *arguments, listen="127.0.0.1:0", **settings):
        command = [*WONDERLAND, "backend", "serve", "--json", "--listen", listen, "--demo"]
        command += ["--connection", str(self.directory / "ledger" / "connection.json"), "--database", self.database]
        with self.errors.open("ab") as errors:
            begun = await asyncio.create_subprocess_exec(
                *command,
                *arguments,
                stdout=asyncio.subprocess.PIPE,
                stderr=errors,
                env=os.environ | {"NO_COLOR": "1"} | self.bus.settings(name) | settings,
            )
        process = Process(begun)
        self.running.append(process)
        return process

    async def close(self):
        for each in self.running:
            with suppress(ProcessLookupError):
                each.go_on()
            await each.kill()


@asynccontextmanager
async def pair(directory, database):
    """A bus, and room for backends on it."""
    bus = Bus(directory)
    await bus.start()
    found = Pair(directory, database, bus)
    try:
        yield found
    finally:
        await found.close()
        await bus.kill()


async def cookie(url, token):
    """Signs in; the cookie is good at every backend of the database."""
    async with httpx.AsyncClient(base_url=url, trust_env=False, verify=PLAIN) as http:
        answer = await http.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200, answer.text
        return "; ".join(f"{name}={value}" for name, value in answer.cookies.items())


def client(url, cookie):
    """Somebody who is signed in, at one of the backends."""
    headers = {"Cookie": cookie, "Origin": url}
    return httpx.AsyncClient(base_url=url, trust_env=False, verify=PLAIN, headers=headers, timeout=60)


KEYS = {"pads": "pad_id", "tracks": "uav_id", "estimates": "uav_id", "sessions": "session_id", "alerts": "alert_id"}


class Console:
    """What a browser does with the live interface: it resumes, goes on to the next address, and keeps the picture."""

    def __init__(self, *urls, cookie):
        self._urls = itertools.cycle(urls)
        self._cookie = cookie
        self.place = None
        self.connections = 0
        self.beginnings = 0
        """Hellos with a snapshot."""
        self.digests = {}
        """Of each delta's bytes, by epoch and number."""
        self.picture = {kind: {} for kind in KEYS}
        self.verdicts = {}
        self.told_twice = []
        self.holes = []
        self.status = {}
        self.refused = 0
        """With which code a backend ended the last connection."""
        self.frames = 0
        self.last_s = 0.0
        self._task = asyncio.create_task(self._run())

    async def close(self):
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self):
        while True:
            url = next(self._urls)
            since = "" if self.place is None else f"?since={self.place[0]}:{self.place[1]}"
            address = f"ws://{urlsplit(url).netloc}/api/v1/live{since}"
            try:
                async with websockets.connect(
                    address, additional_headers={"Cookie": self._cookie}, origin=url, open_timeout=3, max_size=None,
                    proxy=None, close_timeout=1,
                ) as socket:  # fmt: skip
                    self.connections += 1
                    while True:
                        # As the console: it gives up an open socket on which nothing comes.
                        self._take(await asyncio.wait_for(socket.recv(), 7))
            except websockets.ConnectionClosed as cause:
                self.refused = cause.rcvd.code if cause.rcvd is not None else 0
                await asyncio.sleep(0.25)
            except (OSError, TimeoutError, websockets.WebSocketException):
                await asyncio.sleep(0.25)

    def _take(self, text):
        frame = json.loads(text)
        self.frames += 1
        self.last_s = asyncio.get_running_loop().time()
        if frame["type"] == "hello":
            if not frame["resumed"]:
                self.beginnings += 1
                self.picture = {kind: {} for kind in KEYS}
                self.place = None
                self._epoch = frame["epoch"]
                self._seq = frame["seq"]
            elif self.place is None or self.place[0] != frame["epoch"]:
                self.holes.append(("resumed elsewhere", frame))
            return
        if frame["type"] == "snapshot":
            self._merge(frame)
            for verdict in frame.get("verdicts", ()):
                self.verdicts[verdict["session_id"]] = verdict
            if frame["part"] == frame["of"]:
                self.place = (self._epoch, self._seq)
            return
        epoch, seq = self.place
        if frame["seq"] == seq:
            self.status = frame.get("status", self.status)  # of the backend itself, no part of the frames
            return
        if frame["seq"] != seq + 1:
            self.holes.append((seq, frame["seq"]))
        self.place = (epoch, frame["seq"])
        self.digests[self.place] = hashlib.sha256(text.encode()).hexdigest()
        self._merge(frame)
        for verdict in frame.get("verdicts", ()):
            if verdict["session_id"] in self.verdicts:
                self.told_twice.append(verdict["session_id"])
            self.verdicts[verdict["session_id"]] = verdict

    def _merge(self, frame):
        for kind, key in KEYS.items():
            for item in frame.get(kind, ()):
                self.picture[kind][item[key]] = item
                if kind == "sessions" and item["state"] != "requested":
                    known = self.picture["estimates"].get(item["uav_id"])
                    if known is not None and known["session_id"] == item["session_id"]:
                        del self.picture["estimates"][item["uav_id"]]
                if kind == "alerts" and item["state"] not in {"open", "returned"}:
                    del self.picture["alerts"][item["alert_id"]]
        self.status = frame.get("status", self.status)

    @property
    def is_stale(self):
        return self.status.get("server", {}).get("stale_since_ms") is not None


async def snapshot(url, cookie):
    """What a console that comes now is shown: (epoch, seq), and everything by kind."""
    address = f"ws://{urlsplit(url).netloc}/api/v1/live"
    async with websockets.connect(
        address, additional_headers={"Cookie": cookie}, origin=url, max_size=None, proxy=None
    ) as socket:
        hello = json.loads(await socket.recv())
        parts = []
        while True:
            part = json.loads(await socket.recv())
            assert part["type"] == "snapshot"
            parts.append(part)
            if part["part"] == part["of"]:
                break
    found = {kind: {item[key]: item for part in parts for item in part.get(kind, ())} for kind, key in KEYS.items()}
    found["verdicts"] = [item for part in parts for item in part.get("verdicts", ())]
    return (hello["epoch"], hello["seq"]), found, parts


async def same_board(one, other, cookie, within_s=20):
    """What both show at the same number is the same, field for field; returns it."""
    async with asyncio.timeout(within_s):
        while True:
            (at, shown, _), (at_other, shown_other, _) = await asyncio.gather(
                snapshot(one, cookie), snapshot(other, cookie)
            )
            if at == at_other:
                assert shown == shown_other
                return shown
            await asyncio.sleep(0.03)


async def eventually(is_so, within_s=20, what=""):
    """Wait for it."""
    try:
        async with asyncio.timeout(within_s):
            while not (found := is_so()):
                await asyncio.sleep(0.02)
            return found
    except TimeoutError:
        raise AssertionError(f"not within {within_s} s: {what or is_so}") from None
