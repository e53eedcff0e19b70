"""A house for tests of the registry: a real embedded ledger, a real backend on it, people with keys of their own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import threading
import time
from base64 import urlsafe_b64decode, urlsafe_b64encode

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from kit import PLAIN
from kit.databases import copy_migrated
from kit.openings import keep_usual, opening, told
from kit.stepping_up import ConfirmingClient
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning
from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.ledger.access import LedgerAccess
from wonderland_backend.listening import Listen
from wonderland_backend.mirror.source import GatewaySource
from wonderland_backend.serve import new_server
from wonderland_backend.settings import Settings
from wonderland_backend.transactions.registrar import registrar_of
from wonderland_chaincode.contract import CONTRACT
from wonderland_edge_agent.geodesy import frame_at
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.signing import key_signer

DAY_MS = 86_400_000


def base64url(data):
    return urlsafe_b64encode(data).rstrip(b"=").decode()


def request_pem(name, key):
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    signed = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, hashes.SHA256())
    return signed.public_bytes(Encoding.PEM).decode()


def commissioning(now_ms, lat=60.4518, lon=22.2666):
    """A pad with four anchors, 6 m apart, whose bias grows with the distance."""
    places = ((-3_000, -3_000), (3_000, -3_000), (3_000, 3_000), (-3_000, 3_000))
    bias = tuple(
        BiasPoint(range_mm=each, bias_mm=20 + each // 500, sigma_mm=20 + each // 1_000)
        for each in (2_000, 10_000, 40_000)
    )
    return Commissioning(
        frame=frame_at(round(lat * 1e7), round(lon * 1e7), 20_000),
        anchors=tuple(
            Anchor(anchor_id=f"a{i}", mac=i + 1, east_mm=x, north_mm=y, up_mm=500 * i, survey_sigma_mm=10, bias=bias)
            for i, (x, y) in enumerate(places)
        ),
        range_sigma_mm=60,
        installation_sigma_mm=30,
        max_range_mm=60_000,
        valid_from_ms=now_ms - DAY_MS,
        valid_until_ms=now_ms + 300 * DAY_MS,
        method="Tachymeter survey; calibration at three distances",
    )


class Somebody:
    """A signed-in person with a key of hers, as a browser would have them, by HTTP."""

    def __init__(self, house, name, roles, msp_id=""):
        self.house = house
        self.http = ConfirmingClient(base_url=house.url, trust_env=False, verify=PLAIN, timeout=30)
        token = house.run(house.backend.parts.sign_ins.new_token(name, roles, msp_id=msp_id))
        answer = self.http.post("/api/v1/session", json={"token": token})
        assert answer.status_code == 200, answer.text
        self.key = ec.generate_private_key(ec.SECP256R1())
        self.certificate_sha256 = None

    def get(self, path, **options):
        return self.http.get(f"/api/v1{path}", **options)

    def post(self, path, body=None, **options):
        return self.http.post(f"/api/v1{path}", json=body, **options)

    def enrol(self, role, name, msp_id=None):
        """By a one-time secret of the organisation's CA."""
        invited = self.house.administration.invite(name, role=role, pol_id=name, msp_id=msp_id)
        body = {"msp_id": invited.msp_id, "request": request_pem(name, self.key), "secret": invited.secret}
        answer = self.post("/signing-keys/enrol", body)
        if answer.status_code == 201:
            self.certificate_sha256 = answer.json()["certificate_sha256"]
        return answer

    def sign(self, text):
        message = text if isinstance(text, bytes) else decoded(text)
        return base64url(key_signer(self.key)(message))

    def propose(self, function, argument, seen=None, opening=None):
        body = {"function": function, "argument": argument, "certificate_sha256": self.certificate_sha256}
        if seen is not None:
            body["seen"] = seen
        if opening is not None:
            body["opening"] = told(opening)
        return self.post("/transactions/proposals", body)

    def endorse(self, proposed):
        path = f"/transactions/proposals/{proposed['tx_id']}/endorse"
        return self.post(path, {"signature": self.sign(proposed["to_sign"])})

    def submit(self, endorsed):
        path = f"/transactions/proposals/{endorsed['tx_id']}/submit"
        return self.post(path, {"signature": self.sign(endorsed["to_sign"])})

    def settled(self, tx_id, within_s=20):
        """Its state once the ledger has spoken."""
        until = time.monotonic() + within_s
        while time.monotonic() < until:
            found = self.get(f"/transactions/proposals/{tx_id}").json()
            if found["state"] not in {"proposed", "endorsed", "submitted"}:
                return found
            time.sleep(0.05)
        raise AssertionError(f"no outcome within {within_s} s: {found}")

    def change(self, function, argument, seen=None, opening=None):
        """All of it, to the end."""
        proposed = self.propose(function, argument, seen, opening)
        assert proposed.status_code == 201, proposed.text
        endorsed = self.endorse(proposed.json())
        assert endorsed.status_code == 200, endorsed.text
        if endorsed.json()["state"] != "endorsed":
            return endorsed.json()
        submitted = self.submit(endorsed.json())
        assert submitted.status_code == 202, submitted.text
        return self.settled(proposed.json()["tx_id"])


