"""The paper's boards from the box to the first verified drone, by the commands of docs/pad-operator.md, as processes."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
import socket
import sys
import time

import pytest
from click.testing import CliRunner
from kit.agents import ANCHORS, FRAME
from kit.contract import Scene

from wonderland.cli import main
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fira_uci.dwm1001 import BoardPosition
from wonderland_simulator.dwm1001_node import Quirks, VirtualAnchor, VirtualDwm1001
from wonderland_simulator.uci_node import PtyPort
from wonderland_simulator.world import send_position

BOARD = 0x1A2B
FILES = {"config": "pad.toml", "recording": "ranges.csv", "anchors": "survey.csv"}
RUN_S = 22
"""Of 20 s at least."""
pytestmark = pytest.mark.timeout(240)


async def start(*arguments):
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", "from wonderland.cli import main; main()", *map(str, arguments)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


async def run(*arguments, code=0):
    """What it printed. It ends with that exit code."""
    process = await start(*arguments)
    async with asyncio.timeout(60):
        out, err = await process.communicate()
    assert process.returncode == code, (arguments, out.decode(), err.decode())
    return out.decode()


async def can_prove(config):
    """Until the pad says so."""
    said = []
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(30):
            while True:
                process = await start("pad", "status", "--config", config)
                said.append((await process.communicate())[0].decode())
                if process.returncode == 0:
                    return
    pytest.fail(said[0] + said[-1])


@pytest.fixture
async def boards(world):
    """Five, out of the box: four for the pad, one for the drone."""
    drone = [VirtualAnchor(BOARD, "uav", BoardPosition(0, 0, 0))]
    made = {}
    for index, name in enumerate((*ANCHORS, "uav")):
        board = VirtualDwm1001(
            name,
            drone if name != "uav" else [],
            world.measure,
            rng=random.Random(index),
            quirks=Quirks(update_ms=100),
            address=BOARD if name == "uav" else 0x2000 + index,
        )
        board.mode = "an"
        made[name] = PtyPort(board, world.directory / f"tty-box-{name}")
        made[name].plug()
    yield made
    for port in made.values():
        port.close()


async def carried_about(world, track):
    """The drone on its way round the pad, and where a reference saw it."""
    with track.open("w") as file:
        file.write("t,x,y,z\n")
        begun_s = time.time()
        while True:
            angle = (time.time() - begun_s) * 2 * math.pi / RUN_S
            away = 5 + 3 * math.cos(2.7 * angle)
            east, north, up = away * math.cos(angle), away * math.sin(angle), 3 + 2 * math.sin(1.9 * angle)
            world.flight.truth = (1_000 * east, 1_000 * north, 1_000 * up)
            file.write(f"{time.time():.3f},{east:.4f},{north:.4f},{up:.4f}\n")
            file.flush()
            await asyncio.sleep(0.02)


async def autopilot(world, port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        while True:
            send_position(out, port, world.flight.claim(world.clock()))
            await asyncio.sleep(0.05)


@contextlib.asynccontextmanager
async def meanwhile(work):
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def test_dwm1001_boards_from_the_box_to_a_verified_drone(world, boards, unused_udp_port_factory):
    here = world.directory
    report_to, position = unused_udp_port_factory(), unused_udp_port_factory()
    DirectoryAdministration(world.ledger.directory).enrol("pad-2", role="pad", pol_id="pad-2")
    world.all_identities = Connection.load(here / "ledger")
    # 1. Roles.
    for name in ANCHORS:
        await run("uwb", "prepare", "--port", boards[name].path, "--role", "pad", "--network", "3caf")
    said = await run("uwb", "prepare", "--port", boards["uav"].path, "--role", "drone", "--network", "3caf")
    assert f"{BOARD:04x}" in said.lower()
    # 2. Does a tag measure?
    listen = ("uwb", "listen", "--kind", "dwm1001", "--port", boards["A1"].path, "--count", "3", "--json")
    summary = json.loads((await run(*listen)).splitlines()[-1])
    assert summary["peers"], summary
    # 3. The pad's settings and survey.
    anchors = "".join(f'\n[[anchors]]\nanchor_id = "{name}"\nport = "{boards[name].path}"\n' for name in ANCHORS)
    (here / "pad.toml").write_text(
        f'pad_id = "pad-2"\nconnection = "ledger/connection.json"\nidentity = "pad-2"\nspool = "spool-2"\n{anchors}\n'
        f'[uwb]\nkind = "dwm1001-tags"\nlisten = "127.0.0.1:{report_to}"\n'
    )
    rows = "".join(f"{name},{x / 1e3},{y / 1e3},{z / 1e3}\n" for name, (x, y, z) in ANCHORS.items())
    (here / "survey.csv").write_text("anchor,x,y,z\n" + rows)
    # 4. A run, and the commissioning from it.
    by_board = [part for name in ANCHORS for part in ("--board", f"{name}={boards[name].path}")]
    async with meanwhile(carried_about(world, here / "track.csv")):
        await run(
            *("uwb", "record", "--kind", "dwm1001", *by_board, "--peer", f"{BOARD:04x}"),
            *("--out", here / "ranges.csv", "--seconds", RUN_S),
        )
    commission = (
        *("pad", "commission", "--config", here / "pad.toml", "--recording", here / "ranges.csv"),
        *("--reference", here / "track.csv", "--anchors", here / "survey.csv", "--truth-shift", "auto"),
        *("--origin", f"{FRAME.lat_e7 / 1e7},{FRAME.lon_e7 / 1e7},{FRAME.height_mm / 1e3}"),
    )
    unknown = await run(*commission, "--yes", code=1)
    assert "The ledger has it" not in unknown
    assert "Committed in block" in await run(*commission, "--yes", "--register", "Roof", "--operator-id", "harbour")
    # 5. The authority takes assurance 0 at this pad; 6. the pad runs.
    policy = {"min_assurance": 0, "buffer_mm": 1_000}
    proposed = await world.call("admin", "ProposePolicy", pad_id="pad-2", action="*", policy=policy)
    await world.call("inspector", "ApproveChange", **Scene.approval(proposed))
    world.flight.truth = world.flight.claimed
    pad = await start("pad", "run", "--config", here / "pad.toml", "--json")
    try:
        async with asyncio.timeout(30):
            await pad.stdout.readline()
        await can_prove(here / "pad.toml")
        # 7. The drone.
        async with meanwhile(autopilot(world, position)):
            proof = await run(
                *("uav", "prove", "--connection", here / "ledger" / "connection.json", "--identity", "uav"),
                *("--port", boards["uav"].path, "--node", "dwm1001-anchor", "--board", f"{BOARD:04x}"),
                *("--report-to", f"127.0.0.1:{report_to}", "--position", f"udp:127.0.0.1:{position}"),
                *("--pad", "pad-2", "--json"),
            )
    finally:
        pad.terminate()
        await pad.communicate()
    result = json.loads(proof)
    assert result["verdict"]["outcome"] == "verified", result
    assert result["verdict"]["assurance"] == 0


@pytest.mark.parametrize(
    ("survey", "options", "why"),
    [
        ("anchor,x,y,z\nA1,0,0,0\nA2,2,0,0\nA3,0,2,1\n", (), "tied to the globe"),
        ("anchor,x,y,z\nA1,0,0,0\nA2,2,0,0\nA4,0,2,1\n", (), "A3, A4: in pad.toml or in the survey"),
        ("anchor,x,y,z\nA1,0,0,0\nA2,2,0,0\nA3,0,2,1\n", ("--reach", "9"), "--reach: only at a live pad"),
    ],
)
def test_what_is_published_from_a_recording_is_of_that_pad(tmp_path, survey, options, why):
    anchors = "".join(f'[[anchors]]\nanchor_id = "{name}"\nport = "/dev/{name}"\n' for name in ("A1", "A2", "A3"))
    (tmp_path / "pad.toml").write_text(f'pad_id = "p"\nconnection = "c.json"\nidentity = "p"\nspool = "s"\n{anchors}')
    (tmp_path / "survey.csv").write_text(survey)
    (tmp_path / "ranges.csv").write_text("t,anchor,range\n1,A1,2\n")
    files = [f"--{name}={tmp_path / file}" for name, file in FILES.items()]
    done = CliRunner().invoke(main, ["pad", "commission", *files, *options])
    assert done.exit_code in {1, 2}
    assert why in done.output
