"""Running a backend: its ledger, its listening socket, its server, its end."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import secrets
import signal
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

import click
import uvicorn
from starlette.types import ASGIApp

from wonderland.proof_contract import ProofContract
from wonderland.service_manager import ServiceManager
from wonderland_backend import console
from wonderland_backend.agents.listener import AgentsTls
from wonderland_backend.app import Backend
from wonderland_backend.audit.anchors import Anchors, AuditIdentity
from wonderland_backend.auth.site import LOCAL
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.errors import SettingsError, Standby
from wonderland_backend.http.times import now_ms
from wonderland_backend.http_protocol import Gate, protocols
from wonderland_backend.leader_election.lock import Lock, lock_of
from wonderland_backend.leader_election.standby import stand_by, stay_leader, wait_for
from wonderland_backend.ledger.access import LedgerAccess
from wonderland_backend.listening import Listen, Sockets, allow_files, hosts_of, only_agents, private_files
from wonderland_backend.mirror.second_opinion import GatewayAsked, SecondOpinion
from wonderland_backend.mirror.source import BlockSource, GatewaySource
from wonderland_backend.mirror.store import endorsement_policies
from wonderland_backend.mirror.verified import VerifiedSource
from wonderland_backend.people import links
from wonderland_backend.replicas.opened import can_follow, opened_bus
from wonderland_backend.settings import Settings
from wonderland_backend.transactions.enrolment import Registrar
from wonderland_backend.transactions.registrar import registrar_of
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.trust import Pins
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.files import write_atomic
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.gateways import Gateways

if TYPE_CHECKING:
    from wonderland_backend.replicas.bus import Bus

GRACE_S: Final = 5
BACKLOG: Final = 2048
CIPHERS: Final = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""Of TLS 1.2, beside those of 1.3. Uvicorn by itself asks for "TLSv1", which leaves CBC with SHA-1 and nothing else."""


@contextlib.asynccontextmanager
async def source_of(settings: Settings, database: Database) -> AsyncIterator[tuple[Connection, BlockSource]]:
    """The ledger that the settings name, and its blocks, checked. Raises `SettingsError`, `LedgerError`."""
    async with _ledger_of(settings) as (connection, source, _, _):
        yield connection, verified_source(settings, connection, source, database)


def verified_source(
    settings: Settings,
    connection: Connection,
    source: BlockSource,
    database: Database,
    opinion: SecondOpinion | None = None,
) -> VerifiedSource:
    """Blocks that are checked, from the pinned first one on where `trust` pins it. Raises `SettingsError`."""
    pinned: bytes | None = None
    if settings.trust is not None:
        try:
            pins = Pins.decode(settings.trust.read_bytes())
        except (UnreadableError, OSError) as cause:
            raise SettingsError(f"trust: {settings.trust} cannot be read ({cause})") from None
        if pins.channel != connection.channel:
            raise SettingsError(f"trust: {settings.trust} is about channel {pins.channel}, not {connection.channel}")
        pinned = pins.genesis_hash
    return VerifiedSource(source, partial(endorsement_policies, database), pinned=pinned, opinion=opinion)


@contextlib.asynccontextmanager
async def _ledger_of(
    settings: Settings,
) -> AsyncIterator[tuple[Connection, GatewaySource, LedgerAccess, AuditIdentity | None]]:
    if settings.connection is None:
        raise SettingsError("--connection: say where the ledger's connection.json is")
    connection = Connection.load(settings.connection)
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(settings.identity), connection.signer(settings.identity))
        blocks = GatewaySource(gateway.network(connection.channel))
        ledger = LedgerAccess(connection, channel, gateway)
        yield connection, blocks, ledger, _audit_identity(settings, connection, channel)


def _audit_identity(settings: Settings, connection: Connection, channel: Gateways) -> AuditIdentity | None:
    """Who anchors the audit log. A demo's log is anchored by the identity that reads the blocks."""
    name = settings.audit_identity or (settings.identity if settings.demo else None)
    if name is None:
        return None
    identity = connection.identity(name)
    signer = connection.signer(name)
    gateway = Gateway(channel, identity, signer)
    contract = ProofContract(gateway.network(connection.channel), connection.chaincode)
    return AuditIdentity(contract, identity, signer)


@contextlib.asynccontextmanager
async def audit_anchors(settings: Settings, instance: str) -> AsyncIterator[Anchors | None]:
    """The heads of the audit log on the ledger; None without a connection. Raises `LedgerError`."""
    if settings.connection is None:
        yield None
        return
    reader = settings.model_copy(update={"audit_identity": settings.audit_identity or settings.identity})
    async with _ledger_of(reader) as (_, _, _, audit_identity):
        assert audit_identity is not None
        yield audit_identity.anchors(instance)


