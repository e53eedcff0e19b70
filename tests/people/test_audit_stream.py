"""The audit log on its way to a SIEM: every row, in order, once it is committed, and again after a break."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import stat

import pytest
from pydantic import ValidationError

from wonderland_backend import audit
from wonderland_backend.audit.stream import CHUNK, AuditStream, destination_of
from wonderland_backend.settings.audit import AuditStreamSettings

NOW_MS = 1_800_000_000_000
MESSAGE = re.compile(rb"<109>1 2027-01-15T08:00:00\.\d{3}Z turku wonderland - note - (\{.*\})")


def stream_to(database, to):
    return AuditStream(database, destination_of(AuditStreamSettings(to=to), "turku"), to, lambda: NOW_MS)


async def write(database, count):
    async with database.write() as connection:
        for _ in range(count):
            await audit.record(connection, "Ada", "note", "alert/1", {"note": "ä\n<34>1"}, t_ms=NOW_MS)


async def test_lines_of_a_file(database, tmp_path):
    path = tmp_path / "audit.jsonl"
    stream = stream_to(database, path.as_uri())
    assert await stream.send_new() == 0
    await write(database, CHUNK + 1)
    assert [await stream.send_new() for _ in range(3)] == [CHUNK, 1, 0]
    path.rename(tmp_path / "audit.1")
    await write(database, 1)
    await stream_to(database, path.as_uri()).send_new()
    files = [(tmp_path / name).read_text() for name in ("audit.1", "audit.jsonl")]
    lines = [json.loads(line) for line in "".join(files).splitlines()]
    assert [line["seq"] for line in lines] == list(range(1, CHUNK + 3)), "each once, over a rotation and a restart"
    assert lines[0]["detail"] == {"note": "ä\n<34>1"}
    assert {"t_ms", "person", "act", "subject", "sha256", "previous_sha256"} < set(lines[0])
    assert stat.S_IMODE(path.stat().st_mode) & 0o137 == 0


def messages(data):
    """Of a stream with counted octets (RFC 6587); what is incomplete is left out."""
    found = []
    while (head := re.match(rb"(\d+) ", data)) and len(data) >= head.end() + int(head[1]):
        end = head.end() + int(head[1])
        found.append(data[head.end() : end])
        data = data[end:]
    return found


@contextlib.asynccontextmanager
async def listening(port=0):
    """A server of TCP; what it received, and where it is."""
    received, writers = bytearray(), []

    async def take(reader, writer):
        writers.append(writer)
        while data := await reader.read(65_536):
            received.extend(data)

    server = await asyncio.start_server(take, "127.0.0.1", port)
    try:
        yield received, server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for writer in writers:
            writer.close()
        await server.wait_closed()


async def test_syslog_by_tcp_goes_on_after_a_break(database):
    await write(database, 3)
    async with listening() as (received, port):
        stream = stream_to(database, f"syslog+tcp://127.0.0.1:{port}")
        await stream.send_new()
        async with asyncio.timeout(10):
            while len(messages(bytes(received))) < 3:
                await asyncio.sleep(0.01)
    first = messages(bytes(received))
    assert [json.loads(MESSAGE.fullmatch(each)[1])["seq"] for each in first] == [1, 2, 3]
    assert b"\n" not in received, "what somebody wrote cannot begin a message of its own"
    await write(database, 2)
    with pytest.raises(OSError, match=r"failed|reset|closed|Broken"):
        for _ in range(3):
            await stream.send_new()
    async with listening(port) as (received, _):
        await stream.send_new()
        async with asyncio.timeout(10):
            while len(messages(bytes(received))) < 2:
                await asyncio.sleep(0.01)
    stream._destination.close()
    assert [json.loads(MESSAGE.fullmatch(each)[1])["seq"] for each in messages(bytes(received))] == [4, 5]


async def test_syslog_by_udp(database):
    received = asyncio.Queue()

    class Take(asyncio.DatagramProtocol):
        def datagram_received(self, data, address):
            received.put_nowait(data)

    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(Take, local_addr=("127.0.0.1", 0))
    try:
        await write(database, 2)
        stream = stream_to(database, f"syslog://127.0.0.1:{transport.get_extra_info('sockname')[1]}")
        assert await stream.send_new() == 2
        for seq in (1, 2):
            message = await asyncio.wait_for(received.get(), 10)
            assert json.loads(MESSAGE.fullmatch(message)[1])["seq"] == seq
    finally:
        transport.close()


@pytest.mark.parametrize(
    "to", ["", "/var/log/x", "file://", "http://host", "syslog://", "syslog+tcp://host:0", "syslog://host:99999"]
)
def test_what_is_no_destination(to):
    with pytest.raises(ValidationError, match=r"audit_stream\.to: .* is none of file:///path, syslog"):
        AuditStreamSettings(to=to)


def test_a_ca_goes_with_tls_only(tmp_path):
    with pytest.raises(ValidationError, match=r"syslog\+tls:// only"):
        AuditStreamSettings(to="syslog+tcp://host", tls_ca=tmp_path / "ca.pem")
    assert AuditStreamSettings(to="syslog+tls://host", tls_ca=tmp_path / "ca.pem").default_port == 6514
