"""XML-RPC as ROS 1 uses it: calls with a time limit and a size limit, and a server that answers nodes and the master.

The XML comes from anybody. A document type is refused, so that no entity can be declared, let alone expanded.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import xmlrpc.client
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import urlsplit
from xml.parsers import expat

from wonderland_ros_bridge.errors import WireError
from wonderland_ros_bridge.ros1.hosts import Hosts

_log = logging.getLogger(__name__)

MAX_BODY_BYTES: Final = 4 << 20
MAX_HEAD_BYTES: Final = 16 << 10
CALL_S: Final = 5.0
MAX_CONNECTIONS: Final = 64


def _unmarshal(body: bytes) -> tuple[tuple[Any, ...], str | None]:
    """(parameters, method); the method is None for an answer. Raises WireError."""
    reader = xmlrpc.client.Unmarshaller()
    parser = expat.ParserCreate()

    def refuse(*_: Any) -> None:
        raise WireError("XML with a document type; XML-RPC has none")

    reader.xml("", None)  # expat gives text, which is not to be decoded again
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.CharacterDataHandler = reader.data
    try:
        parser.Parse(body, True)
        parameters = reader.close()
    except xmlrpc.client.Fault as fault:
        raise WireError(f"answered with a fault: {str(fault.faultString)[:200]}") from fault
    except WireError:
        raise
    except Exception as cause:  # the standard library's reader meets bad nesting with whatever comes
        raise WireError(f"no XML-RPC: {str(cause)[:200] or type(cause).__name__}") from cause
    return parameters, reader.getmethodname()


async def call(hosts: Hosts, uri: str, method: str, *parameters: Any, wait_s: float = CALL_S) -> Any:
    """Call a ROS API; returns the value of ``[code, text, value]``. Raises WireError for whatever goes wrong."""
    what = f"{uri} {method}"
    try:
        async with asyncio.timeout(wait_s):
            answer = await _exchange(hosts, uri, xmlrpc.client.dumps(parameters, method).encode())
    except TimeoutError as cause:
        raise WireError(f"{what}: no answer within {wait_s:g} s") from cause
    except (OSError, EOFError, asyncio.LimitOverrunError) as cause:
        raise WireError(f"{what}: {str(cause) or type(cause).__name__}") from cause
    except WireError as cause:
        raise WireError(f"{what}: {cause}") from cause
    if not (isinstance(answer, list) and len(answer) == 3 and isinstance(answer[0], int)):
        raise WireError(f"{what}: the answer is not [code, text, value]")
    if answer[0] != 1:
        raise WireError(f"{what}: refused: {str(answer[1])[:200]}")
    return answer[2]


async def _exchange(hosts: Hosts, uri: str, body: bytes) -> Any:
    try:
        address = urlsplit(uri)
        host, port = address.hostname, address.port
    except ValueError as cause:
        raise WireError(f"no address: {cause}") from cause
    if address.scheme != "http" or not host or not port:
        raise WireError("no address of the form http://HOST:PORT/")
    reader, writer = await hosts.connect(host, port, limit=MAX_HEAD_BYTES)
    try:
        head = f"POST {address.path or '/'} HTTP/1.0\r\nHost: {host}:{port}\r\nContent-Type: text/xml\r\n"
        writer.write(f"{head}Content-Length: {len(body)}\r\nConnection: close\r\n\r\n".encode() + body)
        await writer.drain()
        status, length = _head(await reader.readuntil(b"\r\n\r\n"))
        if " 200" not in status:
            raise WireError(f"answered {status[:80]!r}")
        answer = await _body(reader, length)
    finally:
        writer.close()
    parameters, _ = _unmarshal(answer)
    return parameters[0] if len(parameters) == 1 else None


def _head(head: bytes) -> tuple[str, int | None]:
    """First line, and Content-Length. Raises WireError."""
    first, *lines = head.decode("latin-1").split("\r\n")
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip().lower() == "transfer-encoding":
            raise WireError("HTTP in chunks, which XML-RPC of ROS does not use")
        if name.strip().lower() == "content-length":
            if not value.strip().isdecimal() or len(value) > 12 or int(value) > MAX_BODY_BYTES:
                raise WireError(f"a body of {value.strip()[:20]} bytes; {MAX_BODY_BYTES} are allowed")
            return first, int(value)
    return first, None


async def _body(reader: asyncio.StreamReader, length: int | None) -> bytes:
    if length is not None:
        return await reader.readexactly(length)
    chunks, size = [], 0
    while chunk := await reader.read(65_536):
        size += len(chunk)
        if size > MAX_BODY_BYTES:
            raise WireError(f"a body of more than {MAX_BODY_BYTES} bytes")
        chunks.append(chunk)
    return b"".join(chunks)


class Server:
    """A node's own API. ``handle(method, parameters)`` gives ``(code, text, value)``."""

    def __init__(self, hosts: Hosts, handle: Callable[[str, tuple[Any, ...]], tuple[int, str, Any]]) -> None:
        self._hosts = hosts
        self._handle = handle
        self._server: asyncio.Server | None = None
        self._open = 0
        self.port = 0

    async def start(self, host: str, port: int = 0) -> None:
        """Listen. Raises WireError."""
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=MAX_HEAD_BYTES)
        except OSError as cause:
            raise WireError(f"cannot listen on {host}:{port}: {cause.strerror or cause}") from cause
        self.port = self._server.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Answer nobody any more."""
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = writer.get_extra_info("peername") or ("?",)
        self._open += 1
        try:
            if self._open > MAX_CONNECTIONS or not self._hosts.allows(str(peer[0])):
                return
            async with asyncio.timeout(CALL_S):
                first, length = _head(await reader.readuntil(b"\r\n\r\n"))
                if not first.startswith("POST ") or length is None:
                    _log.warning("%s sent %r, which is no call of XML-RPC", peer[0], first[:60])
                    return
                parameters, method = _unmarshal(await reader.readexactly(length))
                answer = self._handle(method or "", parameters)
                body = xmlrpc.client.dumps((list(answer),), methodresponse=True).encode()
                head = f"HTTP/1.0 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {len(body)}\r\n"
                writer.write(f"{head}Connection: close\r\n\r\n".encode() + body)
                await writer.drain()
        except WireError as error:
            _log.warning("a call from %s is refused: %s", peer[0], error)
        except (OSError, EOFError, TimeoutError, asyncio.LimitOverrunError):
            pass  # a peer that went away, or that sent half of something
        finally:
            self._open -= 1
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


def own_name(host: str) -> str:
    """How this machine is called where it listens on every address."""
    return socket.gethostname() if host in {"0.0.0.0", "::"} else host  # noqa: S104 - compared, not bound
