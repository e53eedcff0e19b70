"""The audit log to a SIEM as it grows: JSON lines to a file, or syslog (RFC 5424) by UDP, TCP or TLS.

A row goes out after it is committed, in the log's order, and again after a break: at least once, with its `seq`.
"""

from __future__ import annotations

import asyncio
import logging
import os
import ssl
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Protocol
from urllib.parse import urlsplit

import orjson

from wonderland_backend.audit import queries
from wonderland_backend.audit.store import note_sent
from wonderland_backend.db.engine import Database
from wonderland_backend.http.backoff import Backoff
from wonderland_backend.settings.audit import AuditStreamSettings

logger = logging.getLogger(__name__)

CHUNK: Final = 500
LOOK_S: Final = 1.0
TIMEOUT_S: Final = 10.0
_PRIORITY: Final = 13 * 8 + 5
"""Facility 13 (log audit), severity 5 (notice)."""


class Destination(Protocol):
    """Where rows go."""

    async def send(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Give away these rows; raises OSError, and then all of them are sent again."""

    def close(self) -> None:
        """Nothing more comes."""


def json_line(row: Mapping[str, Any]) -> bytes:
    """A row as one JSON object: the log's columns, `detail` as an object."""
    return orjson.dumps({**row, "detail": orjson.Fragment(row["detail"])})


def syslog_message(row: Mapping[str, Any], host: str) -> bytes:
    """A row as a message of RFC 5424; its text is the row in JSON."""
    at = datetime.fromtimestamp(row["t_ms"] / 1000, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"<{_PRIORITY}>1 {at} {host} wonderland - {row['act'][:32]} - ".encode() + json_line(row)


class JsonLines:
    """Appends to a file, which only its owner and group may read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    async def send(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """A whole chunk in one write; opened anew each time, so that it may be rotated."""
        content = b"".join(json_line(row) + b"\n" for row in rows)
        await asyncio.to_thread(self._append, content)

    def close(self) -> None:
        """There is nothing to close."""

    def _append(self, content: bytes) -> None:
        with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o640), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())


class SyslogUdp:
    """One datagram for each row (RFC 5426): some may be lost, which a gap in `seq` shows."""

    def __init__(self, host: str, port: int, name: str) -> None:
        self._at = host, port
        self._name = name

    async def send(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Datagrams, which nobody acknowledges."""
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=self._at)
        try:
            for row in rows:
                transport.sendto(syslog_message(row, self._name))
        finally:
            transport.close()

    def close(self) -> None:
        """There is nothing to close."""


class SyslogTcp:
    """A connection with counted octets (RFC 6587), or the same in TLS (RFC 5425)."""

    def __init__(self, host: str, port: int, name: str, tls: ssl.SSLContext | None) -> None:
        self._at = host, port
        self._name = name
        self._tls = tls
        self._connection: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def send(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """All at once; a connection that was closed from the other side is made anew first."""
        reader, writer = await self._open()
        try:
            for row in rows:
                message = syslog_message(row, self._name)
                writer.write(b"%d " % len(message) + message)
            async with asyncio.timeout(TIMEOUT_S):
                await writer.drain()
            if reader.at_eof():
                raise ConnectionResetError("the syslog server closed the connection")
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """End the connection, if there is one."""
        if self._connection is not None:
            self._connection[1].close()
            self._connection = None

    async def _open(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        if self._connection is not None and self._connection[0].at_eof():
            self.close()
        if self._connection is None:
            async with asyncio.timeout(TIMEOUT_S):
                self._connection = await asyncio.open_connection(*self._at, ssl=self._tls)
        return self._connection


def destination_of(settings: AuditStreamSettings, name: str) -> Destination:
    """What the settings name; `name` is this installation's in syslog. Raises OSError for a CA that cannot be read."""
    url = urlsplit(settings.to)
    if url.scheme == "file":
        return JsonLines(Path(url.path))
    host, port = url.hostname or "", url.port or settings.default_port
    if url.scheme == "syslog":
        return SyslogUdp(host, port, name)
    tls = ssl.create_default_context(cafile=settings.tls_ca) if url.scheme == "syslog+tls" else None
    return SyslogTcp(host, port, name, tls)


class AuditStream:
    """Sends what the log has gained, until it is cancelled."""

    def __init__(self, database: Database, destination: Destination, name: str, clock: Callable[[], int]) -> None:
        """`name`: under which its place in the log is kept."""
        self._database = database
        self._destination = destination
        self._name = name
        self._clock = clock

    async def run(self) -> None:
        """Again and again; a destination that is away is asked less and less often, at least once a minute."""
        try:
            await self._send_on()
        finally:
            self._destination.close()

    async def _send_on(self) -> None:
        backoff = Backoff()
        while True:
            try:
                sent = await self.send_new()
                backoff.succeeded()
            except OSError as error:
                sent = 0
                if backoff.until_ms == 0:
                    logger.warning("the audit log cannot be sent to %s; trying again: %s", self._name, error)
                backoff.failed(self._clock())
                await asyncio.sleep(max(0.0, (backoff.until_ms - self._clock()) / 1000))
            except Exception:
                sent = 0
                logger.exception("the audit log could not be sent; trying again")
            if sent < CHUNK:
                await asyncio.sleep(LOOK_S)

    async def send_new(self) -> int:
        """Send at most `CHUNK` rows, and note that; how many. Raises OSError."""
        async with self._database.read() as session:
            known = await queries.sent_to(session, self._name)
            rows = await queries.rows_after(session, known or 0, CHUNK)
        if not rows:
            return 0
        await self._destination.send(rows)
        async with self._database.write() as connection:
            await note_sent(connection, self._name, rows[-1]["seq"], again=known is not None)
        return len(rows)
