"""Webhooks to several receivers at once: one that hangs delays no other, and the past comes in portions."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from kit.webhooks import SCOPES, Receiver, ca, poster, webhooks

from wonderland_backend.webhooks import deliver
from wonderland_backend.webhooks.deliver import AT_ONCE, Webhooks

__all__ = ["ca", "poster", "webhooks"]

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
START_MS = 1_800_000_000_000


async def arrived(receiver, count, within_s):
    async with asyncio.timeout(within_s):
        while len(receiver.requests) < count:
            receiver.arrived.clear()
            await receiver.arrived.wait()


@both
async def test_a_receiver_that_hangs_delays_no_other(running, machine, poster, ca, chain, facts, clock):
    hanging, healthy = Receiver(), Receiver()
    hanging.answers = ["hang"] * 1_000
    chain.add(*(facts.decide(f"more {index}", t_ms=START_MS + index) for index in range(2 * AT_ONCE)))
    await running.mirrored(chain.height)
    async with hanging.listening(ca) as bad, healthy.listening(ca) as good, machine(SCOPES) as http:
        for port in (bad, good):
            body = {"url": f"https://hooks.example:{port}/", "types": ["ProofDecided"], "after": "0.0"}
            assert (await http.post("/api/v1/subscriptions", json=body)).status_code == 201
        work = asyncio.create_task(
            Webhooks(running.context.database, poster, running.parts.sealing, running.parts.commits, clock).run()
        )
        try:
            await arrived(healthy, 2 + 2 * AT_ONCE, 8)
            # What happens later comes at once, too, although the other receiver has not answered anything yet.
            chain.add(facts.decide("later", pad_id="pad-2", t_ms=START_MS + 20_000))
            await arrived(healthy, 3 + 2 * AT_ONCE, 8)
            assert len(hanging.requests) == AT_ONCE
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)


async def test_whoever_wants_all_of_the_past_gets_it_in_portions(
    running, machine, webhooks, ca, chain, facts, monkeypatch
):
    monkeypatch.setattr(deliver, "PORTION", 3)
    monkeypatch.setattr(deliver, "MAX_WAITING", 5)
    chain.add(*(facts.decide(f"more {index}", t_ms=START_MS + index) for index in range(4)))
    await running.mirrored(chain.height)
    receiver = Receiver()
    async with receiver.listening(ca) as port, machine(SCOPES) as http:
        path = {}
        for name, types in (("all", []), ("few", ["ProofDecided"])):
            body = {"url": f"https://hooks.example:{port}/", "types": types, "after": "0.0"}
            path[name] = (await http.post("/api/v1/subscriptions", json=body)).headers["location"]

        async def waiting(name):
            return len((await http.get(f"{path[name]}/deliveries?state=waiting")).json()["items"])

        assert await webhooks.make()
        assert (await waiting("all"), await waiting("few")) == (3, 3), "the one does not wait for the other"
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(5):
                while await webhooks.make():
                    pass
        assert await waiting("all") == 6, "no more until these are through"
        while await webhooks.make() or await waiting("all"):
            await webhooks.send_due()
        events = (await http.get("/api/v1/events?after=0.0&limit=200")).json()["items"]
        assert len(events) > 6
        told = (await http.get(f"{path['all']}/deliveries?state=delivered")).json()["items"]
        assert sorted(each["event_id"] for each in told) == sorted(each["id"] for each in events)
