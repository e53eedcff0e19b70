"""How agents sign in where strangers are: a sign-in cannot be passed on, and agents have a listener of their own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import ssl
import subprocess
import sys

import pytest
import trustme
import websockets
from kit.backend import AgentClient, credentials_of
from pydantic import ValidationError

from wonderland.telemetry import end_point_of, tls_of
from wonderland_backend import handshakes, listening
from wonderland_backend.errors import SettingsError
from wonderland_backend.listening import Listen, Sockets, only_agents
from wonderland_backend.registry.queries import organisations
from wonderland_backend.serve import new_agents_server, new_server
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Uplink, WebSocketTransport
from wonderland_fabric_gateway.ca import Kind
from wonderland_fabric_gateway.connection import ClientTls

START_MS = 1_800_000_000_000
NO_WAY_IN = (ssl.SSLError, ConnectionError, websockets.WebSocketException, EOFError)
HEALTH = ("health", {"spool": {"records": 3, "bytes": 900, "dropped": 0}, "prekeys": 7, "version": "0.1.0"})


class Web:
    """An authority that browsers and agents trust, and the certificates that it gave."""

    def __init__(self, directory):
        self.directory = directory
        self.ca = trustme.CA()
        self.file = directory / "web-ca.pem"
        self.ca.cert_pem.write_to_path(self.file)

    def server(self, name):
        leaf = self.ca.issue_cert("localhost", "127.0.0.1")
        path = self.directory / f"{name}.pem"
        leaf.private_key_and_cert_chain_pem.write_to_path(path)
        return path, ssl.PEM_cert_to_DER_cert(leaf.cert_chain_pems[0].bytes().decode())


@pytest.fixture
def web(tmp_path):
    return Web(tmp_path)


@contextlib.asynccontextmanager
async def begun(backend):
    """Running, set up, and knowing the channel's organisations."""
    async with backend.running():
        await backend.parts.sign_ins.new_token("Admin", ("admin",))
        async with asyncio.timeout(10):
            while not backend.parts.members.msp_ids:
                await asyncio.sleep(0.01)
        yield


@contextlib.asynccontextmanager
async def serving(*servers):
    """Each (server, bound socket); yields their ports."""
    tasks = [asyncio.create_task(server.serve([bound])) for server, bound in servers]
    while not all(server.started for server, _ in servers):
        await asyncio.sleep(0.005)
    try:
        yield [bound.getsockname()[1] for _, bound in servers]
    finally:
        for server, _ in servers:
            server.should_exit = True
        await asyncio.gather(*tasks)


@contextlib.asynccontextmanager
async def with_listener(new_backend, source, web, **options):
    """A backend for everybody by TLS, and its listener for agents: yields it with the two ports."""
    own, _ = web.server("backend")
    backend = new_backend(
        source,
        allowed_hosts=frozenset({"console.example", "127.0.0.1"}),
        public_url="https://console.example",
        tls_certificate=own,
        agents={"listen": "127.0.0.1:0"},
        **options,
    )
    async with begun(backend):
        with Sockets.opened(backend.settings, Listen("127.0.0.1", 0)) as sockets:
            public = new_server(backend.app, backend.settings), sockets.everybody
            agents = (
                new_agents_server(only_agents(backend.app), backend.settings, backend.parts.members.tls),
                sockets.agents,
            )
            async with serving(public, agents) as ports:
                yield backend, *ports
        backend.end_streams()


def files_of(enrolment, directory, name=None):
    """What an agent keeps on its disk."""
    name = name or enrolment.identity.pol_id
    files = ClientTls(directory / f"{name}.pem", directory / f"{name}.key")
    files.certificate.write_bytes(enrolment.certificate_pem)
    files.key.write_bytes(enrolment.private_key_pem)
    return files


def dial(port, tls, path="/ingest", host="localhost"):
    return websockets.connect(f"wss://{host}:{port}{path}", ssl=tls, proxy=None, compression=None)


