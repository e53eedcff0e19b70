"""A drone's agent that stays, and proves whenever it is told to: python -m kit.drone_process CONNECTION PORT TRACK.

Reads lines: ``prove PAD``; writes one JSON object for each, and one when it is ready.
"""

import asyncio
import json
import sys
from pathlib import Path

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.agent import UavAgentError
from wonderland_uav_agent.assembly import assembled


async def main(connection, port, track):
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    acted = []

    async def act(verdict):
        acted.append(verdict.session_id)
        return "done"

    async with assembled(
        connection=Path(connection),
        identity="uav",
        port=port,
        node="uci",
        words="both_ways",
        report_to=None,
        board=None,
        position=f"track:{track}",
        geoid=None,
        antenna_m=(0.0, 0.0, 0.0),
        mavlink_key=None,
        remote_id=None,
        command=None,
        whole_certificate=False,
        wait_s=10.0,
        quiet=True,
        act=act,
        stays=True,
    ) as drone:
        looking = asyncio.create_task(drone.missing.run())
        while drone.missing.why_not():
            await asyncio.sleep(0.1)
        looking.cancel()
        print(json.dumps({"ready": True}), flush=True)
        while line := await reader.readline():
            try:
                result = await drone.agent.prove(line.split()[1].decode(), "land")
            except (LedgerError, UavAgentError) as error:
                print(json.dumps({"error": f"{type(error).__name__}: {error}"}), flush=True)
                continue
            verdict = None if result.verdict is None else result.verdict.to_json()
            told = {"session_id": result.session_id, "state": result.state, "end": result.end, "detail": result.detail}
            print(
                json.dumps(told | {"verdict_tx": result.verdict_tx, "verdict": verdict, "acted": list(acted)}),
                flush=True,
            )


asyncio.run(main(*sys.argv[1:]))
