"""What the world's and the fleet's processes are told: one JSON file that the stage writes."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import logging
import signal
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wonderland_simulator.scenario import AnchorSite, AttackSpec, Behaviour, DroneSpec, PadSite
from wonderland_simulator.world import Ports


@dataclass(frozen=True)
class Plan:
    """Pads, drones, ports, seed, and where the run's files are."""

    directory: Path
    connection: Path
    pads: tuple[PadSite, ...]
    drones: tuple[DroneSpec, ...]
    ports: Ports
    seed: int

    def write(self, path: Path) -> None:
        """Write it as JSON, for the world's process to read."""
        path.write_text(json.dumps(dataclasses.asdict(self), default=str, indent=1))

    @classmethod
    def read(cls, path: Path) -> Plan:
        """From the file that ``write`` made."""
        value: dict[str, Any] = json.loads(path.read_text())
        pads = tuple(
            PadSite(**{**pad, "anchors": tuple(AnchorSite(**site) for site in pad["anchors"])}) for pad in value["pads"]
        )
        drones = tuple(
            DroneSpec(
                **{
                    **drone,
                    "behaviour": Behaviour(drone["behaviour"]),
                    "hover_m": tuple(drone["hover_m"]),
                    "away_m": tuple(drone["away_m"]),
                    "attack": _attack(drone.get("attack")),
                    "corridor_m": tuple(tuple(each) for each in drone.get("corridor_m", ())),
                    "impostor_m": None if drone.get("impostor_m") is None else tuple(drone["impostor_m"]),
                }
            )
            for drone in value["drones"]
        )
        return cls(
            Path(value["directory"]),
            Path(value["connection"]),
            pads,
            drones,
            Ports.from_json(value["ports"]),
            value["seed"],
        )


def _attack(value: dict[str, Any] | None) -> AttackSpec | None:
    if value is None:
        return None
    return AttackSpec(**{**value, "lie_m": tuple(value["lie_m"]), "spoofed_m": tuple(value["spoofed_m"])})


def _say_ready() -> None:
    print(json.dumps({"ready": True}), flush=True)  # noqa: T201 - the parent waits for this line


Ready = Callable[[], None]


def run_until_told(work: Callable[[Ready], Coroutine[Any, Any, None]]) -> None:
    """Run a process's one task until SIGTERM or SIGINT; it calls what it is given once it is ready."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")

    async def run() -> None:
        task = asyncio.ensure_future(work(_say_ready))
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await task

    asyncio.run(run())