@contextlib.asynccontextmanager
async def backend_of(
    settings: Settings,
    hosts: frozenset[str],
    *,
    epoch: str | None = None,
    peers: Bus | None = None,
    behind: Callable[[], Awaitable[str]] | None = None,
) -> AsyncIterator[Backend]:
    """A running backend on the ledger that the settings name. Raises `LedgerError`, `BackendError`.

    `behind`: the epoch of whoever is on duty instead, on the same database and the same bus.
    """
    async with _ledger_of(settings) as (connection, source, access, audit_identity):
        database = Database(settings.database)
        try:
            if behind is None:
                await migrate(database)
            ledger = connection.ledger
            # An embedded ledger is one process: it has no second opinion.
            opinion = None if access.is_embedded else _second_opinion(settings, connection, source)
            backend = Backend(
                settings,
                database=database,
                source=verified_source(settings, connection, source, database, opinion),
                audit_identity=audit_identity,
                ledger=access,
                demo_registrar=_registrar(settings, access),
                channel=connection.channel,
                chaincode=connection.chaincode,
                ledger_kind=ledger.kind if ledger is not None else "unknown",
                ledger_notice=ledger.notice if ledger is not None else "",
                allowed_hosts=hosts,
                epoch=epoch,
                peers=peers,
                console_directory=settings.console,
            )
            if opinion is not None:
                opinion.status = backend.parts.mirror
            async with backend.running(behind):
                yield backend
        finally:
            await database.close()


def _second_opinion(settings: Settings, connection: Connection, source: GatewaySource) -> SecondOpinion:
    return SecondOpinion(GatewayAsked(source.network), connection.identity(settings.identity).msp_id, clock=now_ms)


def _registrar(settings: Settings, access: LedgerAccess) -> Registrar | None:
    if settings.demo_registrar is None:
        return None
    return registrar_of(settings.demo_registrar, embedded=access.is_embedded)


async def serve(settings: Settings, listen: Listen, *, token_file: Path | None, as_json: bool) -> None:
    """Serve until SIGTERM or SIGINT. Raises `LedgerError`, `BackendError`."""
    if settings.demo and not listen.is_loopback:
        raise SettingsError("--demo: a demo listens on loopback only, for example --listen 127.0.0.1:8080")
    listen.check_encrypted(settings)
    if settings.demo_registrar is not None and not settings.demo:
        raise SettingsError("demo_registrar: only a demo gives roles to whoever asks; leave it out, or add --demo")
    if settings.console is not None and console.find_console(settings.console) is None:
        raise SettingsError(f"--console: {settings.console} has no index.html; build the console first")
    hosts = hosts_of(settings, listen)
    allow_files(settings.max_connections * (1 if settings.agents.listen is None else 2))
    service = ServiceManager()
    with private_files(), Sockets.opened(settings, listen) as sockets:
        bound = sockets.everybody
        url = (settings.public_url or f"http://{listen.shown}:{bound.getsockname()[1]}").rstrip("/")
        epoch = secrets.token_hex(8)
        lock = lock_of(settings.database, epoch)
        async with service.alive(), contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(lock.release)
            peers = await stack.enter_async_context(opened_bus(settings.bus))
            leads = await lock.take_lock()
            if not leads and (peers is None or not await can_follow(settings.database)):
                service.tell("READY=1")
                if not await _stood_by(lock, bound, url, settings, as_json=as_json):
                    return
                leads = True
            behind = None if leads else lock.holder
            async with backend_of(settings, hosts, epoch=epoch, peers=peers, behind=behind) as backend:
                ready = Ready(url, settings, token_file, as_json=as_json)
                await _serve_until_told(backend, sockets, lock, ready, service, leads=leads)


async def _stood_by(lock: Lock, bound: socket.socket, url: str, settings: Settings, *, as_json: bool) -> bool:
    """Whether the lock of the database is ours at last; False where we are told to stop before."""
    with _told_to_stop() as told:
        click.echo(json.dumps({"standby": True, "url": url}) if as_json else f"Stands by at {url}. {Standby.example}")
        waiting = asyncio.create_task(stand_by(lock, bound, lambda app: new_server(app, settings)))
        await asyncio.wait({waiting, told}, return_when=asyncio.FIRST_COMPLETED)
        if not waiting.done():
            waiting.cancel()
            await asyncio.gather(waiting, return_exceptions=True)
            return False
        waiting.result()
        return True


@contextlib.contextmanager
def _told_to_stop() -> Iterator[asyncio.Future[None]]:
    """Done on SIGTERM or SIGINT, which else end the process at once."""
    loop = asyncio.get_running_loop()
    told: asyncio.Future[None] = loop.create_future()

    def tell() -> None:
        if not told.done():
            told.set_result(None)

    for each in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(each, tell)
    try:
        yield told
    finally:
        for each in (signal.SIGTERM, signal.SIGINT):
            loop.remove_signal_handler(each)


