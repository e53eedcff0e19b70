"""Runs the program as a user would, and looks for what it leaves behind."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

SERVERS = {"peer", "orderer", "fabric-ca-server"}
SHARED = Path(__file__).resolve().parents[3] / "shared"


@pytest.fixture
def wonderland():
    """Runs ``wonderland <arguments>`` to its end: (exit code, JSON lines, standard error)."""

    def run(*arguments: str, timeout_s: float = 100.0) -> tuple[int, list[dict], str]:
        done = subprocess.run(
            [sys.executable, "-m", "wonderland.cli", *arguments],
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
            env={**os.environ, "COLUMNS": "300"},
        )
        return (
            done.returncode,
            [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")],
            done.stderr,
        )

    return run


@pytest.fixture
def no_process_left():
    """Fails when a process that began during the test and belongs to this project still runs afterwards."""
    before = set(psutil.pids())
    yield
    left = []
    for process in psutil.process_iter(["pid", "cmdline", "ppid"]):
        line = " ".join(process.info["cmdline"] or ())
        if process.info["pid"] not in before and ("wonderland.cli" in line or "simulator.run_" in line):
            left.append(line)
    assert not left


@pytest.fixture
def hyu() -> Path:
    """Directory of the recorded ranges, or a skip."""
    directory = SHARED / "data" / "hyu"
    if not directory.is_dir():
        pytest.skip("the recordings (../shared/data/hyu) are not here")
    return directory


@pytest.fixture
def fabric_servers():
    """Skips with the reason where Fabric's servers are not here; they must leave nothing behind."""
    from wonderland.ledger.errors import LedgerError
    from wonderland.ledger.network import binaries

    try:
        asyncio.run(binaries.check())
    except LedgerError as error:
        pytest.skip(str(error))
    yield
    left = []
    for process in psutil.process_iter(["name"]):
        with contextlib.suppress(psutil.Error):
            places = [*process.cmdline(), *process.environ().values()]
            if process.info["name"] in SERVERS and any("wonderland-demo-" in place for place in places):
                left.append(process.info["name"])
    assert not left
