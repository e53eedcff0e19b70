"""The quick start, word for word as the documentation has it, in a process of its own; and the client beyond it."""

from __future__ import annotations

import asyncio
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from wonderland.client import ApiError, TokenError, Unreachable, WebhookError, Wonderland, verify_webhook
from wonderland_backend.webhooks import signing

ROOT = Path(__file__).parents[2]
ALL = "wonderland.proofs.read wonderland.pads.read wonderland.drones.read wonderland.tracks.read wonderland.alerts.read"
ALL += " wonderland.proofs.request wonderland.subscriptions"


async def test_the_quick_start_runs_as_it_is_printed(running, register, chain, facts, tmp_path):
    chain.add(facts.put_uav("OH-DRN-0417"))
    await running.mirrored(chain.height)
    (program,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/api/README.md").read_text(), re.DOTALL)[:1]
    assert len([line for line in program.splitlines() if line.strip()]) <= 10
    row, secret = await register(running, "wonderland.proofs.read wonderland.pads.read")
    environment = os.environ | {
        "WONDERLAND_URL": running.url, "CLIENT_ID": row.client_id, "CLIENT_SECRET": secret, "PYTHONPATH": str(ROOT),
    }  # fmt: skip
    done = await asyncio.to_thread(
        subprocess.run,
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=60, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["pad-1 Aurajoki 2 commissioned", "pad-2 Aurajoki 2 registered"]
    assert lines[2:4] == ["uav-2 refuted assurance 2 block 5", "uav-1 verified assurance 2 block 3"]
    assert lines[4] == "unproven No proof tells whether the broadcast is true. ['never_heard', 'no_proof']"


async def test_the_client_needs_nothing_of_the_server():
    program = "import sys, wonderland.client; print([n for n in sys.modules if n.split('.')[0] in {'backend', 'fastapi', 'sqlalchemy', 'pydantic', 'cryptography', 'grpc'}])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_its_types_are_those_of_the_description():
    script = runpy.run_path(str(ROOT / "scripts" / "client_types.py"))
    ruff = Path(sys.executable).with_name("ruff")
    made = subprocess.run([ruff, "format", "-"], input=script["text"](), capture_output=True, text=True, check=True)
    assert script["TARGET"].read_text() == made.stdout, "run python scripts/client_types.py"


async def client_of(running, register, scopes=ALL, **options):
    row, secret = await register(running, scopes)
    return Wonderland(running.url, row.client_id, secret, http=httpx.Client(trust_env=False), **options)


async def test_every_list(running, register):
    with await client_of(running, register, language="fi") as api:

        def read():
            for each in (api.pads, api.drones, api.proofs, api.sessions, api.flights, api.tracks, api.authorisations, api.alerts, api.subscriptions):  # fmt: skip
                assert list(each()) == list(each(limit=1) if each != api.subscriptions else each())
            proof = api.proof(next(api.proofs(outcome="verified"))["proof_id"])
            return proof["signed"]["reasons"][0]["text"]

        assert (
            await asyncio.to_thread(read) == "Mitattu 0,12\u00a0m päähän ilmoituksesta, 1,00\u00a0m puskurin sisälle."
        )


async def test_a_request_for_a_proof(running, register):
    with await client_of(running, register) as api:
        made = await asyncio.to_thread(api.request_proof, "uav-1", "pad-1", valid_s=60)
        assert (await asyncio.to_thread(api.proof_request, made["request_id"]))["pad_id"] == "pad-1"
        with pytest.raises(ApiError, match="nobody") as refused:
            await asyncio.to_thread(api.request_proof, "nobody", "pad-1")
        assert (refused.value.status, refused.value.code) == (404, "not-found")


async def test_events_go_on_through_a_break(running, register, chain, facts, monkeypatch):
    monkeypatch.setattr("wonderland.client.api.PAUSE_S", 0.01)
    with await client_of(running, register) as api:
        events = api.events(after="0.0")
        seen = [await asyncio.to_thread(next, events) for _ in range(2)]
        running.parts.commits.stop()  # as a server that goes away
        running.parts.commits.stopping = False
        chain.add(facts.request("after the break"))
        seen += [await asyncio.to_thread(next, events) for _ in range(5)]
        events.close()
    places = [(each["block"], each["tx_index"]) for each in seen]
    assert places == sorted(set(places))
    assert len(places) == 7


async def test_credentials_that_are_not_good(running, register):
    row, _ = await register(running, ALL)
    with Wonderland(running.url, row.client_id, "wrong", http=httpx.Client(trust_env=False)) as api:
        with pytest.raises(TokenError) as refused:
            await asyncio.to_thread(api.conformance, "uav-1")
        assert refused.value.code == "invalid_client"
    with (
        Wonderland("http://127.0.0.1:1", "x", "y", http=httpx.Client(trust_env=False)) as api,
        pytest.raises(Unreachable),
    ):
        await asyncio.to_thread(api.conformance, "uav-1")


async def test_a_token_that_has_expired_and_limits_are_dealt_with(
    new_backend, serving, chain, source_of, register, clock
):
    async with serving(new_backend(source_of(chain), client_requests_per_min=2)) as client:
        with await client_of(client, register) as api:
            slept = []

            def sleep(seconds):
                slept.append(seconds)
                clock.now_ms += 60_000

            api._transport._sleep = sleep
            for _ in range(3):
                assert (await asyncio.to_thread(api.conformance, "x"))["status"] == "unknown"
            assert len(slept) == 1
            clock.now_ms += 3_700_000
            assert (await asyncio.to_thread(api.conformance, "x"))["status"] == "unknown"


def test_webhooks_are_checked():
    secret, body = signing.new_secret(bytes), json.dumps({"type": "ProofDecided"}).encode()
    headers = signing.headers(secret, "m1", 1_000, body)
    assert verify_webhook(secret, headers, body, clock=lambda: 1_299) == {"type": "ProofDecided"}
    titled = {name.title(): value for name, value in headers.items()}
    titled["Webhook-Signature"] = "v1,AAAA " + titled["Webhook-Signature"]
    assert verify_webhook(secret, titled, body, clock=lambda: 900)
    for changed, text, now in (
        ({}, body, 1_301),
        ({}, body, 699),
        ({}, body + b" ", 1_000),
        ({"webhook-id": "m2"}, body, 1_000),
        ({"webhook-timestamp": "1001"}, body, 1_000),
        ({"webhook-timestamp": "soon"}, body, 1_000),
        ({"webhook-signature": ""}, body, 1_000),
    ):
        with pytest.raises(WebhookError):
            verify_webhook(secret, headers | changed, text, clock=lambda now=now: now)
    with pytest.raises(WebhookError):
        verify_webhook("whsec_!!", headers, body, clock=lambda: 1_000)
    for bad in (b"x", b"[]"):
        with pytest.raises(WebhookError):
            verify_webhook(secret, signing.headers(secret, "m", 1, bad), bad, clock=lambda: 1)
