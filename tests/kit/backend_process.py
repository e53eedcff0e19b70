"""The backend as a process on a real embedded ledger, as its commands run it."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import asynccontextmanager

import httpx
import pytest

from kit import PLAIN
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger

WONDERLAND = [sys.executable, "-m", "wonderland.cli"]


@pytest.fixture
async def ledger(tmp_path):
    async with EmbeddedLedger(tmp_path / "ledger", {"pol": load_contract("pol")}) as running:
        yield running


async def start(tmp_path, *arguments, database):
    command = [*WONDERLAND, "backend", "serve", "--json", "--listen", "127.0.0.1:0", "--demo"]
    command += ["--connection", str(tmp_path / "ledger" / "connection.json"), "--database", database, *arguments]
    return await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env=os.environ | {"NO_COLOR": "1"}
    )


async def ready(process):
    line = await asyncio.wait_for(process.stdout.readline(), 60)
    if not line:
        raise AssertionError((await process.stderr.read()).decode())
    return json.loads(line)


@asynccontextmanager
async def signed_in(told):
    async with httpx.AsyncClient(base_url=told["url"], trust_env=False, verify=PLAIN) as http:
        answer = await http.post("/api/v1/session", json={"token": told["token"]})
        assert answer.status_code == 200
        yield http


async def mirrored(http, height):
    async with asyncio.timeout(20):
        while True:
            status = (await http.get("/api/v1/status")).json()
            if status["ledger"]["mirrored"] >= height:
                return status
            await asyncio.sleep(0.02)


async def run(*arguments):
    process = await asyncio.create_subprocess_exec(
        *WONDERLAND, "backend", *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    out, err = await asyncio.wait_for(process.communicate(), 30)
    return process.returncode, out.decode(), err.decode()


async def stop(process):
    process.terminate()
    return await asyncio.wait_for(process.wait(), 40)