async def test_a_sign_in_that_was_made_for_another_server_is_not_taken(new_backend, source_of, chain, web, authorities):
    """The relay: an agent signs in to one server, which passes challenge and answer on to ours."""
    own, _ = web.server("ours")
    options = {"public_url": "https://localhost", "tls_certificate": own}
    backend = new_backend(source_of(chain), allowed_hosts=frozenset({"localhost"}), **options)
    _, other_der = web.server("theirs")
    enrolment = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    bound = Listen("127.0.0.1", 0).open()
    async with begun(backend), serving((new_server(backend.app, backend.settings), bound)) as (port,):
        tls = tls_of(web.file, None)
        async with dial(port, tls) as socket:
            relayed = AgentClient(socket, enrolment)
            relayed.end_point = end_point_of(other_der)
            answer = await relayed.hello()
            assert (answer["type"], answer["code"]) == ("refused", "another_server")
        async with dial(port, tls) as socket:
            plain = AgentClient(socket, enrolment)
            plain.end_point = ""
            assert (await plain.hello())["code"] == "another_server"
        async with dial(port, tls) as socket:
            altered = AgentClient(socket, enrolment)
            truth, altered.end_point = altered.end_point, end_point_of(other_der)
            assert (await altered.hello(tls_server_end_point=truth))["code"] == "not_authenticated"
        async with dial(port, tls) as socket:
            assert (await AgentClient(socket, enrolment).hello())["type"] == "welcome"


async def test_an_agent_that_was_led_to_a_relay_is_not_let_in(
    new_backend, source_of, chain, web, authorities, tmp_path
):
    """A server with a certificate that the agent trusts passes every frame on, both ways, to ours."""
    own, _ = web.server("ours")
    backend = new_backend(
        source_of(chain), allowed_hosts=frozenset({"localhost"}), public_url="https://localhost", tls_certificate=own
    )
    relays = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    relays.load_cert_chain(web.server("relay")[0])
    enrolment = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    bound = Listen("127.0.0.1", 0).open()
    async with begun(backend), serving((new_server(backend.app, backend.settings), bound)) as (port,):

        async def pass_on(agent):
            async def pump(one, other):
                async for frame in one:
                    await other.send(frame)

            async with dial(port, tls_of(web.file, None)) as ours:
                pumps = [asyncio.create_task(pump(*ends)) for ends in ((ours, agent), (agent, ours))]
                await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
                for each in pumps:
                    each.cancel()
                await asyncio.gather(*pumps, return_exceptions=True)

        async with (
            websockets.serve(pass_on, "127.0.0.1", 0, ssl=relays, compression=None) as relay,
            await Spool.open(tmp_path / "spool", owner="pad-1") as spool,
        ):
            url = f"wss://localhost:{relay.sockets[0].getsockname()[1]}/ingest"
            uplink = Uplink(
                WebSocketTransport(url, ssl_context=tls_of(web.file, None)), credentials_of(enrolment), spool
            )
            await uplink.start()
            try:
                async with asyncio.timeout(10):
                    while not (uplink.status.refusal or uplink.status.connected):
                        await asyncio.sleep(0.02)
                assert uplink.status.refusal == "another_server"
                assert not backend.parts.agents.is_connected("pad-1")
            finally:
                await uplink.close()


async def test_an_organisations_odd_certificate_stops_nobody(new_backend, source_of, chain, web, authorities, tmp_path):
    """Text before a PEM block is text that whoever writes the channel's configuration chooses."""
    good = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    async with with_listener(new_backend, source_of(chain), web) as (backend, _, agents):
        async with backend.database.read() as session:
            definitions = dict(await organisations.definitions(session))
        odd = json.loads(definitions["FleetMSP"])
        for name in ("root_certs", "tls_root_certs"):
            odd[name] = ["näin\n" + authorities.cas["OrdererMSP"].root_pem().decode()]
        backend.parts.members.configure((definitions | {"FleetMSP": json.dumps(odd)}).items())
        async with dial(agents, tls_of(web.file, files_of(good, tmp_path))) as socket:
            assert (await AgentClient(socket, good).hello())["type"] == "welcome"


