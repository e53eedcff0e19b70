"""schemathesis against a real backend: what it makes up is answered as the description says, and never by a 5xx."""

from __future__ import annotations

import asyncio
import copy
import json
import re
import sys
from collections import Counter
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from kit.backend import furnish
from kit.chain import START_MS
from kit.description import document

from wonderland_backend.clients.scopes import SCOPES
from wonderland_backend.reference.openapi import operations

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
TAGS = (
    "pads", "drones", "authorisations", "sessions", "verdicts", "proofs", "conformance", "events", "proof requests",
    "tracks", "flights", "alerts", "ledger", "subscriptions", "zones", "geo-awareness", "exports",
)  # fmt: skip
OF_MEMORY = ("traffic", "picture", "network remote id", "tokens")
"""Of these a database is asked nothing, or always the same."""
CHECKS = (
    "not_a_server_error", "status_code_conformance", "content_type_conformance", "response_headers_conformance",
    "response_schema_conformance",
)  # fmt: skip
NOT_HERE = {"get /api/v1/site-plans/{pad_id}/{sha256}", "get /api/v1/zones/{zone_id}"}
"""There is none of these in the database of the test."""
SECONDS = 400
EXAMPLES = 3


def described():
    """The description without what any operation may answer: a status that an operation does not name is a find."""
    found = copy.deepcopy(document())
    for _, _, operation in operations(found):
        del operation["responses"]["default"]
    return found


def with_real(**known):
    """Settings by which these parameters are of something that is there, but in examples and edges: by name, its values."""
    lines = []
    for name, values in known.items():
        lines += [f"[dictionaries.{name}]", f"values = {json.dumps(sorted(values))}"]
    lines += ["[parameters]"]
    places = {
        "uav_id": ("path.uav_id", "query.drone", "query.serial", "body.uav_id"),
        "pad_id": ("path.pad_id", "query.pad", "body.pad_id"),
    }
    for name in known:
        for place in places.get(name, (f"path.{name}",)):
            lines.append(f'"{place}" = {{ dictionary = "{name}" }}')
    return "\n".join(lines)


EDGES = """
[phases.coverage]
unexpected-methods = []
generation = { mode = "positive" }
"""
"""Of every parameter the edges of what is allowed."""
BEYOND = (
    EDGES
    + """
[[operations]]
include-tag = ["exports", "proof requests", "proofs", "subscriptions", "traffic"]
phases.coverage.unexpected-methods = ["PUT"]
phases.coverage.generation = { mode = "all" }
"""
)
"""And beyond them, of operations that have all kinds of parameters and bodies between them."""


async def schemathesis(directory, url, *headers, tags, checks=CHECKS, phases="examples,coverage,fuzzing", settings=""):
    """Run it with the same requests each time; returns its exit code and what it printed."""
    (directory / "openapi.json").write_text(json.dumps(described()))
    (directory / "schemathesis.toml").write_text(settings)
    arguments = ["--config-file", "schemathesis.toml", "run", "openapi.json", "--url", url]
    arguments += ["--no-color", "--generation-deterministic", "--report-har-path", "requests.har"]
    arguments += ["--max-examples", str(EXAMPLES), "--phases", phases, "--mode", "all"]
    arguments += ["--checks", ",".join(checks), "--request-timeout", "60"]
    # Of a ledger that the blocks of these tests have no part in: 503, as described.
    arguments += ["--exclude-path-regex", "/evidence$"]
    for header in headers:
        arguments += ["--header", header]
    for tag in tags:
        arguments += ["--include-tag", tag]
    program = Path(sys.executable).with_name("schemathesis")
    process = await asyncio.create_subprocess_exec(
        program, *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT, cwd=directory
    )
    try:
        output, _ = await asyncio.wait_for(process.communicate(), SECONDS)
    except TimeoutError:
        process.kill()
        raise
    return process.returncode, output.decode()


