"""Runs the program as a user would, and looks for what it leaves behind."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
import time
import uuid
from pathlib import Path

import psutil
import pytest

SHARED = Path(__file__).resolve().parents[3] / "shared"
MARK = "WONDERLAND_TEST_RUN"


@pytest.fixture
def environment():
    """Environment for what a test starts, with a mark that every process inherits; afterwards none may be left."""
    mark = uuid.uuid4().hex
    yield {**os.environ, "COLUMNS": "300", MARK: mark}
    deadline = time.monotonic() + 5
    while (left := _marked(mark)) and time.monotonic() < deadline:
        time.sleep(0.1)
    for process in left:
        with contextlib.suppress(psutil.Error):
            process.kill()
    assert not left


def _marked(mark: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.status() != psutil.STATUS_ZOMBIE and process.environ().get(MARK) == mark:
                found.append(process)
    return found


@pytest.fixture
def wonderland(environment):
    """Runs ``wonderland <arguments>`` to its end: (exit code, JSON lines, standard error)."""

    def run(*arguments: str, timeout_s: float = 100.0) -> tuple[int, list[dict], str]:
        done = subprocess.run(
            [sys.executable, "-m", "wonderland.cli", *arguments],
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
            env=environment,
        )
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        return done.returncode, lines, done.stderr

    return run


@pytest.fixture
def hyu() -> Path:
    """Directory of the recorded ranges, or a skip."""
    directory = SHARED / "data" / "hyu"
    if not directory.is_dir():
        pytest.skip("the recordings (../shared/data/hyu) are not here")
    return directory


@pytest.fixture
def fabric_servers() -> None:
    """Skips with the reason where Fabric's servers are not here."""
    from wonderland_fabric_gateway.errors import LedgerError
    from wonderland_fabric_network import binaries

    try:
        asyncio.run(binaries.check_binaries())
    except LedgerError as error:
        pytest.skip(str(error))
