"""schemathesis against a real backend: what it makes up is answered as the description says, and never by a 5xx."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from wonderland_backend.clients.scopes import SCOPES

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
SECONDS = 400
EXAMPLES = 3


async def schemathesis(directory, url, *headers, tags, checks=CHECKS, phases="examples,coverage,fuzzing"):
    """Run it with the same requests each time; returns its exit code and what it printed."""
    arguments = ["run", f"{url}/api/v1/openapi.json", "--url", url, "--no-color", "--generation-deterministic"]
    arguments += ["--max-examples", str(EXAMPLES), "--phases", phases, "--mode", "all"]
    arguments += ["--checks", ",".join(checks), "--request-timeout", "60", "--wait-for-schema", "60"]
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


@pytest.mark.timeout(SECONDS + 60)
@both
async def test_what_machines_may_do(new_backend, serving, chain, facts, source_of, machine_at, tmp_path):
    chain.add(facts.put_pad(), facts.put_uav(), facts.grant(), facts.request("one"))
    chain.add(facts.decide("one"))
    often = {"client_requests_per_min": 10**9, "client_exports_per_min": 10**9}
    async with serving(new_backend(source_of(chain), **often)) as client:
        await client.mirrored(chain.height)
        async with machine_at(client, " ".join(SCOPES), role="inspector") as http:
            header = f"Authorization: {http.headers['Authorization']}"
            checks = (*CHECKS, "negative_data_rejection")
            # What is made up at random asks our own code; what the description's edges ask of a database is each one's.
            first = client.context.database.is_sqlite
            phases = "examples,coverage,fuzzing" if first else "examples,coverage"
            tags = (*TAGS, *OF_MEMORY) if first else TAGS
            code, output = await schemathesis(tmp_path, client.url, header, tags=tags, checks=checks, phases=phases)
    assert code == 0, output[-6_000:]


@pytest.mark.timeout(SECONDS + 60)
async def test_what_administrators_do_with_clients_and_what_anybody_may_ask(new_backend, serving, tmp_path):
    async with serving(new_backend(person_requests_per_min=10**9)) as client:
        token = await client.parts.sign_ins.new_token("Admin", ("admin",))
        await client.http.post("/api/v1/session", json={"token": token})
        code, output = await schemathesis(tmp_path, client.url, f"Cookie: {client.cookie()}", tags=("clients",))
        assert code == 0, output[-60_000:]