def test_a_handshake_that_is_never_finished_is_ended(web, monkeypatch):
    monkeypatch.setattr(handshakes, "HEAD_S", 0.3)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(web.server("ours")[0])

    async def waited():
        loop = asyncio.get_running_loop()
        with contextlib.closing(Listen("127.0.0.1", 0).open()) as bound:
            server = await loop.create_server(asyncio.Protocol, sock=bound, backlog=9, ssl=context)
            reader, writer = await asyncio.open_connection(*bound.getsockname())
            try:
                with contextlib.suppress(ConnectionError):
                    await asyncio.wait_for(reader.read(), 20)  # by itself it would be a minute
            finally:
                writer.transport.abort()
                server.close()
                await server.wait_closed()

    with asyncio.Runner(loop_factory=listening.Loop) as runner:
        runner.run(waited())


def test_a_server_may_open_as_many_files_as_it_promises_connections():
    script = (
        "import resource; from wonderland_backend.listening import OTHER_FILES, allow_files;"
        "hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]; resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard));"
        "allow_files(700); print(resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= min(700 + OTHER_FILES, hard))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "True\n"


async def test_behind_a_proxy_agents_sign_in_to_its_certificate(
    running, new_backend, source_of, chain, web, tmp_path, authorities
):
    renewed, der = web.server("renewed")
    shown = tmp_path / "shown.pem"
    shown.write_bytes(web.server("proxy")[0].read_bytes())
    backend = new_backend(source_of(chain), agents={"proxy_certificates": (shown,)})
    enrolment = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    bound = Listen("127.0.0.1", 0).open()
    async with begun(backend), serving((new_server(backend.app, backend.settings), bound)) as (port,):

        async def hello(end_point):
            async with websockets.connect(f"ws://127.0.0.1:{port}/ingest", proxy=None) as socket:
                agent = AgentClient(socket, enrolment)
                agent.end_point = end_point
                return await agent.hello()

        assert (await hello(end_point_of(der)))["code"] == "another_server"
        shown.write_bytes(renewed.read_bytes())
        assert (await hello(end_point_of(der)))["type"] == "welcome", "read again: proxies renew theirs"


def test_files_without_certificates_are_named(new_backend, tmp_path):
    nothing = tmp_path / "nothing.pem"
    nothing.write_text("nothing\n")
    with pytest.raises(SettingsError, match=r"agents.proxy_certificates: .*nothing\.pem holds no certificate"):
        new_backend(agents={"proxy_certificates": (nothing,)})
    with pytest.raises(SettingsError, match=r"tls_certificate: .*absent\.pem holds no certificate"):
        new_backend(public_url="https://localhost", tls_certificate=tmp_path / "absent.pem")
    with pytest.raises(ValidationError, match="agents' own listener is TLS"):
        new_backend(agents={"listen": "127.0.0.1:0"})


async def test_agents_have_a_listener_of_their_own(new_backend, source_of, chain, web, authorities, tmp_path):
    enrolment = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    shown = files_of(enrolment, tmp_path)
    async with with_listener(new_backend, source_of(chain), web) as (_, public, agents):
        # The public listener has another name; agents' own may be reached by any that its certificate has.
        async with dial(public, tls_of(web.file, None), host="127.0.0.1") as socket:
            refused = await AgentClient(socket, enrolment).receive()
            assert (refused["type"], refused["code"]) == ("refused", "agents_listener")
        # The very agent, with its own uplink.
        async with await Spool.open(tmp_path / "spool", owner="pad-1") as spool:
            await spool.append("health", START_MS, HEALTH[1], evidence=False)
            uplink = Uplink(
                WebSocketTransport(f"wss://localhost:{agents}/ingest", ssl_context=tls_of(web.file, shown)),
                credentials_of(enrolment),
                spool,
            )
            await uplink.start()
            async with asyncio.timeout(10):
                while uplink.status.acknowledged_seq < 1:
                    await asyncio.sleep(0.02)
            await uplink.close()
        for path in ("/api/v1/live", "/ingest/"):
            with pytest.raises(websockets.InvalidStatus, match="403"):
                await dial(agents, tls_of(web.file, shown), path)


async def test_a_certificate_of_nobody_here_does_not_come_through_the_handshake(
    new_backend, source_of, chain, web, authorities
):
    strangers, _ = web.server("stranger")
    async with with_listener(new_backend, source_of(chain), web) as (_, _, agents):
        for shown in (None, ClientTls(strangers, strangers)):
            with pytest.raises(NO_WAY_IN):
                async with dial(agents, tls_of(web.file, shown)) as socket:
                    await socket.recv()


async def test_the_certificate_that_is_shown_is_of_the_organisation_that_signs_and_still_good(
    new_backend, source_of, chain, web, authorities, tmp_path
):
    good = authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")
    fleets = authorities.enrol("other", "FleetMSP", role="uav", id="other")
    revoked = authorities.enrol("pad-9", "PadMSP", role="pad", id="pad-9")
    async with with_listener(new_backend, source_of(chain), web) as (backend, _, agents):
        async with dial(agents, tls_of(web.file, files_of(fleets, tmp_path))) as socket:
            assert (await AgentClient(socket, good).hello())["code"] == "not_authenticated"
        # An agent whose key is in hardware shows the TLS certificate that its CA gave it.
        for_tls = authorities.cas["PadMSP"].enrol("pad-1", kind=Kind.TLS, hosts=("pad-1",))
        async with dial(agents, tls_of(web.file, files_of(for_tls, tmp_path, "tls"))) as socket:
            assert (await AgentClient(socket, good).hello())["type"] == "welcome"
        async with backend.database.read() as session:
            definitions = dict(await organisations.definitions(session))
        ca = authorities.cas["PadMSP"]
        ca.revoke(serial=revoked.certificate.serial)
        changed = json.loads(definitions["PadMSP"])
        changed["revocation_lists"] = [ca.revocation_list_pem().decode()]
        definitions["PadMSP"] = json.dumps(changed)
        backend.parts.members.configure(definitions.items())
        async with dial(agents, tls_of(web.file, files_of(revoked, tmp_path))) as socket:
            refused = await AgentClient(socket, good).hello()
            assert refused["code"] == "not_authenticated"
            assert "revoked" in refused["message"]


async def test_who_sends_more_than_its_share_is_read_later_and_loses_nothing(
    new_backend, source_of, chain, authorities
):
    backend = new_backend(source_of(chain), agents={"records_per_s": 20})
    bound = Listen("127.0.0.1", 0).open()
    async with begun(backend), serving((new_server(backend.app, backend.settings), bound)) as (port,):
        url = f"ws://127.0.0.1:{port}/ingest"
        async with websockets.connect(url, proxy=None) as loud, websockets.connect(url, proxy=None) as calm:
            enrol = authorities.enrol
            first = AgentClient(loud, enrol("pad-1", "PadMSP", role="pad", id="pad-1"))
            second = AgentClient(calm, enrol("pad-2", "PadMSP", role="pad", id="pad-2"), agent_id="pad-2")
            assert [(await each.hello())["type"] for each in (first, second)] == ["welcome"] * 2
            began = asyncio.get_running_loop().time()
            flood = asyncio.create_task(_flood(first, 50))
            assert (await second.report(HEALTH))["seq"] == 1
            assert not flood.done(), "nobody else waits"
            assert await flood == 50
            assert asyncio.get_running_loop().time() - began > 1.0, "50 records at 20 a second, 20 of them at once"


async def _flood(agent, count):
    for seq in range(1, count + 1):
        entry = {"seq": seq, "kind": "health", "t_ms": START_MS, "body": HEALTH[1]}
        await agent.send({"type": "records", "records": [entry]})
    async with asyncio.timeout(15):
        while (answer := await agent.receive())["seq"] < count:
            assert answer["type"] == "ack"
    return answer["seq"]
