"""What a connection may take before any request is whole: bytes of a head, time, and its place among others.

Uvicorn's parser bounds none of it: one header of 60 MiB kept everybody waiting for ten seconds, and a request that was
begun and never ended stood for ever.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence
from ipaddress import IPv4Network, IPv6Network, ip_address
from typing import Any, ClassVar, Final, Literal
from urllib.parse import urlsplit

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from wonderland_backend.clients.certificates import EXTENSION, Peer

MAX_HEAD_BYTES: Final = 64 * 1024
"""Request line and headers: cookies and tokens take 2 kB, certificates in a proxy's header up to 40 kB."""
MAX_HEADERS: Final = 100
HEAD_S: Final = 10.0
"""From the connection, or from a request's first byte, to the end of its head."""
BODY_IDLE_S: Final = 20.0
"""Without a byte of a body that the application waits for."""
BODY_BYTES_PER_S: Final = 500
"""Below this a body uses up the same patience: one byte now and then would hold a connection for ever."""
SWITCHING_PROTOCOLS: Final = 101
_TOO_LARGE: Final = b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_TOO_MANY: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 10\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
)
_AMBIGUOUS: Final = b"HTTP/1.1 400 Bad Request\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_NO_SUCH_CODING: Final = b"HTTP/1.1 501 Not Implemented\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_TOO_SLOW: Final = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"


