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
        "check": ("wonderland_simulator.world_tasks:check", "Say what is wrong with a scenario file."),
        "enrol": ("wonderland_simulator.world_tasks:enrol", "Enrol the world's pads and drones."),
        "health": ("wonderland_simulator.world_tasks:health", "Say whether every pad's agent works."),
        "register": ("wonderland_simulator.world_tasks:register", "Put a scenario's pads and vehicles on the ledger."),
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

    \b
    Your own pads and vehicles, with your own ledger and agents (docs/practise.md):
      wonderland world check scenario.yaml
      wonderland world run --scenario scenario.yaml --write ./practice
    """  # noqa: D301 - \b is click's mark for "do not wrap"