@dataclass(frozen=True)
class Ready:
    """What to print when the server answers."""

    url: str
    settings: Settings
    token_file: Path | None
    as_json: bool

    async def print(self, backend: Backend) -> None:
        """One line for machines, or a few for people: with a link to sign in, or to set the server up, if need be."""
        token = await links.at_start(backend.database, backend.parts.sign_ins, demo=self.settings.demo)
        if self.token_file is not None and token is not None:
            write_atomic(self.token_file, token.encode() + b"\n")
        if self.as_json:
            link = {} if token is None else {"token": token, "link": self._link(token)}
            click.echo(json.dumps({"ready": True, "url": self.url, **link}))
            return
        click.echo(f"Serving {self.url}")
        if token is not None:
            what = "Sign in once" if self.settings.demo else "Set this server up: name its first administrator"
            click.echo(f"{what}, within {self.settings.token_ttl_s // 60} min:  {self._link(token)}")

    def print_behind(self) -> None:
        """The same where another backend is on duty."""
        told = {"follows": True, "url": self.url}
        click.echo(json.dumps(told) if self.as_json else f"Serving {self.url}; another backend is on duty")

    def _link(self, token: str) -> str:
        """Passkeys are bound to a name: without a public address, to this machine's."""
        url = self.url
        if not self.settings.demo and self.settings.public_url is None:
            url = f"http://{LOCAL}:{urlsplit(url).port}"
        return f"{url}/#token={token}"


def new_agents_server(app: ASGIApp, settings: Settings, tls: AgentsTls) -> uvicorn.Server:
    """The agents' own listener: what strangers do at the other one shuts no agent out. Raises `SettingsError`."""
    server = new_server(app, settings, for_agents=True)
    assert server.config.ssl is not None
    tls.serve(server.config.ssl)
    return server


def new_server(app: ASGIApp, settings: Settings, *, for_agents: bool = False) -> uvicorn.Server:
    """A server with the settings that were measured to be best for many live clients. Raises `SettingsError`."""
    gate = Gate(settings.max_connections, settings.max_connections_each, settings.trusted_proxies)
    http, websocket = protocols(gate, for_agents=for_agents)
    certificate, key = settings.tls_certificate, settings.tls_key
    if for_agents and settings.agents.tls_certificate is not None:
        certificate, key = settings.agents.tls_certificate, settings.agents.tls_key
    config = uvicorn.Config(
        app,
        loop="none",  # the loop runs already
        ws=websocket,
        ws_per_message_deflate=False,
        ws_max_size=settings.ingest_max_bytes,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        http=http,
        forwarded_allow_ips=[str(each) for each in settings.trusted_proxies],
        lifespan="off",
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        backlog=BACKLOG,
        ssl_certfile=certificate,
        ssl_keyfile=key,
        ssl_ciphers=CIPHERS,
        ssl_ca_certs=None if settings.tls_client_ca is None else str(settings.tls_client_ca),
        # Machines may show a certificate; people's browsers need none.
        ssl_cert_reqs=ssl.CERT_NONE if settings.tls_client_ca is None else ssl.CERT_OPTIONAL,
    )
    try:
        config.load()
    except OSError as cause:  # ssl.SSLError is one
        raise SettingsError(f"tls_certificate, tls_key or tls_client_ca cannot be used ({cause})") from None
    return _Server(config)


class _Server(uvicorn.Server):
    """Signals are ours: the parts stop in order."""

    @contextlib.contextmanager
    def capture_signals(self) -> Any:
        yield


async def _serve_until_told(
    backend: Backend, sockets: Sockets, lock: Lock, ready: Ready, service: ServiceManager, *, leads: bool
) -> None:
    """Until told to stop. Raises `DatabaseError` where another backend may be the leader."""
    servers = [(new_server(backend.app, ready.settings), sockets.everybody)]
    if sockets.agents is not None:
        of_agents = new_agents_server(only_agents(backend.app), ready.settings, backend.parts.members.tls)
        servers.append((of_agents, sockets.agents))
    with _told_to_stop() as told:
        serving = asyncio.gather(*(server.serve([bound]) for server, bound in servers))
        while not all(server.started for server, _ in servers) and not serving.done():  # noqa: ASYNC110 - uvicorn says it by an attribute only
            await asyncio.sleep(0.01)
        if not serving.done():
            leave_to_itself()
            if leads:
                await ready.print(backend)
            else:
                ready.print_behind()
            service.tell("READY=1")
        leading = asyncio.create_task(_lead(backend, lock, None if leads else ready), name="leading")
        ends: set[asyncio.Future[Any]] = {serving, leading, told}
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        backend.end_streams()
        for server, _ in servers:
            server.should_exit = True
        await serving
        if leading.done():
            leading.result()
        leading.cancel()


async def _lead(backend: Backend, lock: Lock, ready: Ready | None) -> None:
    """Stay on duty; with `ready`, take it over first, whenever the lock of the database is to be had."""
    if ready is not None:
        await wait_for(lock)
        await backend.take_duty()
        await ready.print(backend)
    await stay_leader(lock)


def leave_to_itself() -> None:
    """Take what a server has made by its start out of Python's garbage collection: it lives as long as the server.

    That is 300,000 objects: at 2,500 positions/s a full collection stopped everything for up to 0.20 s, and without
    them for up to 0.08 s.
    """
    gc.collect()
    gc.freeze()
