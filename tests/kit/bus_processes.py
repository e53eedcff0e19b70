"""A bus of processes: a router, a backend, and a pad's uplink here."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys

from cryptography.hazmat.primitives.serialization import load_pem_private_key
from sqlalchemy import select

from kit import environment
from kit.bus import HOST, Organisations, free_port
from kit.ways import NAME
from wonderland.telemetry import Credentials
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.reported import IrregularRow, TrackRow
from wonderland_edge_agent.uplink.zenoh import ZenohTransport
from wonderland_fabric_gateway.ca.local import Kind
from wonderland_fabric_gateway.connection import ClientTls
from wonderland_fabric_gateway.signing import key_signer


class Process:
    """One that can be killed, stopped for a while, and started again as it was."""

    def __init__(self, *command: str) -> None:
        self._command = command
        self._process: asyncio.subprocess.Process | None = None
        self.told: dict = {}

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", *self._command, stdout=asyncio.subprocess.PIPE, env=os.environ | environment()
        )
        assert self._process.stdout is not None
        line = await asyncio.wait_for(self._process.stdout.readline(), 60)
        assert b"ready" in line, line
        self.told = json.loads(line)
        self._draining = asyncio.create_task(self._process.stdout.read())

    def signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    async def kill(self) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.send_signal(signal.SIGCONT)
            self._process.kill()
            await self._process.wait()
            await self._draining


class Bus:
    """The organisations, the router's process, the backend's."""

    def __init__(self, directory, *, listener: bool = False) -> None:
        """`listener`: agents may come by WebSocket, too, with TLS of the same certificate."""
        self.organisations = Organisations(directory)
        self.port = free_port()
        router = self.organisations.router(self.port)
        own = self.organisations.tls("AuthorityMSP", "backend-1", kind=Kind.TLS, hosts=[NAME, HOST])
        (directory / "router.toml").write_text(
            f'listen = ["tls/{HOST}:{self.port}"]\nca = "{router.tls.ca}"\ncertificate = "{router.tls.certificate}"\n'
            f'key = "{router.tls.key}"\nagents = ["pad-1", "pad-2"]\nbackends = ["backend-1", "backend-2"]\n'
        )
        self.database_url = f"sqlite:///{directory / 'backend.db'}"
        self.settings = {
            "routers": [f"tls/{HOST}:{self.port}"],
            "ca": str(own.ca),
            "certificate": str(own.certificate),
            "key": str(own.key),
        }
        self._told = directory / "backend.json"
        told = {"database": self.database_url, "bus": self.settings, "organisations": self.definitions("PadMSP")}
        if listener:
            told["agents"] = {
                "listen": "127.0.0.1:0",
                "tls_certificate": str(own.certificate),
                "tls_key": str(own.key),
            }
        self._told.write_text(json.dumps(told))
        self.router = Process("wonderland.cli", "bus", "serve", "--json", "--config", str(directory / "router.toml"))
        self.backend = Process("kit.bus_backend", str(self._told))

    def definitions(self, *msp_ids: str):
        """As the mirror keeps them."""
        return [
            (
                msp_id,
                json.dumps(
                    {
                        "root_certs": [self.organisations.add(msp_id).root_pem().decode()],
                        "intermediate_certs": [],
                        "revocation_lists": [],
                        "sections": ["Application"],
                    }
                ),
            )
            for msp_id in msp_ids
        ]

    def way(self, msp_id="PadMSP", name="pad-1", *, port=None, ping_s=0.5, open_timeout_s=1.0):
        tls = self.organisations.tls(msp_id, name)
        return ZenohTransport(
            f"zenoh+tls://{HOST}:{port or self.port}/{NAME}",
            tls.ca,
            ClientTls(tls.certificate, tls.key),
            open_timeout_s=open_timeout_s,
            ping_s=ping_s,
        )

    def credentials(self, msp_id="PadMSP", name="pad-1", pad_id="pad-1"):
        tls = self.organisations.tls(msp_id, name)
        return Credentials(
            agent="pad",
            id=pad_id,
            msp_id=msp_id,
            certificate_pem=tls.certificate.read_text(),
            sign=key_signer(load_pem_private_key(tls.key.read_bytes(), None)),
        )

    async def tracks(self):
        """When each track that is stored was, in the order in which they were stored; nothing irregular is."""
        database = Database(self.database_url)
        try:
            async with database.read() as session:
                assert not (await session.scalars(select(IrregularRow))).all()
                return list((await session.scalars(select(TrackRow.t_ms).order_by(TrackRow.id))).all())
        finally:
            await database.close()
