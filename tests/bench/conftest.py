"""What the benchmarks share. They run by ``pytest tests/bench -m bench -s`` (``make bench``) and never with the tests.

Nothing here asserts a speed: a benchmark prints what it measured beside a peer or a floor of the same run, and asserts
only that the work was done.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from bench.bench_tools import NodeClient, node_modules

# Children are started while gRPC's threads run; its own fork handlers would only complain about it.
os.environ["GRPC_ENABLE_FORK_SUPPORT"] = "0"

from wonderland_fabric_gateway.connection import Connection
from wonderland_simulator.stage.processes import Processes

HERE = Path(__file__).parent


def pytest_addoption(parser):
    parser.addoption("--rows", type=int, default=1_000_000, help="how many positions the benchmark of history stores")
    parser.addoption("--consoles", type=int, default=200, help="how many consoles are connected to the live push")
    parser.addoption(
        "--minutes", type=float, default=1.0, help="how long the benchmarks of memory run (30: the full one)"
    )


def pytest_collection_modifyitems(config, items):
    """Only ``-m bench`` runs them: a plain ``pytest`` must not take minutes."""
    if "bench" in (config.option.markexpr or ""):
        return
    mine = [item for item in items if HERE in item.path.parents]
    if mine:
        config.hook.pytest_deselected(items=mine)
        items[:] = [item for item in items if HERE not in item.path.parents]


@pytest.fixture
async def processes(tmp_path):
    """Starts child processes; all are gone at the end."""
    async with Processes(tmp_path) as running:
        yield running


@pytest.fixture
def start_ledger(processes, tmp_path):
    """Starts an embedded ledger as a process of its own; returns its Connection and the Process."""
    count = 0

    async def start(*options):
        nonlocal count
        count += 1
        home = tmp_path / f"ledger-{count}"
        arguments = ["ledger", "start", "--data", str(home), "--listen", "127.0.0.1:0", "--json", *options]
        process = await processes.start(f"ledger-{count}", *arguments)
        return Connection.load(home), process

    return start


@pytest.fixture(scope="session")
def official_client(tmp_path_factory):
    """Directory in which the official Node client is installed; skips where it cannot be."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed: no official client to compare with")
    found = node_modules()
    if found is not None:
        return found
    source = HERE.parent / "node_gateway"
    if shutil.which("npm") is None or not (source / "package-lock.json").exists():
        pytest.skip("npm is not installed: the official client cannot be installed")
    target = tmp_path_factory.mktemp("node")
    for name in ("package.json", "package-lock.json", ".npmrc"):
        if (source / name).exists():
            shutil.copy(source / name, target / name)
    done = subprocess.run(
        ["npm", "ci", "--no-audit", "--no-fund"], cwd=target, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        pytest.skip(f"npm ci failed, so there is no official client: {done.stderr.splitlines()[-1:]}")
    return target


@pytest.fixture
async def node_client(official_client):
    """Opens the official client on a started ledger as one identity; all are closed at the end."""
    opened = []

    async def open_client(ledger, identity):
        process = await asyncio.create_subprocess_exec(
            "node",
            str(HERE / "gateway_client.mjs"),
            str(official_client),
            str(Path(ledger.ready["connection"]).parent),
            identity,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=1 << 24,
        )
        opened.append(process)
        client = NodeClient(process)
        assert (await client.read())["ready"]
        return client

    yield open_client
    for process in opened:
        process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), 5)
        except TimeoutError:
            process.kill()
            await process.wait()
        process._transport.close()


@pytest.fixture
def keep(record_property):
    """Puts figures into the report (``--junitxml``) and prints them as one JSON line, for machines."""

    def figures(**values):
        for name, value in values.items():
            record_property(name, value)
        print(json.dumps(values))

    return figures
