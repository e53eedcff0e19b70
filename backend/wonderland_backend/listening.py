"""Where a backend listens: for everybody, and, where it is told to, for agents alone."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import resource
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

import uvloop
from starlette.types import ASGIApp, Receive, Scope, Send

from wonderland_backend.errors import SettingsError
from wonderland_backend.handshakes import TlsServer
from wonderland_backend.settings import Settings

logger = logging.getLogger(__name__)

LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
STUCK_PEER_MS: Final = 30_000
OTHER_FILES: Final = 500
"""Databases, logs, the ledger, what a client asks of others."""


@dataclass(frozen=True)
class Listen:
    """Where to listen."""

    host: str
    port: int
    setting: str = "--listen"

    @classmethod
    def parse(cls, text: str, setting: str = "--listen") -> Listen:
        """From ``HOST:PORT``. Raises `SettingsError`, which names the setting."""
        host, separator, port = text.rpartition(":")
        if not separator or not host or not port.isdecimal() or int(port) > 65_535:
            raise SettingsError(f"{setting}: {text!r} is not HOST:PORT, for example 127.0.0.1:8080")
        return cls(host.strip("[]"), int(port), setting)

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def shown(self) -> str:
        """The host as an address has it."""
        return f"[{self.host}]" if ":" in self.host else self.host

    def check_encrypted(self, settings: Settings) -> None:
        """Raise `SettingsError` where others would reach it by http and nobody has said that this is meant.

        An https ``public_url`` without a certificate of our own means a proxy that ends TLS.
        """
        if self.is_loopback or settings.is_https or settings.plaintext:
            return
        raise SettingsError(
            f"{self.setting}: other machines can reach {self.shown}:{self.port} by http: whoever stands between reads "
            "and changes what people and agents are told. Give --public-url https://… (with tls_certificate, or a "
            "proxy that ends TLS), or --plaintext inside a network that is protected"
        )

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
            where = f"{self.host}:{self.port}"
            raise SettingsError(f"{self.setting}: cannot listen on {where} ({cause.strerror})") from None
        return found


class Loop(uvloop.Loop):
    """An event loop whose TLS servers bound how many handshakes go on, and for how long; by itself a minute each."""

    async def create_server(self, protocol_factory: Any, *args: Any, **options: Any) -> Any:
        """As uvicorn calls it, which has no setting for this."""
        if options.get("ssl") is None:
            return await super().create_server(protocol_factory, *args, **options)
        return TlsServer(options["sock"], options["backlog"], protocol_factory, options["ssl"])


@contextlib.contextmanager
def private_files() -> Iterator[None]:
    """What is made meanwhile (a database on this disk, its key, exports) is its owner's alone."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)


def allow_files(connections: int) -> None:
    """Let this process have so many sockets and some files: by itself a process may have a thousand in all."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = connections + OTHER_FILES
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < wanted:
        logger.warning("%d connections are allowed, but only %d files: raise LimitNOFILE", connections, most)


@dataclass(frozen=True)
class Sockets:
    """Bound sockets of one backend."""

    everybody: socket.socket
    agents: socket.socket | None
    """Of `agents.listen`: agents sign in there alone."""

    @classmethod
    @contextlib.contextmanager
    def opened(cls, settings: Settings, listen: Listen) -> Iterator[Sockets]:
        """Raises `SettingsError`."""
        with contextlib.ExitStack() as stack:
            agents = None
            if settings.agents.listen is not None:
                where = Listen.parse(settings.agents.listen, "agents.listen")
                agents = stack.enter_context(contextlib.closing(where.open()))
            yield cls(stack.enter_context(contextlib.closing(listen.open())), agents)


def only_agents(app: ASGIApp) -> ASGIApp:
    """Of an application what agents need."""

    async def ingest_only(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" and scope["path"] == "/ingest":
            await app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4404, "reason": "agents sign in at /ingest"})
        elif scope["type"] == "http":
            await send({"type": "http.response.start", "status": 404, "headers": [(b"content-length", b"0")]})
            await send({"type": "http.response.body"})

    return ingest_only


def hosts_of(settings: Settings, listen: Listen) -> frozenset[str]:
    """By which names this server may be addressed. Any, where it listens on every address and nobody says more."""
    hosts = set()
    if settings.public_url is not None:
        hosts.add((urlsplit(settings.public_url).hostname or "").lower())
    if listen.is_loopback:
        hosts |= LOOPBACK_NAMES
    elif listen.host in {"0.0.0.0", "::"}:  # noqa: S104 - compared, not bound
        return frozenset()
    hosts.add(listen.shown.lower())
    return frozenset(hosts)