class Gate:
    """How many connections there are, in all and of each address."""

    def __init__(self, most: int, most_each: int, trusted: Sequence[IPv4Network | IPv6Network]) -> None:
        """`trusted`: proxies, behind which are many; the limit for each address is theirs to keep."""
        self._most = most
        self._most_each = most_each
        self._trusted = trusted
        self._counts: Counter[str] = Counter()
        self._all = 0

    def enter(self, address: str) -> bool:
        """Count a connection in, or say that there is no room."""
        if self._all >= self._most:
            return False
        if self._counts[address] >= self._most_each and not self._is_trusted(address):
            return False
        self._all += 1
        self._counts[address] += 1
        return True

    def _is_trusted(self, address: str) -> bool:
        try:
            return any(ip_address(address) in network for network in self._trusted)
        except ValueError:
            return False

    def leave(self, address: str) -> None:
        """A connection has ended."""
        self._all -= 1
        self._counts[address] -= 1
        if not self._counts[address]:
            del self._counts[address]


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """Counted out of the gate when it ends."""

    gate: ClassVar[Gate]
    for_agents: ClassVar[bool]
    _peer: Peer

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """It was counted in as HTTP."""
        self._peer = _peer_of(transport, for_agents=self.for_agents)
        super().connection_made(transport)

    def handle_connect(self, event: Request) -> None:
        """Tells the application, which runs after this, whom the socket is connected with."""
        super().handle_connect(event)
        if self.response.status_code == SWITCHING_PROTOCOLS:
            told: dict[Any, Any] = self.scope["extensions"]
            told[EXTENSION] = self._peer

    def send_receive_event_to_app(self) -> None:
        """Text that is none ends the connection; uvicorn would write a traceback for each."""
        if self.curr_msg_data_type == "text" and not _is_text(b"".join(self.frames)):
            self.frames = []
            self.conn.fail(1007, "text that is not UTF-8")
            self.handle_parser_exception()
            return
        super().send_receive_event_to_app()

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport says so once."""
        super().connection_lost(exc)
        self.gate.leave(self._peer.address)


class HttpProtocol(HttpToolsProtocol):
    """Bounded heads and waits; tells the application whom the socket is connected with, and with which certificate."""

    gate: ClassVar[Gate]
    for_agents: ClassVar[bool]
    _peer: Peer
    _counted = False
    _upgraded = False
    _begun = False
    """Whether there ever was a whole head, so that uvicorn has a cycle."""
    _head_bytes = 0
    _phase: Literal["idle", "head", "body"] = "idle"
    """What the client owes: nothing, the rest of a head, or of a body."""
    _wait: asyncio.TimerHandle | None = None
    _body_until_s = 0.0
    """When the patience with a body ends, by the loop's clock."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Comes after the TLS handshake."""
        super().connection_made(transport)
        self._peer = _peer_of(transport, for_agents=self.for_agents)
        self._counted = self.gate.enter(self._peer.address)
        if not self._counted:
            self._refuse(_TOO_MANY)
            return
        self._wait_for(HEAD_S)

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport says so once; not of a connection that has become a WebSocket."""
        self._wait_no_longer()
        if self._counted:
            self._counted = False
            self.gate.leave(self._peer.address)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Bytes of one or several requests."""
        if self.transport.is_closing():
            return
        if self._phase != "body" and self._head_bytes + len(data) > MAX_HEAD_BYTES and b"\r\n\r\n" not in data:
            self._refuse(_TOO_LARGE)
            return
        super().data_received(data)
        if self._upgraded or self.transport.is_closing():
            return
        if self._phase == "head":
            self._head_bytes += len(data)
        elif self._phase == "body":
            self._wait_for_body(len(data) / BODY_BYTES_PER_S)
        elif self._wait is None and (not self._begun or self.cycle.response_complete):
            self._wait_for(HEAD_S)  # bytes that begin no request

    def handle_websocket_upgrade(self) -> None:
        """From here on the connection is the WebSocket's to count."""
        self._wait_no_longer()
        self._upgraded = True
        self._counted = False
        super().handle_websocket_upgrade()

    def on_message_begin(self) -> None:
        """Httptools: the first byte of a request."""
        super().on_message_begin()
        self.scope["extensions"] = {EXTENSION: self._peer}  # type: ignore[dict-item]
        self._phase, self._head_bytes = "head", 0
        self._wait_for(HEAD_S)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Httptools: a header."""
        super().on_header(name, value)
        if len(self.headers) > MAX_HEADERS:
            self._refuse(_TOO_LARGE)

    def on_headers_complete(self) -> None:
        """Httptools: the head is whole; a body may come."""
        self._phase = "body"
        if sum(len(name) + len(value) for name, value in self.headers) + len(self.url) > MAX_HEAD_BYTES:
            self._refuse(_TOO_LARGE)
        elif any(name == b"transfer-encoding" and value.lower() != b"chunked" for name, value in self.headers):
            self._refuse(_NO_SUCH_CODING)
        elif not self._is_addressed():
            self._refuse(_AMBIGUOUS)
        if self.transport.is_closing():
            return
        self._wait_for_body(BODY_IDLE_S)
        self._begun = True
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Httptools: a part of the body."""
        if self._begun and not self.transport.is_closing():
            super().on_body(body)

    def on_message_complete(self) -> None:
        """Httptools: the request is whole; how long it waits for its answer is ours."""
        self._phase, self._head_bytes = "idle", 0
        self._wait_no_longer()
        if self._begun and not self.transport.is_closing():
            super().on_message_complete()

    def _is_addressed(self) -> bool:
        """Whether a request line that names a host (RFC 9112, 3.2.2) names the one that `Host` does."""
        named = urlsplit(self.url).netloc
        return self.url[:1] in {b"/", b"*"} or all(
            value.lower() == named.lower() for name, value in self.headers if name == b"host"
        )

    def _refuse(self, answer: bytes) -> None:
        self._wait_no_longer()
        if not self.transport.is_closing():
            self.transport.write(answer)
            self.transport.close()

    def _wait_for(self, seconds: float) -> None:
        self._wait_no_longer()
        self._wait = self.loop.call_later(seconds, self._waited)

    def _wait_for_body(self, more_s: float) -> None:
        now_s = self.loop.time()
        self._body_until_s = min(max(self._body_until_s, now_s) + more_s, now_s + BODY_IDLE_S)
        self._wait_for(self._body_until_s - now_s)

    def _wait_no_longer(self) -> None:
        if self._wait is not None:
            self._wait.cancel()
            self._wait = None

    def _waited(self) -> None:
        self._wait = None
        if self._phase == "body" and self.flow.read_paused:
            self._wait_for_body(BODY_IDLE_S)  # it is the application that takes its time
            return
        self._refuse(_TOO_SLOW)


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True


def _peer_of(transport: asyncio.BaseTransport, *, for_agents: bool) -> Peer:
    peer, tls = transport.get_extra_info("peername"), transport.get_extra_info("ssl_object")
    certificate = None if tls is None else tls.getpeercert(binary_form=True)
    return Peer(str(peer[0]) if peer else "", certificate, encrypted=tls is not None, for_agents=for_agents)


def protocols(gate: Gate, *, for_agents: bool) -> tuple[type[HttpProtocol], type[WebSocketProtocol]]:
    """Protocols of one server, which share its gate."""
    ours = {"gate": gate, "for_agents": for_agents}
    return type("HttpProtocol", (HttpProtocol,), ours), type("WebSocketProtocol", (WebSocketProtocol,), ours)
