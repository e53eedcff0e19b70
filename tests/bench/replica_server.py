"""A backend on a bus, in a process of its own: `python -m bench.replica_server on-duty|EPOCH DATABASE MEMBER RATE`.

`on-duty` hears RATE positions a second, as `live_server.py` does, and prints its epoch and a link; with the epoch of one
that is on duty the process follows it. MEMBER: settings of its session (kit.bus_router.written). Ends with its input.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from pathlib import Path

from bench.live_server import Feed
from kit.console import keep_usual

from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.http.times import now_ms
from wonderland_backend.listening import Listen, Loop
from wonderland_backend.replicas.bus import Bus
from wonderland_backend.serve import leave_to_itself, new_server
from wonderland_backend.settings import Settings
from wonderland_bus.session import open_member
from wonderland_bus.settings import Member, Tls


def member_of(text):
    found = json.loads(text)
    tls = Tls(**{name: Path(file) for name, file in found.pop("tls").items()})
    return Member(tls=tls, **found)


async def main():
    role, url, member, rate = sys.argv[1:]
    bus = Bus(await asyncio.to_thread(open_member, member_of(member)), now_ms)
    database = Database(url)
    hosts = frozenset({"127.0.0.1"})
    backend = Backend(Settings(), database=database, peers=bus, allowed_hosts=hosts)
    told = {"epoch": backend.context.epoch}

    async def holder():
        return role

    async with contextlib.AsyncExitStack() as stack:
        stack.push_async_callback(bus.close)
        tasks = []
        if role == "on-duty":
            await keep_usual(database)
            await stack.enter_async_context(backend.running())
            tasks.append(asyncio.create_task(Feed(backend.parts.board, int(rate), int(rate), ()).run()))
            told["token"] = await backend.parts.sign_ins.new_token("M. Inspector", ("inspector",))
        else:
            await stack.enter_async_context(backend.running(holder))
        bound = Listen("127.0.0.1", 0).open()
        server = new_server(backend.app, backend.settings)
        tasks.append(asyncio.create_task(server.serve([bound])))
        while not server.started:
            await asyncio.sleep(0.01)
        leave_to_itself()
        port = bound.getsockname()[1]
        link = f"http://127.0.0.1:{port}/#token={told.pop('token', '')}"
        print(json.dumps({"port": port, "link": link, **told}), flush=True)
        await asyncio.to_thread(sys.stdin.read)
        backend.end_streams()
        server.should_exit = True
        for task in tasks[:-1]:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


if __name__ == "__main__":
    with asyncio.Runner(loop_factory=Loop) as runner:
        runner.run(main())
