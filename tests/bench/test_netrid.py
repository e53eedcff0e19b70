"""Network Remote ID and traffic over real HTTP: how fast flights are told, how late traffic is.

The floors are the standard's: F3411-22a gives a service provider 1 s in 95 % and 3 s in 99 % of all answers; AMC1 to
article 11 of EU 2021/664 wants traffic information within 5 s in 99 %. Ours for `/uss/flights` is 100 ms (95 %).
"""

from __future__ import annotations

import asyncio
import json
import statistics
import time

import pytest
from kit.uspace import authority, keys, new_uss, track
from msgspec import Raw

from wonderland_backend.agents.connected import Agent
from wonderland_backend.ingest.batch import read

__all__ = ["authority", "keys", "new_uss"]

pytestmark = pytest.mark.bench

FLIGHTS = 500
REQUESTS = 100
KEPT = 30
DRONES = 100
SECONDS = 20
VIEW = "60.43,22.24,60.47,22.30"


def drone(number, step=0):
    return track(
        f"SERIAL{number:05d}",
        lat=604_400_000 + number % 25 * 9_000 + step * 100,
        lng=222_450_000 + number // 25 * 20_000,
    )


def at(values, share):
    return sorted(values)[min(len(values) - 1, int(len(values) * share))]


@pytest.mark.parametrize("recent", [0, 60])
async def test_flights_in_a_view(new_uss, recent):
    async with new_uss() as uss:
        now = uss.uspace.clock()
        pad = Agent("pad", "pad-1", "1" * 32)
        for age in range(KEPT, -1, -1):  # positions of most of a minute, without writing them down
            uss.uspace.hear(
                read(pad, [Raw(json.dumps(each)) for each in heard_at(now, age)], acknowledged=0, now_ms=now)
            )
        headers = {"Authorization": f"Bearer {uss.authority.token()}"}
        params = {"view": VIEW, "recent_positions_duration": recent}
        took, worked, sizes = [], [], []
        for _ in range(REQUESTS):
            await uss.heard(*(drone(each, KEPT + 1) for each in range(20)))  # it goes on meanwhile
            began, began_work = time.perf_counter(), time.process_time()
            answer = await uss.http.get("/uss/flights", params=params, headers=headers)
            took.append(1000 * (time.perf_counter() - began))
            worked.append(1000 * (time.process_time() - began_work))
            sizes.append(len(answer.content))
        found = answer.json()["flights"]
        assert len(found) == FLIGHTS
        assert not recent or min(len(each["recent_positions"]) for each in found) >= KEPT // 2
        print(
            f"\n/uss/flights, {FLIGHTS} flights, {KEPT if recent else 0} positions of each, "
            f"{statistics.median(sizes) / 1000:.0f} kB: p50 {at(took, 0.5):.0f} ms, p95 {at(took, 0.95):.0f} ms, "
            f"p99 {at(took, 0.99):.0f} ms; of the processor, client included, p95 {at(worked, 0.95):.0f} ms "
            "(goal: p95 100 ms; standard: 1 s, 3 s)"
        )
        # By the processor's time: the machine may be busy with something else.
        assert at(worked, 0.95) <= 100
        assert at(took, 0.95) <= 1_000
        assert at(took, 0.99) <= 3_000


def heard_at(now_ms, age_s):
    body = {"claim_t_ms": now_ms - age_s * 1_000}
    return [
        {"seq": 1 + each, "kind": "track", "t_ms": now_ms, "body": drone(each, KEPT - age_s) | body}
        for each in range(FLIGHTS)
    ]


async def test_from_the_receiver_to_the_recipient(new_uss):
    """A drone a pad hears until a U-space service provider has it by the stream, each position of each drone."""
    async with new_uss() as uss:
        token = uss.authority.token(scope="wonderland.traffic.ussp")
        headers = {"Authorization": f"Bearer {token}", "Accept": "text/event-stream"}
        late = []

        async def listen():
            async with uss.http.stream("GET", "/api/v1/traffic", headers=headers, timeout=None) as answer:
                async for line in answer.aiter_lines():
                    if line.startswith("data: "):
                        now = time.time_ns() // 1_000_000
                        late.extend(now - each["heard_ms"] for each in json.loads(line[6:])["items"])

        listening = asyncio.create_task(listen())
        for step in range(SECONDS):
            began = time.monotonic()
            for each in range(0, DRONES, 10):
                await uss.heard(*(drone(number, step) for number in range(each, each + 10)))
            await asyncio.sleep(max(0.0, 1 - (time.monotonic() - began)))
        await asyncio.sleep(1)
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)
        shares = {share: at(late, share) for share in (0.5, 0.99)}
        print(
            f"\nreceiver to recipient, {DRONES} drones at 1 Hz, {len(late)} positions: p50 {shares[0.5]} ms, "
            f"p99 {shares[0.99]} ms (goal: 5,000 ms for 99 %)"
        )
        assert len(late) >= 0.95 * DRONES * SECONDS
        assert shares[0.99] <= 5_000
