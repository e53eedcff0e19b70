"""Brings a profile of compose.yaml up in containers of podman, kills each service, and says what it saw.

run_containers.py COMPOSE PROFILE WORK      one JSON document on standard output
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import sys
import time
from pathlib import Path

import httpx
import local_images
from podman_engine import PodmanEngine
from run_profile import PATIENCE_S, granted, sign_in

NEEDED = {"verified", "refuted"}


async def outcomes(console, needed):
    """Outcomes of all verdicts, as soon as these are among them."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        found = (await console.get("/api/v1/verdicts", params={"limit": 200})).raise_for_status().json()["items"]
        seen = {each["outcome"] for each in found}
        if needed <= seen or time.monotonic() > deadline:
            return sorted(seen)
        await asyncio.sleep(1)


async def watched(engine, port):
    """Up, verdicts, each server killed and back, verdicts again."""
    begin = time.monotonic()
    await engine.start()
    found = {"healthy_s": round(time.monotonic() - begin, 1), "killed": {}}
    found["servers"] = [name for name, each in engine.services.items() if not each.is_job]
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", trust_env=False, timeout=20) as console:
        found["anonymous"] = (await console.get("/api/v1/status")).status_code
        await sign_in(engine, console)
        first = await granted(engine, console, 0)
        found["granted_s"] = round(time.monotonic() - begin, 1)
        found["outcomes"] = await outcomes(console, NEEDED)
        found["block_before"] = first["block"]
        for name in found["servers"]:
            killed = time.monotonic()
            code = await engine.restart_killed(engine.services[name])
            found["killed"][name] = {"code": code, "healthy_again_s": round(time.monotonic() - killed, 1)}
        height = (await console.get("/api/v1/status")).raise_for_status().json()["ledger"]["height"]
        found["block_after"] = (await granted(engine, console, height))["block"]
    return found


async def main(file, profile, work):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    found = local_images.images(f"{local_images.PREFIX}/wonderland:test", profile, work)
    engine = PodmanEngine(
        file,
        profile,
        work,
        prefix=f"wonderland-test-{os.getpid()}",
        images=found,
        runtime=shutil.which("runc"),
        variables={"CONSOLE_PORT": str(port)},
    )
    try:
        engine.connect()
        said = await watched(engine, port)
        said["codes"] = await engine.stop()
    except Exception:
        for service in engine.services.values():
            print(f"--- {service.name}\n{engine.tail(service, 8)}", file=sys.stderr)
        raise
    finally:
        engine.remove()
    print(json.dumps(said))


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])))
