"""An authority that issues tokens, a DSS by the F3411 interface file, and backends: all over real HTTP on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import uuid
from pathlib import Path

import httpx
import orjson
import pytest
import uvicorn
from joserfc.jwk import ECKey, RSAKey
from msgspec import Raw

from kit import PLAIN
from kit.databases import copy_migrated
from kit.dss_server import Dss
from kit.token_server import Authority
from wonderland_backend.agents.connected import Agent
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.http.times import now_ms
from wonderland_backend.ingest.batch import read
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings

START_MS = 1_800_000_000_000
TURKU = (604_518_000, 222_666_000)


class Clock:
    """Milliseconds that a test sets."""

    def __init__(self, now=START_MS):
        self.now_ms = now

    def __call__(self):
        return self.now_ms

    def pass_s(self, seconds):
        self.now_ms += int(seconds * 1000)


@pytest.fixture
def clock():
    return Clock()


@contextlib.asynccontextmanager
async def served(app, bound=None):
    """An ASGI application on a free port of loopback: its address."""
    bound = bound or Listen("127.0.0.1", 0).open()
    server = uvicorn.Server(uvicorn.Config(app, lifespan="off", log_config=None, access_log=False))
    server.capture_signals = contextlib.nullcontext
    task = asyncio.create_task(server.serve([bound]))
    while not server.started:
        await asyncio.sleep(0.005)
    try:
        yield f"http://127.0.0.1:{bound.getsockname()[1]}"
    finally:
        server.should_exit = True
        await task
        bound.close()


@pytest.fixture(name="served")
def _served():
    return served


@pytest.fixture(scope="session")
def keys():
    """Signing keys: making them takes longer than most tests."""
    parameters = [{"kid": "first"}, {"kid": "second"}]
    return {
        "first": RSAKey.generate_key(2048, parameters[0]),
        "second": RSAKey.generate_key(2048, parameters[1]),
        "elliptic": ECKey.generate_key("P-256", {"kid": "elliptic"}),
        "stranger": RSAKey.generate_key(2048, {"kid": "first"}),
    }


@pytest.fixture
async def authority(keys):
    found = Authority(keys)
    async with served(found.app) as url:
        found.url = url
        yield found


@pytest.fixture
async def dss(authority):
    found = Dss(authority)
    async with served(found.app) as url:
        found.url = url
        yield found


class Uss:
    """A backend that other systems can reach, and one of them."""

    def __init__(self, backend, url, http, authority):
        self.backend = backend
        self.uspace = backend.parts.uspace
        self.url = url
        self.http = http
        self.authority = authority
        self.seq = 0

    async def get(self, path, scope="rid.display_provider", **options):
        headers = {"Authorization": f"Bearer {self.authority.token(scope=scope)}"} if scope else {}
        return await self.http.get(path, headers=headers, **options)

    async def ask(self, method, path, scope, *, sub="other-uss", headers=None, **options):
        headers = {"Authorization": f"Bearer {self.authority.token(scope=scope, sub=sub)}"} | (headers or {})
        return await self.http.request(method, path, headers=headers, **options)

    async def heard(self, *bodies, t_ms=None):
        """What a pad's receiver heard, the way it comes: checked, made durable, told."""
        t_ms = t_ms or self.uspace.clock()
        records = []
        for body in bodies:
            self.seq += 1
            records.append({"seq": self.seq, "kind": "track", "t_ms": t_ms, "body": body})
        agent = Agent("pad", "pad-1", "0" * 32, "PadMSP", b"", lambda _: None)
        batch = read(agent, [Raw(orjson.dumps(each)) for each in records], acknowledged=0, now_ms=self.uspace.clock())
        assert batch.rejected == []
        await (await self.backend.parts.intake.take_batch(batch))

    async def set_up(self, role="inspector"):
        """Somebody can sign in: until then a server serves nothing else."""
        return await self.backend.parts.sign_ins.new_token(role.title(), (role,))

    async def sign_in(self, role="inspector"):
        token = await self.set_up(role)
        answer = await self.http.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200, answer.text


def track(uav_id="1581F5FKD229400A1234", lat=TURKU[0], lng=TURKU[1], **more):
    """The body of a `track` record."""
    body = {
        "uav_id": uav_id, "lat_e7": lat, "lon_e7": lng, "transport": "udp", "height_mm": 40_000, "accuracy_mm": 3_000,
        "height_accuracy_mm": 10_000, "speed_mm_s": 5_250, "track_cdeg": 9_000, "vertical_mm_s": -500,
        "status": "airborne", "operator_id": "FIN87astrdge12k8", "above_mm": 12_000, "above": "takeoff",
        "speed_accuracy_mm_s": 300, "time_accuracy_ms": 100, "ua_type": 2, "eu_category": 1, "eu_class": 3,
        "operator_lat_e7": 604_520_000, "operator_lon_e7": 222_670_000, "operator_height_mm": 30_000,
        "operator_place": "takeoff",
    }  # fmt: skip
    return {name: value for name, value in (body | more).items() if value is not None}


@pytest.fixture(name="track")
def _track():
    return track


@pytest.fixture
def new_uss(authority, tmp_path):
    """Makes backends that trust the authority: `async with new_uss(dss=[…]) as uss`."""

    @contextlib.asynccontextmanager
    async def make(*, clock=now_ms, client_id="uss", dss=(), console=Path("/nowhere"), **options):
        path = copy_migrated(tmp_path / f"{uuid.uuid4().hex}.db")
        with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
            url = f"http://127.0.0.1:{bound.getsockname()[1]}"
            uspace = {
                "issuers": [{"issuer": authority.url, "jwks_url": f"{authority.url}/jwks"}],
                "token_url": f"{authority.url}/token",
                "client_id": client_id,
                "client_secret": authority.secret,
                "dss": dss,
                "allowed_hosts": ["127.0.0.1"],
                "serve": "heard",
            }
            settings = Settings(public_url=url, tick_ms=20, uspace=uspace | options)
            database = Database(f"sqlite:///{path}")
            backend = Backend(
                settings,
                database=database,
                allowed_hosts=frozenset({"127.0.0.1"}),
                clock=clock,
                console_directory=console,
            )
            server = new_server(backend.app, settings)
            async with backend.running():
                task = asyncio.create_task(server.serve([bound]))
                while not server.started:
                    await asyncio.sleep(0.005)
                try:
                    async with httpx.AsyncClient(base_url=url, trust_env=False, verify=PLAIN, timeout=20) as http:
                        uss = Uss(backend, url, http, authority)
                        await uss.set_up()
                        yield uss
                finally:
                    backend.parts.hub.close()
                    server.should_exit = True
                    await task

    return make


@pytest.fixture
def until():
    """Waits for something to become true."""

    async def wait(found, timeout_s=15):
        async with asyncio.timeout(timeout_s):
            while True:
                value = found()
                if asyncio.iscoroutine(value):
                    value = await value
                if value:
                    return value
                await asyncio.sleep(0.05)

    return wait
