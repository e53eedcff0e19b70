"""A server that nobody has set up, its visitors, and an OpenID provider in Node."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess

import pytest
from kit import PLAIN
from kit.authenticator import Authenticator
from kit.console import RealBackend
from kit.openid_provider import SECRET, command
from kit.stepping_up import ConfirmingAsyncClient

from wonderland_backend.listening import Listen
from wonderland_backend.serve import new_server
from wonderland_backend.settings.oidc import OidcSettings


@pytest.fixture(name="Authenticator")
def _new_authenticator():
    return Authenticator


@pytest.fixture(scope="module")
def reached():
    """Passkeys are bound to a name: Chromium finds localhost here, and nothing else."""
    return "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost"


class Server(RealBackend):
    """A backend that serves the built console and that nobody has set up."""

    HOSTS = frozenset({"localhost", "127.0.0.1"})

    @property
    def url(self):
        return f"http://localhost:{self.port}"

    def set_up_link(self):
        from wonderland_backend.people.links import at_start

        return (
            f"{self.url}/#token={self._run(at_start(self.backend.database, self.backend.parts.sign_ins, demo=False))}"
        )

    def invite(self, name):
        """An invitation by the server itself; the person's id."""
        from wonderland_backend.people import store
        from wonderland_backend.people.schemas import Invitation
        from wonderland_backend.person import Account

        async def make():
            async with self.backend.database.write() as connection:
                wanted = Invitation(name=name, roles=["inspector"])
                account = Account("", "tests")
                await store.create(connection, account, wanted, "f" * 32, state="invited", now_ms=self.now_ms())

        self._run(make())
        return "f" * 32

    def rename(self, name, to):
        """As another administrator does."""
        from sqlalchemy import update

        from wonderland_backend.db.tables.people import PersonRow

        async def change():
            async with self.backend.database.write() as connection:
                row = update(PersonRow).where(PersonRow.name == name)
                await connection.execute(row.values(name=to, revision=PersonRow.revision + 1))

        self._run(change())


@pytest.fixture
def server(authorities, tmp_path, built_console):
    running = Server(authorities, tmp_path, built_console)
    try:
        running.start()
        yield running
    finally:
        running.close()


@pytest.fixture
def oidc_server(authorities, tmp_path, built_console, free_port):
    """A server that knows a real OpenID provider."""
    url = f"http://localhost:{free_port}/api/v1/sign-in/oidc/callback"
    with subprocess.Popen(command(url), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as provider:
        oidc = OidcSettings(
            issuer=json.loads(provider.stdout.readline())["issuer"],
            client_id="wonderland",
            client_secret=SECRET,
            name="Example",
        )
        running = Server(authorities, tmp_path, built_console, oidc=oidc)
        running.port = free_port
        try:
            running.start()
            yield running
        finally:
            running.close()
            provider.terminate()


class Visitor:
    """A browser: its cookies, and an authenticator."""

    def __init__(self, http, authenticator):
        self.http = http
        self.authenticator = http.authenticator = authenticator

    async def call(self, method, path, body=None, status=200):
        answer = await self.http.request(method, f"/api/v1{path}", json=body)
        assert answer.status_code == status, (answer.status_code, answer.text)
        return answer.json() if answer.content else None

    async def accept(self, token, *, name=None, passkey="laptop"):
        """Open a link and register a passkey through it."""
        body = {"token": token} | ({"name": name} if name else {})
        asked = await self.call("POST", "/sign-in/link/passkey/options", body)
        credential = self.authenticator.create(asked["options"])
        answer = {"ceremony": asked["ceremony"], "credential": credential, "passkey_name": passkey}
        return await self.call("POST", "/sign-in/link/passkey", answer)

    async def sign_in(self, status=200):
        asked = await self.call("POST", "/sign-in/passkey/challenge")
        answer = {"ceremony": asked["ceremony"], "credential": self.authenticator.get(asked["options"])}
        return await self.call("POST", "/sign-in/passkey", answer, status)

    async def add_passkey(self, name="phone", status=200):
        asked = await self.call("POST", "/me/passkeys/options")
        body = {"ceremony": asked["ceremony"], "credential": self.authenticator.create(asked["options"]), "name": name}
        return await self.call("POST", "/me/passkeys", body, status)


@pytest.fixture
def free_port():
    """A port that was free just now."""
    with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
        return bound.getsockname()[1]


@contextlib.asynccontextmanager
async def _serve_at(backend, port):
    bound = Listen("127.0.0.1", port).open()
    server = new_server(backend.app, backend.settings)
    async with backend.running():
        task = asyncio.create_task(server.serve([bound]))
        while not server.started:
            await asyncio.sleep(0.005)
        try:
            yield Fresh(backend, bound.getsockname()[1])
        finally:
            backend.parts.hub.close()
            server.should_exit = True
            await task
            bound.close()


@pytest.fixture
def serve_at():
    return _serve_at


@pytest.fixture
async def fresh(new_backend):
    """A backend that nobody has set up, at a port of this machine's name."""
    async with _serve_at(new_backend(allowed_hosts=frozenset({"127.0.0.1", "localhost"})), 0) as server:
        yield server


class Fresh:
    """A running backend, and visitors to it."""

    def __init__(self, backend, port):
        self.backend = backend
        self.context, self.parts = backend.context, backend.parts
        self.url = f"http://localhost:{port}"
        self.address = f"http://127.0.0.1:{port}"

    async def set_up_token(self):
        from wonderland_backend.people.links import at_start

        return await at_start(self.backend.database, self.parts.sign_ins, demo=False)

    @contextlib.asynccontextmanager
    async def visitor(self, authenticator=None):
        headers = {"Origin": self.url, "Host": self.url.removeprefix("http://")}
        async with ConfirmingAsyncClient(base_url=self.address, trust_env=False, verify=PLAIN, headers=headers) as http:
            yield Visitor(http, authenticator or Authenticator(self.url))

    @contextlib.asynccontextmanager
    async def administrator(self):
        """The first administrator, signed in."""
        async with self.visitor() as ada:
            await ada.accept(await self.set_up_token(), name="Ada")
            yield ada