def decoded(text):
    return urlsafe_b64decode(text + "=" * (-len(text) % 4))


class House:
    """Ledger and backend in a thread with an event loop of its own."""

    def __init__(self, directory, console=None, **settings):
        self.directory = directory
        self.console = console
        self.settings = settings
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self.stack = contextlib.AsyncExitStack()
        self.backend = None
        self.port = 0
        self.people = []

    def run(self, coroutine, timeout_s=30):
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(timeout_s)

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}"

    @property
    def administration(self):
        return DirectoryAdministration(self.ledger.directory)

    def registrar(self):
        return registrar_of(self.directory / "ledger", embedded=True)

    def now_ms(self):
        return time.time_ns() // 1_000_000

    def start(self):
        self.run(self._start_ledger())
        self.start_backend()

    def start_backend(self):
        self.run(self._start_backend())

    def stop_backend(self):
        self.run(self._backend_stack.aclose())

    def close(self):
        for each in self.people:
            each.http.close()
        self.run(self._backend_stack.aclose())
        self.run(self.stack.aclose())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()

    async def _start_ledger(self):
        limits = LedgerSettings(limits=BatchLimits(time_ms=5))
        self.ledger = await self.stack.enter_async_context(
            EmbeddedLedger(self.directory / "ledger", {"pol": CONTRACT}, limits)
        )
        self.connection = self.ledger.connection
        self.channel = await self.stack.enter_async_context(self.connection.open_channel())

    def contract(self, name):
        connection = self.connection
        gateway = Gateway(self.channel, connection.identity(name), connection.signer(name))
        return gateway.network(connection.channel).contract(connection.chaincode)

    def send(self, name, function, argument):
        """As one of the ledger's own identities, beside the console."""

        async def work():
            return await self.contract(name).submit(function, json.dumps(argument))

        return self.run(work())

    async def _start_backend(self):
        connection = self.connection
        self._backend_stack = contextlib.AsyncExitStack()
        database = Database(f"sqlite:///{copy_migrated(self.directory / 'registry.db')}")
        self._backend_stack.push_async_callback(database.close)
        await keep_usual(database, [f"OH-DRN-0{number}" for number in ("417", "640", "871")])
        gateway = Gateway(self.channel, connection.identity("mirror"), connection.signer("mirror"))
        demo = self.settings.get("demo", False)
        self.backend = Backend(
            Settings(console=self.console, **self.settings),
            database=database,
            source=GatewaySource(gateway.network(connection.channel)),
            ledger=LedgerAccess(connection, self.channel, gateway),
            demo_registrar=self.registrar() if demo else None,
            channel=connection.channel,
            chaincode=connection.chaincode,
            ledger_kind=connection.ledger.kind,
            ledger_notice=connection.ledger.notice,
            allowed_hosts=frozenset({"127.0.0.1"}),
            console_directory=self.console,
        )
        bound = Listen("127.0.0.1", self.port).open()
        self.port = bound.getsockname()[1]
        self._backend_stack.callback(bound.close)
        await self._backend_stack.enter_async_context(self.backend.running())
        server = new_server(self.backend.app, self.backend.settings)
        task = asyncio.create_task(server.serve([bound]))

        async def end():
            self.backend.parts.hub.close()
            server.should_exit = True
            await task

        self._backend_stack.push_async_callback(end)
        while not server.started:
            await asyncio.sleep(0.005)

    def person(self, name, *roles, msp_id=""):
        self.people.append(Somebody(self, name, roles, msp_id))
        return self.people[-1]

    def link(self, name="Anna Officer", roles=("admin",)):
        token = self.run(self.backend.parts.sign_ins.new_token(name, roles))
        return f"{self.url}/#token={token}"

    def wait_mirrored(self, height=None):
        """Until the database has what the ledger has."""

        async def work():
            wanted = self.ledger.chain.height if height is None else height
            async with asyncio.timeout(20):
                while self.backend.parts.mirror.mirrored < wanted:
                    await asyncio.sleep(0.01)

        self.run(work())

    def furnish(self):
        """A pad and three drones, of the demo's organisations."""
        now = self.now_ms()
        where = {"lat_e7": 604518000, "lon_e7": 222666000, "height_mm": 20_000}
        pad = {"pad_id": "aurajoki-2", "name": "Aurajoki 2", "operator_id": "turku-city", **where}
        self.send("pad_operator", "RegisterPad", pad)
        self.send(
            "pad_operator", "CommissionPad", {"pad_id": "aurajoki-2", "commissioning": commissioning(now).to_json()}
        )
        for number, model in (("417", "Falcon 4"), ("640", "Falcon 4"), ("871", "Crane X")):
            drone = {
                "uav_id": f"OH-DRN-0{number}",
                "operator_id": "arctic-air",
                "registration_commitment": opening(f"OH-DRN-0{number}").commitment,
                "model": model,
            }
            self.send("fleet_operator", "RegisterUav", drone)
        self.wait_mirrored()


def new_house(directory, template, **options):
    """One of its own, from a ledger that was furnished once."""
    shutil.copytree(template / "ledger", directory / "ledger")
    house = House(directory, **options)
    house.start()
    house.wait_mirrored()
    return house
