"""Inside the namespaces: brings a profile of compose.yaml up, waits for a granted permission, and says what it saw.

    run_profile.py COMPOSE PROFILE WORK TIMES      one JSON document on standard output

TIMES: how often it is brought up; from the second time on with what is in the volumes.
"""

import asyncio
import json
import sys
import time
from pathlib import Path

import httpx
from engine import Engine, EngineError

PATIENCE_S = 180


async def sign_in(engine, console):
    """As an operator does: a link printed by the backend's own command."""
    command = ["wonderland", "backend", "link", "--name", "Inspector", "--json"]
    code, output = await engine.execute(engine.services["backend"], command)
    if code:
        raise EngineError(output.decode())
    answer = await console.post("/api/v1/session", json={"token": json.loads(output.splitlines()[-1])["token"]})
    answer.raise_for_status()


async def granted(engine, console, after_block):
    """The first verdict of a later block that permits something."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        answer = (await console.get("/api/v1/verdicts", params={"limit": 50})).raise_for_status().json()
        for each in answer["items"]:
            if each["permission"] == "granted" and each["block"] > after_block:
                return each
        await asyncio.sleep(0.5)
    raise EngineError(f"no permission within {PATIENCE_S} s\n{engine.tail(engine.services['world'])}")


async def metrics(engine, console):
    """Names of metrics by kind of service, as whoever scrapes them would find them."""
    found = {"backend": _names((await console.get("/api/v1/metrics")).raise_for_status().text), "pad": set()}
    for path in (engine.work / "volumes" / "world").glob("pads/*/pad.prom"):
        found["pad"] |= _names(path.read_text())
    async with httpx.AsyncClient(trust_env=False, timeout=20) as client:
        for name, service in engine.services.items():
            kind = name.partition(".")[0].rstrip("0123456789").removesuffix("-a")
            if not service.is_job and "." in name:
                page = await client.get(f"http://{service.addresses['ledger']}:9443/metrics")
                found.setdefault(kind, set()).update(_names(page.raise_for_status().text))
    return {kind: sorted(names) for kind, names in found.items()}


def _names(text):
    return {line.partition("{")[0].partition(" ")[0] for line in text.splitlines() if line and line[0] != "#"}


async def once(engine, after_block):
    begin = time.monotonic()
    await engine.start()
    await engine.publish()
    healthy_s = time.monotonic() - begin
    async with httpx.AsyncClient(base_url="http://127.0.0.1:8080", trust_env=False, timeout=20) as console:
        anonymous = (await console.get("/api/v1/status")).status_code
        await sign_in(engine, console)
        verdict = await granted(engine, console, after_block)
        status = (await console.get("/api/v1/status")).raise_for_status().json()
        watched = await metrics(engine, console)
    return {
        "healthy_s": round(healthy_s, 1),
        "granted_s": round(time.monotonic() - begin, 1),
        "anonymous": anonymous,
        "verdict": {name: verdict[name] for name in ("outcome", "permission", "pad_id", "uav_id", "block")},
        "ledger": status["ledger"]["kind"],
        "height": status["ledger"]["height"],
        "metrics": watched,
        "seconds": {name: round(each.seconds_to_healthy, 1) for name, each in engine.services.items()},
        "mib": {
            name: round(engine.resident_bytes(each) / (1 << 20))
            for name, each in engine.services.items()
            if each.process.returncode is None
        },
    }


async def main(file, profile, work, times):
    engine = Engine(file, profile, work)
    engine.connect()
    runs, codes = [], []
    try:
        for _ in range(times):
            runs.append(await once(engine, runs[-1]["height"] if runs else 0))
            codes.append(await engine.stop())
    except (EngineError, ExceptionGroup) as error:
        for each in getattr(error, "exceptions", (error,)):
            print(each, file=sys.stderr)
        return 1
    limits = {name: each.document["deploy"]["resources"]["limits"]["memory"] for name, each in engine.services.items()}
    print(json.dumps({"runs": runs, "codes": codes, "limits": limits}))
    return 0


if __name__ == "__main__":
    sys.exit(asyncio.run(main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]))))
