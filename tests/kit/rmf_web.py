"""Open-RMF's web server (rmf-web's api-server), as it is: its own code in a process of its own, over a stand-in rclpy."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import time
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest
from joserfc import jwt
from joserfc.jwk import OctKey

from kit.ros2 import free_port

STAND_IN = Path(__file__).with_name("rclpy_stand_in")


def rmf_directory():
    """Where rmf-web and two repositories of messages are checked out, with a venv that has the server's packages."""
    where = Path(os.environ.get("RMF_DIR") or "nowhere")
    if not (where / "rmf-web/packages/api-server/api_server/app.py").is_file():
        pytest.skip("RMF_DIR names no directory with rmf-web (docs/contributing/tests.md)")
    return where


class RmfWeb:
    """Asked as its dashboard asks it."""

    def __init__(self, client):
        self._client = client

    async def get(self, path, status=200):
        answer = await self._client.get(path)
        assert answer.status_code == status, (path, answer.status_code, answer.text)
        return answer.json()

    async def post(self, path, body, status=200):
        answer = await self._client.post(path, json=body, timeout=30)
        assert answer.status_code == status, (path, answer.status_code, answer.text)
        return answer.json()

    async def until(self, path, fits, limit_s=15):
        async with asyncio.timeout(limit_s):
            while True:
                answer = await self._client.get(path)
                if answer.status_code == 200 and fits(answer.json()):
                    return answer.json()
                await asyncio.sleep(0.05)


@asynccontextmanager
async def rmf_web(where, directory):
    """The server at a router, with a secret and a database of its own."""
    rmf, port, secret = rmf_directory(), free_port(), secrets.token_hex(32)
    sources = rmf / "rmf-web/packages/api-server"
    config = directory / "rmf_web_config.py"
    own = {"port": port, "jwt_secret": secret, "cache_directory": str(directory / "rmf_web_cache"), "log_level": "INFO"}
    config.write_text(
        f"from api_server.default_config import config\nimport json\nconfig.update(json.loads({json.dumps(own)!r}))\n"
    )
    log = directory / "rmf_web.log"
    with log.open("wb") as said:
        process = await asyncio.create_subprocess_exec(
            str(rmf / "venv/bin/python"),
            "-m",
            "api_server",
            cwd=directory,
            env={
                "PATH": os.environ["PATH"],
                "PYTHONPATH": os.pathsep.join([str(STAND_IN), str(sources)]),
                "PYTHONDONTWRITEBYTECODE": "1",
                "ROS_MESSAGES": str(rmf),
                "ROUTER_PORT": str(where.port),
                "RMF_API_SERVER_CONFIG": str(config),
            },
            stdout=said,
            stderr=said,
        )
    now = int(time.time())
    claims = {"preferred_username": "admin", "iss": "stub", "aud": "rmf_api_server", "iat": now, "exp": now + 3_600}
    token = jwt.encode({"alg": "HS256"}, claims, OctKey.import_key(secret))
    try:
        async with httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{port}", headers={"Authorization": f"Bearer {token}"}, trust_env=False
        ) as client:
            async with asyncio.timeout(60):
                while True:
                    assert process.returncode is None, log.read_text()
                    try:
                        await client.get("/doors")
                        break
                    except httpx.ConnectError:
                        await asyncio.sleep(0.1)
            yield RmfWeb(client)
    finally:
        process.kill()
        await process.wait()
