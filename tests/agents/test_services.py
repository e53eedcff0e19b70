"""Agents as services: what a service manager hears, units that systemd accepts, settings that are explained."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from kit.agents import ANCHORS
from kit.service_manager import manager, next_said

from wonderland.service_manager import ServiceManager
from wonderland_uav_agent.commands import uav

UNITS = sorted((Path(__file__).parents[2] / "deploy" / "systemd").glob("*.service"))
EXPOSED = 2.0
"""Of 10, by `systemd-analyze security`."""
SYSTEMD = 252
"""The first that judges a unit without running it, and knows all that these say; Debian 12 has it."""


def systemd_version():
    """0 where there is none."""
    if shutil.which("systemd-analyze") is None:
        return 0
    said = subprocess.run(["systemd-analyze", "--version"], capture_output=True, text=True, check=False).stdout
    return int((re.match(r"systemd (\d+)", said) or [0, 0])[1])


async def test_it_hears_that_the_loop_turns_and_that_it_stops(tmp_path):
    with manager(tmp_path) as (told, environment):
        service = ServiceManager(environment)
        service.tell("READY=1")
        async with service.alive():
            assert [await next_said(told) for _ in range(3)] == ["READY=1", "WATCHDOG=1", "WATCHDOG=1"]
        while (said := await next_said(told)) == "WATCHDOG=1":
            pass
        assert said == "STOPPING=1"
    service.tell("READY=1")  # it is gone


async def test_without_one_nothing_is_said_and_for_another_process_no_watchdog_beats(tmp_path):
    async with ServiceManager({}).alive():
        pass
    with manager(tmp_path) as (told, environment):
        async with ServiceManager(environment | {"WATCHDOG_PID": "1"}).alive():
            await asyncio.sleep(0.3)
        assert await next_said(told) == "STOPPING=1"


@pytest.mark.parametrize("which", ["pad", "uav"])
async def test_agents_tell_it(world, which):
    directory = world.directory
    if which == "pad":
        # One of its anchors is not there: no reason to be started again and again.
        anchors = "".join(f'[[anchors]]\nanchor_id = "{n}"\nport = "{directory}/tty-{n}"\n' for n in ANCHORS)
        text = f'pad_id = "pad-1"\nconnection = "ledger/connection.json"\nspool = "spool"\n{anchors}'
        text = text.replace("tty-A4", "tty-none")
        command = ("pad", "run")
    else:
        text = f'connection = "ledger/connection.json"\nport = "{directory}/tty-uav"\npads = ["pad-1"]\n'
        text += 'position = "mavlink:udp:127.0.0.1:0"\nbackend = "ws://127.0.0.1:9/ingest"\n[flight]\n'
        command = ("uav", "serve")
    settings = directory / f"{which}.toml"
    settings.write_text(text)
    with manager(directory) as (told, environment):
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wonderland.cli", *command, "--config", str(settings)),
            env={**os.environ, **environment},
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
        )
        try:
            said = [await next_said(told) for _ in range(4)]
            assert {"READY=1", "WATCHDOG=1"} == set(said)
            process.send_signal(signal.SIGTERM)
            while (last := await next_said(told)) == "WATCHDOG=1":
                pass
            assert last == "STOPPING=1"
            assert await asyncio.wait_for(process.wait(), 20) == 0
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()


@pytest.mark.skipif(
    systemd_version() < SYSTEMD, reason=f"needs systemd-analyze of {SYSTEMD} or later (Debian: systemd)"
)
@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.stem)
def test_units_are_accepted_and_expose_little(unit, tmp_path):
    text = unit.read_text().replace("/usr/bin/wonderland", sys.executable)
    path = tmp_path / unit.name
    path.write_text(text)
    checked = subprocess.run(["systemd-analyze", "verify", str(path)], capture_output=True, text=True, check=False)
    about_it = [line for line in checked.stderr.splitlines() if unit.name in line]
    assert (checked.returncode, about_it) == (0, []), checked.stderr
    judged = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", f"--threshold={round(10 * EXPOSED)}", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert judged.returncode == 0, judged.stdout[-400:]


def test_there_are_units():
    assert [unit.name for unit in UNITS] == [
        "wonderland-backend.service",
        "wonderland-backup.service",
        "wonderland-bus.service",
        "wonderland-pad.service",
        "wonderland-ros1.service",
        "wonderland-ros2.service",
        "wonderland-uav.service",
    ]


def explained(directory, *more, text=""):
    path = directory / "uav.toml"
    path.write_text(
        f'connection = "{directory}/ledger/connection.json"\nport = "/dev/ttyUSB0"\npads = ["pad-1"]\n'
        f'backend = "wss://console.example/ingest"\n{text}'
    )
    return CliRunner().invoke(uav, ["serve", "--check", "--config", str(path), *more])


TEXT = """position = "mavlink:serial:/dev/ttyAMA0"
antenna = [0.1, 0, -0.2]
[flight]
refused = "return"
"""


def test_settings_are_explained_and_nothing_is_opened(prepared_ledger):
    directory = prepared_ledger.parent
    flown = explained(directory, text=TEXT)
    assert flown.exit_code == 0, flown.output
    for words in (
        "This is drone uav-1 ",
        "at /dev/ttyUSB0.",
        "the autopilot at mavlink:serial:/dev/ttyAMA0:921600, not signed",
        "antenna is 0.1 m forward, 0 m right, -0.2 m down of the place",
        "It proves itself at pad-1",
        "It lands by the ranges of its node",
        "is held 8 m above it until a committed verdict permits the landing; after 3 proofs without one it returns",
    ):
        assert words in flown.output, flown.output
    told = explained(
        directory, text=f'remote_id = "mavlink"\n{TEXT}[open_drone_id]\noperator_id = "FIN87astrdge12k8-xyz"\n'
    )
    assert "It signs for what it broadcasts, by the word of mavlink." in told.output
    assert "told to broadcast serial number uav-1 and operator FIN87astrdge12k8." in told.output
    untold = explained(directory, text='position = "track:x.csv"\nremote_id = "mavlink"\n')
    assert (untold.exit_code, "only with --position mavlink" in untold.output) == (1, True)
    plain = explained(directory, text='position = "track:x.csv"\n')
    assert "Nothing is asked of an autopilot" in plain.output
    open_ = explained(directory, text='position = "mavlink:udp:0.0.0.0:14540"\n[flight]\n')
    assert open_.exit_code == 1
    assert "give --mavlink-key" in open_.output
    far = explained(directory, "--antenna", "9", "0", "0", text=TEXT)
    assert far.exit_code == 2
    assert "not in the range" in far.output
    flat = explained(directory, text=TEXT.replace(", -0.2", ""))
    assert "antenna is [0.1, 0], expected a list of length 3" in flat.output


def test_without_a_backend_it_flies_by_permission_or_has_nobody_who_asks(prepared_ledger):
    directory = prepared_ledger.parent
    path = directory / "uav.toml"
    alone = f'connection = "{directory}/ledger/connection.json"\nport = "/dev/ttyUSB0"\npads = ["pad-1"]\n{TEXT}'
    path.write_text(alone)
    flown = CliRunner().invoke(uav, ["serve", "--check", "--config", str(path)])
    assert flown.exit_code == 0, flown.output
    assert "It proves itself at pad-1 when it begins to land there; nobody else asks it" in flown.output
    path.write_text(alone[: alone.index("[flight]")])
    nobody = CliRunner().invoke(uav, ["serve", "--check", "--config", str(path)])
    assert nobody.exit_code == 2
    assert "--backend, --orders or [flight]" in nobody.output
