"""``python -m kit.bus_backend SETTINGS.json``: a backend on a database that is there, which takes agents in by the bus.

With `agents` also by its listener for them. The organisations are told it, as the mirror would from the channel's
configuration. It prints a line when agents can come, with the listener's port, and ends with SIGTERM.
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

from wonderland_backend.app import Backend
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.listening import Listen, only_agents
from wonderland_backend.serve import new_agents_server
from wonderland_backend.settings import Settings


async def main(told: dict) -> None:
    database = Database(told["database"])
    await migrate(database)
    backend = Backend(Settings(tick_ms=20, bus=told["bus"], agents=told.get("agents", {})), database=database)
    async with backend.running():
        await backend.parts.sign_ins.new_token("Inspector", ("inspector",))  # set up: agents are taken in
        port = 0
        if backend.settings.agents.listen is not None:
            server = new_agents_server(only_agents(backend.app), backend.settings, backend.parts.members.tls)
            bound = Listen("127.0.0.1", 0).open()
            port = bound.getsockname()[1]
            serving = asyncio.create_task(server.serve([bound]))
        backend.parts.members.configure(told["organisations"])
        assert backend.bus is not None
        await backend.bus.listener.listening.wait()
        print(json.dumps({"ready": True, "port": port}), flush=True)
        await (serving if port else asyncio.Event().wait())


if __name__ == "__main__":
    asyncio.run(main(json.loads(Path(sys.argv[1]).read_text())))