def reached(directory):
    """By operation, how often each status came."""
    patterns = {
        (method, path): re.compile(re.sub(r"\\\{\w+\\\}", "[^/]+", re.escape(path)))
        for path, method, _ in operations(document())
    }
    found = {}
    for entry in json.loads((directory / "requests.har").read_text())["log"]["entries"]:
        asked = urlsplit(entry["request"]["url"]).path
        method, status = entry["request"]["method"].lower(), entry["response"]["status"]
        for (of, path), pattern in patterns.items():
            if of == method and pattern.fullmatch(asked):
                found.setdefault(f"{method} {path}", Counter())[status] += 1
                break
    return found


async def filled(client, http, agent_client, chain):
    """Something of everything that a path can name, by the path's own word for it."""
    await client.mirrored(chain.height)
    async with client.connect("/ingest") as socket:
        agent = agent_client(socket)
        await agent.hello()
        track = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "wifi_beacon"}
        assert (await agent.report(("track", track), t_ms=START_MS + 1_000))["type"] == "ack"

    async def made(path, **body):
        answer = await http.post(f"/api/v1/{path}", json=body)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"].rpartition("/")[2]

    async def all_of(path, name):
        items = (await http.get(f"/api/v1/{path}")).json()["items"]
        assert items, path
        return [each[name] for each in items]

    blocks = await all_of("blocks", "number")
    return {
        "uav_id": await all_of("drones", "uav_id"),
        "pad_id": await all_of("pads", "pad_id"),
        "session_id": await all_of("sessions", "session_id"),
        "proof_id": await all_of("proofs", "proof_id"),
        "alert_id": await all_of("alerts", "alert_id"),
        "flight_id": await all_of("flights", "flight_id"),
        "number": blocks,
        "tx_id": [each["tx_id"] for each in (await http.get(f"/api/v1/blocks/{max(blocks)}")).json()["items"]],
        "request_id": [await made("proof-requests", uav_id="uav-1", pad_id="pad-1")],
        "subscription_id": [await made("subscriptions", url="https://8.8.8.8/in") for _ in range(5)],
        "export_id": [
            await made("exports", from_ms=START_MS, until_ms=START_MS + 60_000, format=each)
            for each in ("csv", "geojson")
        ],
    }


@pytest.mark.timeout(SECONDS + 60)
@both
async def test_what_machines_may_do(new_backend, serving, chain, source_of, machine_at, agent_client, tmp_path):
    furnish(chain)
    often = {"client_requests_per_min": 10**9, "client_exports_per_min": 10**9}
    async with (
        serving(new_backend(source_of(chain), **often)) as client,
        machine_at(client, " ".join(SCOPES), role="inspector") as http,
    ):
        known = await filled(client, http, agent_client, chain)
        header = f"Authorization: {http.headers['Authorization']}"
        checks = (*CHECKS, "negative_data_rejection")
        # What is made up at random asks our own code; what the description's edges ask of a database is each one's.
        first = client.context.database.is_sqlite
        phases = "examples,coverage,fuzzing" if first else "examples,coverage"
        tags = (*TAGS, *OF_MEMORY) if first else TAGS
        settings = with_real(**known) + (BEYOND if first else EDGES)
        code, output = await schemathesis(
            tmp_path, client.url, header, tags=tags, checks=checks, phases=phases, settings=settings
        )
    assert code == 0, output[-6_000:]
    if first:
        found = reached(tmp_path)
        by_id = {each for each in found if each.startswith("get ") and "{" in each and "/api/" in each}
        assert len(by_id) > 15
        assert {each for each in by_id if not found[each][200]} == NOT_HERE
        assert found["post /api/v1/proof-requests"][201]


@pytest.mark.timeout(SECONDS + 60)
async def test_what_administrators_do_with_clients_and_what_anybody_may_ask(new_backend, serving, tmp_path):
    async with serving(new_backend(person_requests_per_min=10**9)) as client:
        token = await client.parts.sign_ins.new_token("Admin", ("admin",))
        await client.http.post("/api/v1/session", json={"token": token})
        code, output = await schemathesis(tmp_path, client.url, f"Cookie: {client.cookie()}", tags=("clients",))
        assert code == 0, output[-60_000:]
