"""Backends that run on a chain of valid blocks, clients of them, and an agent's side of the ingest protocol."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
from pathlib import Path

import pytest
import websockets
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from kit import PLAIN
from kit.chain import START_MS, Tx
from kit.facts import Facts
from kit.openings import keep_usual
from kit.stepping_up import ConfirmingAsyncClient
from wonderland.telemetry import Credentials, end_point_seen, signed_text
from wonderland_backend.app import Backend
from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.signing import key_signer


class Clock:
    """Milliseconds that a test sets."""

    def __init__(self, now_ms=START_MS):
        self.now_ms = now_ms

    def __call__(self):
        return self.now_ms


@pytest.fixture
def clock():
    return Clock()


class Running:
    """A backend that serves, and a client of it."""

    def __init__(self, backend, url, http):
        self.backend = backend
        self.url = url
        self.http = http
        self.bus = None
        """Where agents come by a bus (`kit.bus_agents`)."""

    @property
    def context(self):
        return self.backend.context

    @property
    def parts(self):
        return self.backend.parts

    async def sign_in(self):
        token = await self.parts.sign_ins.new_token("Inspector", ("inspector",))
        answer = await self.http.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200, answer.text

    async def get(self, path, **options):
        return await self.http.get(f"/api/v1{path}", **options)

    async def json(self, path, **parameters):
        answer = await self.get(path, params=parameters)
        assert answer.status_code == 200, answer.text
        return answer.json()

    async def mirrored(self, height):
        async with asyncio.timeout(10):
            while self.parts.mirror.mirrored < height:
                assert self.parts.mirror.halted is None
                await asyncio.sleep(0.005)

    def cookie(self):
        return "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())

    def connect(self, path, **options):
        if path == "/ingest" and self.bus is not None:
            return self.bus.connect()
        return websockets.connect(self.url.replace("http", "ws", 1) + path, proxy=None, compression=None, **options)

    def live(self, since=None, packed=False, **options):
        query = "?packed=zlib" if packed else "?"
        query += f"&since={since}" if since else ""
        headers = {"Cookie": self.cookie()}
        return self.connect(f"/api/v1/live{query}", additional_headers=headers, **options)


@contextlib.asynccontextmanager
async def serving(backend):
    """Serve a backend on a free port; yields a signed-in client."""
    server = new_server(backend.app, backend.settings)
    bound = Listen("127.0.0.1", 0).open()
    url = f"http://127.0.0.1:{bound.getsockname()[1]}"
    await keep_usual(backend.database)
    async with backend.running():
        task = asyncio.create_task(server.serve([bound]))
        while not server.started:
            await asyncio.sleep(0.005)
        try:
            async with ConfirmingAsyncClient(base_url=url, trust_env=False, verify=PLAIN, timeout=30) as http:
                running = Running(backend, url, http)
                await running.sign_in()
                yield running
        finally:
            backend.end_streams()
            server.should_exit = True
            await task
            bound.close()


@pytest.fixture(name="serving")
def _serving():
    return serving


@pytest.fixture(name="new_backend")
def _new_backend(database, clock, tmp_path):
    def make(source=None, *, database=database, clock=clock, allowed_hosts=frozenset({"127.0.0.1"}), **options):
        key = tmp_path / "webhook.key"
        settings = Settings(**{"tick_ms": 20, "webhook_key_file": key, **options})
        return Backend(
            settings,
            database=database,
            source=source,
            channel="wonderland",
            chaincode="pol",
            ledger_kind="embedded",
            ledger_notice="no multi-party trust",
            allowed_hosts=allowed_hosts,
            clock=clock,
            console_directory=Path("/nowhere"),
        )

    return make


def furnish(chain):
    """A pad, drones and three sessions."""
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_pad("pad-2", commissioned=False), facts.put_uav(), facts.put_uav("uav-2"))
    chain.add(facts.grant(), facts.set_policy(), facts.request("one"))
    chain.add(facts.decide("one"), Tx(code=11))
    chain.add(facts.complete("one"), facts.request("two", uav_id="uav-2", t_ms=START_MS + 10_000))
    chain.add(facts.decide("two", uav_id="uav-2", t_ms=START_MS + 10_000, outcome="refuted"))
    chain.add(facts.request("three", pad_id="pad-2", t_ms=START_MS + 20_000))


@pytest.fixture
async def running(new_backend, chain, source_of):
    """A backend on a chain with a pad, drones and three sessions."""
    furnish(chain)
    async with serving(new_backend(source_of(chain))) as client:
        await client.mirrored(chain.height)
        yield client


def credentials_of(enrolment):
    """What an enrolled agent signs in with."""
    found = enrolment.identity
    signer = key_signer(load_pem_private_key(enrolment.private_key_pem, None))
    return Credentials.of(found.role, found.pol_id, found, signer)


class AgentClient:
    """An agent's side of the ingest protocol, for tests to do right and wrong."""

    def __init__(self, socket, enrolment, *, agent="pad", agent_id="pad-1", spool="0" * 32, msp_id="PadMSP"):
        self.socket = socket
        self.enrolment = enrolment
        self.agent = agent
        self.agent_id = agent_id
        self.spool = spool
        self.msp_id = msp_id
        self.seq = 0
        self._end_point = None
        if hasattr(socket, "enrolment"):  # on a bus, where one is known before the first word
            socket.enrolment = enrolment

    @property
    def end_point(self):
        """What the connection shows, once it is there; or another one, to lie about."""
        if self._end_point is not None:
            return self._end_point
        tls = self.socket.tls if hasattr(self.socket, "tls") else self.socket.transport.get_extra_info("ssl_object")
        return end_point_seen(tls)

    @end_point.setter
    def end_point(self, other):
        self._end_point = other

    async def receive(self):
        return json.loads(await asyncio.wait_for(self.socket.recv(), 5))

    async def send(self, message):
        await self.socket.send(message if isinstance(message, str | bytes) else json.dumps(message))

    async def hello(self, **change):
        challenge = await self.receive()
        assert challenge["type"] == "challenge"
        text = signed_text(
            nonce=challenge["nonce"],
            end_point=self.end_point,
            agent=self.agent,
            agent_id=self.agent_id,
            spool=self.spool,
        )
        signature = key_signer(load_pem_private_key(self.enrolment.private_key_pem, None))(text)
        message = {
            "type": "hello",
            "protocol": "wonderland-ingest/1",
            "agent": self.agent,
            "id": self.agent_id,
            "spool": self.spool,
            "msp_id": self.msp_id,
            "certificate": self.enrolment.certificate_pem.decode(),
            "tls_server_end_point": self.end_point,
            "signature": base64.urlsafe_b64encode(signature).rstrip(b"=").decode(),
        }
        await self.send(message | change)
        return await self.receive()

    async def report(self, *records, t_ms=START_MS):
        entries = []
        for kind, body in records:
            self.seq += 1
            entries.append({"seq": self.seq, "kind": kind, "t_ms": t_ms, "body": body})
        await self.send({"type": "records", "records": entries})
        return await self.receive()


@pytest.fixture(name="agent_client")
def _agent_client(authorities):
    def make(socket, *, agent="pad", agent_id="pad-1", msp_id="PadMSP", **options):
        enrolment = options.pop("enrolment", None) or authorities.enrol(agent_id, msp_id, role=agent, id=agent_id)
        return AgentClient(socket, enrolment, agent=agent, agent_id=agent_id, msp_id=msp_id, **options)

    return make


@pytest.fixture(name="ledger_error")
def _ledger_error():
    return LedgerError
