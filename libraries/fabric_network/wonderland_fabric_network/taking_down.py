"""Stopping a network, and removing it."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.errors import DirectoryStateError

if TYPE_CHECKING:
    from wonderland_fabric_network.bringing_up import Report
    from wonderland_fabric_network.network import Network


async def take_down(network: Network, report: Report) -> None:
    """Stop everything, what leans on others first. Nothing is lost; `up` goes on. Raises `ComponentError`."""
    stages: dict[int, list[str]] = {}
    for name in network.processes.names():
        part = name.rpartition(".")[2]
        stage = 0 if part.startswith("contract") else 1 if part.startswith("peer") else 2
        stages.setdefault(stage, []).append(name)

    async def stop(name: str) -> None:
        if await network.processes.stop(name):
            report("down", f"{name} stopped")

    for stage in sorted(stages):
        await together(stop(name) for name in stages[stage])


def destroy(network: Network) -> None:
    """Remove all that `up` made, keys and ledgers included. Raises `DirectoryStateError`."""
    directory = network.directory
    running = [name for name in network.processes.names() if network.processes.pid(name) is not None]
    if running:
        raise DirectoryStateError(f"{', '.join(running)} still run; `wonderland network down` stops them")
    try:
        for each in (
            directory.path / "organisations",
            directory.run,
            directory.logs,
            directory.builder,
            directory.members,
        ):
            if each.exists():
                shutil.rmtree(each)
        for file in (
            directory.connection_file,
            directory.contract_file,
            directory.block_file,
            directory.ports_file,
            directory.lock_file,
            directory.mine_file,
            directory.description_file,  # the last one: until it is gone, there is a network to destroy
        ):
            file.unlink(missing_ok=True)
        if not any(directory.path.iterdir()):
            directory.path.rmdir()
    except OSError as cause:
        raise DirectoryStateError(f"{cause.filename}: cannot be removed ({cause.strerror})") from cause
