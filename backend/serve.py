"""Running a backend: its ledger, its listening socket, its server, its end."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import signal
import socket
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import click
import uvicorn
from fastapi import FastAPI

from backend import console
from backend.app import Backend
from backend.db.engine import Database
from backend.db.migrate import migrate
from backend.errors import SettingsError
from backend.live.hub import Hub
from backend.mirror.source import BlockSource, GatewaySource
from backend.settings import Settings
from wonderland.ledger.connection import Connection
from wonderland.ledger.files import write_atomic
from wonderland.ledger.gateway import Gateway

LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
GRACE_S: Final = 5
STUCK_PEER_MS: Final = 30_000
BACKLOG: Final = 2048


@dataclass(frozen=True)
class Listen:
    """Where to listen."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Listen:
        """From ``HOST:PORT``. Raises `SettingsError`."""
        host, separator, port = text.rpartition(":")
        if not separator or not host or not port.isdecimal() or int(port) > 65_535:
            raise SettingsError(f"--listen: {text!r} is not HOST:PORT, for example 127.0.0.1:8080")
        return cls(host.strip("[]"), int(port))

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def open(self) -> socket.socket:
        """A bound socket. Raises `SettingsError`."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        # With the protocol named, the event loop switches Nagle's algorithm off: small answers go at once.
        found = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        try:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "TCP_USER_TIMEOUT"):
                # A peer that reads nothing would hold its connection, and what is queued for it, for a quarter hour.
                found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, STUCK_PEER_MS)
            found.bind((self.host, self.port))
        except OSError as cause:
            found.close()
            raise SettingsError(f"--listen: cannot listen on {self.host}:{self.port} ({cause.strerror})") from None
        return found


@contextlib.asynccontextmanager
async def source_of(settings: Settings) -> AsyncIterator[tuple[Connection, BlockSource]]:
    """The ledger that the settings name, and its blocks. Raises `SettingsError`, `LedgerError`."""
    if settings.connection is None:
        raise SettingsError("--connection: say where the ledger's connection.json is")
    connection = Connection.load(settings.connection)
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(settings.identity), connection.signer(settings.identity))
        yield connection, GatewaySource(gateway.network(connection.channel))


@contextlib.asynccontextmanager
async def backend_of(settings: Settings, hosts: frozenset[str]) -> AsyncIterator[Backend]:
    """A running backend on the ledger that the settings name. Raises `LedgerError`, `BackendError`."""
    async with source_of(settings) as (connection, source):
        database = Database(settings.database)
        try:
            await migrate(database)
            ledger = connection.ledger
            backend = Backend(
                settings,
                database=database,
                source=source,
                channel=connection.channel,
                chaincode=connection.chaincode,
                ledger_kind=ledger.kind if ledger is not None else "unknown",
                ledger_notice=ledger.notice if ledger is not None else "",
                allowed_hosts=hosts,
                console_directory=settings.console,
            )
            async with backend.running():
                yield backend
        finally:
            await database.close()


async def serve(settings: Settings, listen: Listen, *, token_file: Path | None, as_json: bool) -> None:
    """Serve until SIGTERM or SIGINT. Raises `LedgerError`, `BackendError`."""
    if settings.demo and not listen.is_loopback:
        raise SettingsError("--demo: a demo listens on loopback only, for example --listen 127.0.0.1:8080")
    if settings.console is not None and console.find(settings.console) is None:
        raise SettingsError(f"--console: {settings.console} has no index.html; build the console first")
    hosts = _hosts(settings, listen)
    with contextlib.closing(listen.open()) as bound:
        url = settings.public_url or f"http://{_shown(listen.host)}:{bound.getsockname()[1]}"
        async with backend_of(settings, hosts) as backend:
            token = await backend.context.sign_ins.new_token("Demo" if settings.demo else "Inspector", ("inspector",))
            if token_file is not None:
                write_atomic(token_file, token.encode() + b"\n")
            server = new_server(backend.app, settings)
            await _serve_until_told(
                server, bound, backend.context.hub, Ready(url.rstrip("/"), token, settings, as_json=as_json)
            )


@dataclass(frozen=True)
class Ready:
    """What to print when the server answers."""

    url: str
    token: str
    settings: Settings
    as_json: bool

    def print(self) -> None:
        """One line for machines, or a few for people."""
        link = f"{self.url}/#token={self.token}"
        if self.as_json:
            click.echo(json.dumps({"ready": True, "url": self.url, "token": self.token, "link": link}))
            return
        minutes = self.settings.token_ttl_s // 60
        click.echo(f"Serving {self.url}")
        click.echo(f"Sign in once, within {minutes} min:  {link}")


def new_server(app: FastAPI, settings: Settings) -> uvicorn.Server:
    """A server with the settings that were measured to be best for many live clients."""
    config = uvicorn.Config(
        app,
        loop="none",  # the loop runs already
        ws="websockets-sansio",
        ws_per_message_deflate=False,
        ws_max_size=settings.ingest_max_bytes,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        http="httptools",
        lifespan="off",
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        h11_max_incomplete_event_size=64 * 1024,
        backlog=BACKLOG,
    )
    return _Server(config)


class _Server(uvicorn.Server):
    """Signals are ours: the parts stop in order."""

    @contextlib.contextmanager
    def capture_signals(self) -> Any:
        yield


async def _serve_until_told(server: uvicorn.Server, bound: socket.socket, hub: Hub, ready: Ready) -> None:
    loop = asyncio.get_running_loop()

    def stop() -> None:
        hub.close()
        server.should_exit = True

    for each in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(each, stop)
    serving = asyncio.create_task(server.serve([bound]), name="server")
    while not server.started and not serving.done():  # noqa: ASYNC110 - uvicorn says it by an attribute only
        await asyncio.sleep(0.01)
    if server.started:
        ready.print()
    await serving


def _hosts(settings: Settings, listen: Listen) -> frozenset[str]:
    """By which names this server may be addressed. Any, where it listens on every address and nobody says more."""
    hosts = set()
    if settings.public_url is not None:
        hosts.add((urlsplit(settings.public_url).hostname or "").lower())
    if listen.is_loopback:
        hosts |= LOOPBACK_NAMES
    elif listen.host in {"0.0.0.0", "::"}:  # noqa: S104 - compared, not bound
        return frozenset()
    hosts.add(_shown(listen.host).lower())
    return frozenset(hosts)


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def setup_logging(level: str) -> None:
    """Log lines to standard error, so that standard output has the ready line alone."""
    logging.basicConfig(level=level.upper(), format="%(asctime)s %(levelname)s %(name)s: %(message)s", force=True)
