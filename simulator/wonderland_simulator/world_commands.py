"""``wonderland world``: simulated pads and drones on a ledger and a backend that run already."""

from __future__ import annotations

import os

import click

from wonderland.lazy_commands import LazyGroup

# Before any command brings gRPC along: processes are started while its threads run, and its own fork handlers would
# only complain about it.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")


@click.group(
    cls=LazyGroup,
    lazy={
        "enrol": ("wonderland_simulator.world_tasks:enrol", "Enrol the world's pads and drones."),
        "health": ("wonderland_simulator.world_tasks:health", "Say whether every pad's agent works."),
        "run": ("wonderland_simulator.world_tasks:run", "Fly, broadcast and prove until told to stop."),
    },
)
def world() -> None:
    """Simulated pads and drones on a ledger and a backend that run already.

    `wonderland demo` starts all of it on this machine; this is its world alone, for a system in containers or on
    machines of its own.

    \b
      wonderland world enrol --network DIR --to ./clients
      wonderland backend serve --connection ./clients/backend/connection.json …
      wonderland world run --connection ./clients/world/connection.json --backend http://backend:8080 --dir ./world
    """  # noqa: D301 - \b is click's mark for "do not wrap"
