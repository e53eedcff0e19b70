"""Both backends behind a real nginx, configured as docs/operate/standby.md has it: one address for consoles and agents."""

from __future__ import annotations

import asyncio
import re
import shutil
import time
from pathlib import Path

import pytest
from kit.bus import free_port
from kit.replicas import Console, client, cookie, eventually

pytestmark = [
    pytest.mark.timeout(240),
    pytest.mark.postgres,
    pytest.mark.parametrize("database_url", ["postgresql"], indirect=True),
    pytest.mark.skipif(shutil.which("nginx") is None, reason="nginx is not installed"),
]
PAGE = Path(__file__).parents[2] / "docs" / "operate" / "standby.md"


def configuration(directory, port, backends):
    """The page's, on loopback without TLS."""
    text = "\n".join(
        line[4:] for line in PAGE.read_text().split("with nginx")[1].splitlines() if line.startswith("    ")
    )
    for number, backend in enumerate(backends, start=1):
        text = text.replace(f"10.0.0.1{number}:8080", backend)
    assert "10.0.0" not in text
    text = text.replace("listen 443 ssl;", f"listen 127.0.0.1:{port};").replace("console.example", "127.0.0.1")
    text = re.sub(r"Host \$host;", "Host $http_host;", text)
    return f"""
        daemon off; worker_processes 1; pid {directory}/nginx.pid; error_log {directory}/error.log;
        events {{ worker_connections 512; }}
        http {{
            access_log off; client_body_temp_path {directory}/body; proxy_temp_path {directory}/proxy;
            fastcgi_temp_path {directory}/f; uwsgi_temp_path {directory}/u; scgi_temp_path {directory}/s;
            {text}
        }}"""


@pytest.fixture
async def nginx(tmp_path):
    """Begins nginx before these backends (HOST:PORT); gives its address."""
    running = []
    directory = tmp_path / "nginx"
    directory.mkdir()
    directory.chmod(0o777)

    async def begin(*backends):
        port = free_port()
        file = directory / "nginx.conf"
        file.write_text(configuration(directory, port, backends))
        process = await asyncio.create_subprocess_exec("nginx", "-p", str(directory), "-c", str(file))
        running.append(process)
        async with asyncio.timeout(10):
            while True:
                try:
                    (await asyncio.open_connection("127.0.0.1", port))[1].close()
                except OSError:
                    assert process.returncode is None, (directory / "error.log").read_text()
                    await asyncio.sleep(0.05)
                else:
                    return f"http://127.0.0.1:{port}"

    yield begin
    for process in running:
        process.terminate()
        await process.wait()


async def test_consoles_and_a_pad_behind_one_address(replicas, field, nginx):
    ports = [free_port(), free_port()]
    first = await replicas.begin("backend-1", listen=f"127.0.0.1:{ports[0]}")
    token = (await first.told())["token"]
    second = await replicas.begin("backend-2", listen=f"127.0.0.1:{ports[1]}")
    await second.told()
    url = await nginx(*(f"127.0.0.1:{port}" for port in ports))
    signed_in = await cookie(url, token)
    consoles = [Console(url, cookie=signed_in) for _ in range(6)]
    try:
        async with field.reporting(url), client(url, signed_in) as http:
            await field.prove()
            await eventually(lambda: all(set(field.proved) <= each.verdicts.keys() for each in consoles))
            for _ in range(4):  # of both, in turns
                assert (await http.get("/api/v1/verdicts")).status_code == 200
                assert (await http.post("/api/v1/search", json={"q": "pad", "limit": 5})).status_code == 200
            await eventually(lambda: field.uplink.status.connected)

            await first.kill()
            killed, frames = time.monotonic(), [each.frames for each in consoles]
            await field.prove()
            await second.told()
            assert (await http.get("/api/v1/verdicts")).status_code == 200
            assert (await http.post("/api/v1/search", json={"q": "pad", "limit": 5})).status_code == 200
            await eventually(lambda: all(set(field.proved) <= each.verdicts.keys() for each in consoles))
            await eventually(
                lambda: all(each.frames > before + 20 for each, before in zip(consoles, frames, strict=True))
            )
            print(f"consoles go on {time.monotonic() - killed:.1f} s after the kill, 20 frames of positions later")
            assert time.monotonic() - killed < 20
            # What the pad keeps is acknowledged by the one that took over.
            reported = field.reported
            await eventually(lambda: field.uplink.status.acknowledged_seq > reported, 20, "records acknowledged")
            assert all((each.holes, each.told_twice) == ([], []) for each in consoles)

            third = await replicas.begin("backend-1", listen=f"127.0.0.1:{ports[0]}")
            assert (await third.told())["follows"] is True
            seen = [each.frames for each in consoles]
            await third.kill()
            await eventually(
                lambda: all(each.frames > before + 20 for each, before in zip(consoles, seen, strict=True))
            )
            assert all((each.holes, each.told_twice) == ([], []) for each in consoles)
    finally:
        await asyncio.gather(*(each.close() for each in consoles))
