"""A request takes one connection to the database at a time, so that many of them cannot wait for one another."""

from __future__ import annotations

import contextlib
import re

from kit.description import document

STREAMS = {"/api/v1/events", "/api/v1/traffic/stream", "/api/v1/live"}
ONES = {"pad_id": "pad-1", "uav_id": "uav-1", "session_id": "one", "number": "1", "day": "2026-01-01"}


def addresses():
    for path, operations in document()["paths"].items():
        if "get" in operations and path.startswith("/api/v1") and path not in STREAMS:
            yield re.sub(r"\{([^}]*)\}", lambda name: ONES.get(name[1], "0"), path)


async def test_one_connection_is_enough_for_every_request(running, monkeypatch):
    engine = running.context.database.engine
    monkeypatch.setattr(engine.pool, "_timeout", 2)
    asked, waited = 0, []
    async with contextlib.AsyncExitStack() as stack:
        for _ in range(2 * engine.pool.size() - 1):
            await stack.enter_async_context(engine.connect())
        for address in addresses():
            answer = await running.http.get(address)
            asked += 1
            if answer.status_code == 503 and answer.json()["type"].endswith("database-busy"):
                waited.append(address)
    assert asked > 40
    assert waited == []
