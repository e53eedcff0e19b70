"""A server as a process on a real embedded ledger: its first start, its links, its log's check on the command line."""

from __future__ import annotations

import asyncio
import json
import os
import sys

import httpx
import pytest

from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger

pytestmark = pytest.mark.timeout(400)  # a dozen processes, on machines that do other things, too
WONDERLAND = [sys.executable, "-m", "wonderland.cli", "backend"]


@pytest.fixture
async def ledger(tmp_path):
    async with EmbeddedLedger(tmp_path / "ledger", {"pol": load_contract("pol")}) as running:
        yield running


@pytest.fixture
def at(tmp_path):
    connection = str(tmp_path / "ledger" / "connection.json")
    return ["--connection", connection, "--database", f"sqlite:///{tmp_path / 'backend.db'}"]


async def start(*arguments, **environment):
    process = await asyncio.create_subprocess_exec(
        *WONDERLAND,
        "serve",
        "--listen",
        "127.0.0.1:0",
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        env=os.environ | {"NO_COLOR": "1"} | environment,
    )
    lines = [(await asyncio.wait_for(process.stdout.readline(), 90)).decode()]
    return process, lines[0]


async def stop(process):
    process.terminate()
    assert await asyncio.wait_for(process.wait(), 60) == 0


async def run(*arguments):
    process = await asyncio.create_subprocess_exec(
        *WONDERLAND, *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    out, err = await asyncio.wait_for(process.communicate(), 90)
    return process.returncode, out.decode(), err.decode()


async def test_the_first_start_prints_one_link_and_later_ones_none(ledger, at):
    database = at[2:]
    process, line = await start("--json", *at)
    try:
        told = json.loads(line)
        assert told["link"] == f"{told['url'].replace('127.0.0.1', 'localhost')}/#token={told['token']}"
        code, out, _ = await run("link", *database, "--json")
        assert code == 0
        token = json.loads(out)["token"]
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False) as http:
            assert (await http.get("/api/v1/pads")).status_code == 403
            spent = await http.post("/api/v1/sign-in/link", json={"token": told["token"]})
            assert spent.status_code == 401, "a later link takes the place of the first"
            shown = await http.post("/api/v1/sign-in/link", json={"token": token})
            assert shown.json()["kind"] == "set_up"
        code, _, err = await run("link", *database, "--display", "Control room")
        assert (code, "set the server up first" in err) == (1, True)
        code, out, _ = await run("link", *database, "--json", "--name", "Ada")
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False) as http:
            answer = await http.post("/api/v1/session", json={"token": json.loads(out)["token"]})
            assert (answer.json()["name"], answer.json()["roles"]) == ("Ada", ["admin"])
            assert (await http.get("/api/v1/pads")).status_code == 200
    finally:
        await stop(process)
    process, line = await start("--json", *at)
    try:
        told = json.loads(line)
        assert told.keys() == {"ready", "url"}
        code, _, err = await run("link", *database, "--name", "Nobody")
        assert (code, "there are: Ada" in err) == (1, True)
        code, out, _ = await run("link", *database, "--json")
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False) as http:
            answer = await http.post("/api/v1/session", json={"token": json.loads(out)["token"]})
            assert answer.json()["name"] == "Ada"
            acts = (await http.get("/api/v1/audit")).json()["items"]
            assert [(each["act"], each["person"]) for each in acts[:2]] == [
                ("sign_in", "Ada"),
                ("sign_in_link_made", "the server's command line"),
            ]
        code, out, _ = await run("link", *database, "--json", "--display", "Control room")
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False) as http:
            answer = await http.post("/api/v1/session", json={"token": json.loads(out)["token"]})
            display = answer.json()
            assert (display["name"], display["roles"], display["method"]) == ("Control room", ["viewer"], "display")
            assert display["expires_ms"] - display["signed_in_ms"] == 30 * 86_400_000
            assert "Max-Age=2592000" in answer.headers["set-cookie"]
        assert (await run("link", *database, "--name", "Ada", "--display", "Control room"))[0] == 2
    finally:
        await stop(process)


async def test_the_log_is_anchored_and_checked_from_outside(ledger, at):
    process, line = await start("--demo", "--json", *at, WONDERLAND_BACKEND_AUDIT_ANCHOR_S="1")
    try:
        told = json.loads(line)
        async with httpx.AsyncClient(base_url=told["url"], trust_env=False) as http:
            assert (await http.post("/api/v1/session", json={"token": told["token"]})).status_code == 200
            async with asyncio.timeout(60):
                while True:
                    anchored = (await http.get("/api/v1/audit", params={"act": "audit_anchored"})).json()["items"]
                    if anchored:
                        break
                    await asyncio.sleep(0.2)
            async with asyncio.timeout(30):
                while (found := await http.get(f"/api/v1/transactions/{anchored[0]['tx_id']}")).status_code == 404:
                    await asyncio.sleep(0.1)  # not mirrored yet
            transaction = found.json()
            assert (transaction["function"], transaction["creator"]["name"]) == ("AnchorAuditLog", "mirror")
            found = (await http.get("/api/v1/audit/verify")).json()
            assert (found["ok"], found["ledger"], found["anchors"]) == (True, "checked", 1)
    finally:
        await stop(process)
    code, out, _ = await run("audit", "verify", *at)
    assert code == 0
    assert "The ledger vouches for them up to row 1" in out
    code, out, _ = await run("audit", "verify", *at[2:], "--json")
    assert (code, json.loads(out)["ledger"]) == (0, "off")
    import sqlite3

    with sqlite3.connect(at[3].removeprefix("sqlite:///")) as database:
        database.execute("DROP TRIGGER audit_log_no_update")
        database.execute("UPDATE audit_log SET person = 'Eve' WHERE seq = 1")
    code, out, _ = await run("audit", "verify", *at)
    assert (code, "Row 1 is missing" in out) == (1, True)


async def test_people_read_the_link(ledger, at):
    process, line = await start(*at)
    try:
        assert line.startswith("Serving http://127.0.0.1:")
        second = (await asyncio.wait_for(process.stdout.readline(), 30)).decode()
        assert "name its first administrator" in second
        assert "http://localhost:" in second
    finally:
        await stop(process)
