"""Agents of the kit's authorities on a bus, with the interface of websockets' client: for tests that run over both."""

from __future__ import annotations

import contextlib
import ssl
from pathlib import Path

import websockets
from websockets.frames import Close

from kit.bus import HOST, free_port
from kit.ways import NAME
from wonderland_bus.agent import Dialled, connect
from wonderland_bus.errors import ChannelClosedError
from wonderland_bus.session import open_router
from wonderland_bus.settings import Member, Router, Tls
from wonderland_fabric_gateway.ca import Kind

NAMES = ("pad-1", "pad-2", "pad-7", "pad-8", "pad-9", "pad_operator", "plain", "uav-1", "uav-2", "uav-9")
ENROLLED = 150
"""The authorities number who is enrolled: `pad-1-17`."""


class BusAgents:
    """A router, and who comes by it."""

    def __init__(self, directory: Path, authorities) -> None:
        directory.mkdir()
        self.directory = directory
        self.port = free_port()
        self._authorities = authorities
        ca = directory / "ca.pem"
        ca.write_bytes(b"".join(each.root_pem(kind) for each in authorities.cas.values() for kind in Kind))
        self._ca = ca
        self._router = self._issued("router", HOST)
        self._backend = self._issued("backend-1", NAME)

    @contextlib.contextmanager
    def router(self):
        agents = [f"{name}-{number}" for name in NAMES for number in range(ENROLLED)]
        listen = [f"tls/{HOST}:{self.port}"]
        with open_router(Router(tls=self._router, agents=agents, backends=["backend-1"], listen=listen)):
            yield self

    @property
    def settings(self):
        """Of the backend."""
        own = self._backend
        routers = [f"tls/{HOST}:{self.port}"]
        return {"routers": routers, "ca": own.ca, "certificate": own.certificate, "key": own.key}

    @contextlib.asynccontextmanager
    async def connect(self):
        async with contextlib.AsyncExitStack() as stack:
            yield BusSocket(self, stack)

    def dialled(self, enrolment) -> Dialled:
        certificate, key = enrolment.write(self.directory / "agents")
        context = ssl.create_default_context(cafile=self._ca)
        context.load_cert_chain(certificate, key)
        member = Member(routers=[f"tls/{HOST}:{self.port}"], tls=Tls(ca=self._ca, certificate=certificate, key=key))
        return Dialled(member=member, server_name=NAME, context=context)

    def anybody(self):
        return self._authorities.enrol("pad-1", "PadMSP", role="pad", id="pad-1")

    def _issued(self, name: str, host: str) -> Tls:
        made = (
            self._authorities.cas["AuthorityMSP"].renew
            if self._known(name)
            else self._authorities.cas["AuthorityMSP"].enrol
        )
        certificate, key = made(name, kind=Kind.TLS, hosts=[host]).write(self.directory / "issued")
        return Tls(ca=self._ca, certificate=certificate, key=key)

    def _known(self, name: str) -> bool:
        return bool(self._authorities.cas["AuthorityMSP"].certificates(name, Kind.TLS))


class BusSocket:
    """Opened when it is first used, with the certificate of whoever uses it."""

    def __init__(self, agents: BusAgents, stack: contextlib.AsyncExitStack) -> None:
        self._agents = agents
        self._stack = stack
        self._channel = None
        self.enrolment = None
        self.tls = None

    async def recv(self) -> str:
        return await self._closed(self._receive)

    async def send(self, text: str | bytes) -> None:
        await self._closed(self._send, text)

    async def open(self):
        if self._channel is None:
            to = self._agents.dialled(self.enrolment or self._agents.anybody())
            self._channel = await self._stack.enter_async_context(connect(to))
            self.tls = await self._channel.ready()
        return self._channel

    async def _receive(self):
        return await (await self.open()).receive()

    async def _send(self, text):
        await (await self.open()).send(text if isinstance(text, str) else text.decode())

    async def _closed(self, what, *arguments):
        try:
            return await what(*arguments)
        except ChannelClosedError as cause:
            raise websockets.ConnectionClosedError(Close(cause.code, cause.reason), None) from cause
