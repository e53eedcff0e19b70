"""``/healthz`` and ``/metrics`` over HTTP, for whoever watches the service. It takes no input but the path.

A few lines over asyncio instead of a web framework: the service must stay small, and this answers two fixed questions.
Paths and the health document are those of Fabric's own operations service.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import json
import logging
from typing import TYPE_CHECKING, Final

from wonderland_chaincode.service.errors import SettingsError
from wonderland_fabric_gateway.addresses import bracketed, split_address

if TYPE_CHECKING:
    from wonderland_chaincode.service.server import ContractServer

MAX_REQUEST_BYTES: Final = 8192
MAX_CONNECTIONS: Final = 32
REQUEST_S: Final = 5.0
_TEXT: Final = "text/plain; version=0.0.4; charset=utf-8"
_log: Final = logging.getLogger(__name__)


class Operations:
    """The HTTP listener beside a contract server. `address` is known after `start`."""

    def __init__(self, service: ContractServer) -> None:
        self._service = service
        self._server: asyncio.Server | None = None
        self._open = 0
        self.address = ""

    async def start(self, listen: str) -> str:
        """Listen at ``host:port`` (port 0: any free one); returns the address. Raises `SettingsError`."""
        host, port = split_address(listen)
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=MAX_REQUEST_BYTES)
        except OSError as cause:
            raise SettingsError(f"metrics: cannot listen at {listen} ({cause.strerror or cause})") from cause
        self.address = f"{bracketed(host)}:{self._server.sockets[0].getsockname()[1]}"
        return self.address

    async def stop(self) -> None:
        """Close the port of health and metrics."""
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
            self._server = None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            async with asyncio.timeout(REQUEST_S):
                if self._open <= MAX_CONNECTIONS:
                    head = await reader.readuntil(b"\r\n\r\n")
                    writer.write(self._answer(head))
                    await writer.drain()
        except (TimeoutError, OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
            _log.debug("operations: a request broke off (%s)", error)
        finally:
            self._open -= 1
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(REQUEST_S):
                    await writer.wait_closed()

    def _answer(self, head: bytes) -> bytes:
        method, _, rest = head.partition(b"\r\n")[0].partition(b" ")
        path = rest.partition(b" ")[0].partition(b"?")[0]
        if method not in {b"GET", b"HEAD"}:
            return _response("405 Method Not Allowed", _TEXT, b"GET /healthz or /metrics\n", with_body=True)
        with_body = method == b"GET"
        if path == b"/metrics":
            if self._service.tls is not None:
                self._service.tls.refresh()
                self._service.metrics.certificate_expiry.set(self._service.tls.valid_until.timestamp())
            return _response("200 OK", _TEXT, self._service.metrics.exposition(), with_body=with_body)
        if path == b"/healthz":
            status, document = health(self._service)
            return _response(status, "application/json", json.dumps(document).encode(), with_body=with_body)
        return _response("404 Not Found", _TEXT, b"there are /healthz and /metrics\n", with_body=with_body)


def health(service: ContractServer) -> tuple[str, dict[str, object]]:
    """HTTP status and document: OK while it serves, whether or not a peer has dialled it yet."""
    document: dict[str, object] = {
        "status": "Service Unavailable" if service.draining else "OK",
        "time": dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds"),
        "package_id": service.package_id,
        "contract_version": service.contract.version,
        "peers": list(service.peers),
        "in_flight": service.in_flight,
    }
    if service.draining:
        document["failed_checks"] = [{"component": "contract", "reason": "it is stopping"}]
    return ("503 Service Unavailable" if service.draining else "200 OK"), document


def _response(status: str, media_type: str, body: bytes, *, with_body: bool) -> bytes:
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: {media_type}\r\nContent-Length: {len(body)}\r\n"
        "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + (body if with_body else b"")
