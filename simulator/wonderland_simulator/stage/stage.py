"""One run: a directory, a ledger, what it must know, a backend and the pads' agents."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.registration import SALT_BYTES, Opening
from wonderland_backend.db.engine import Database
from wonderland_backend.numbers import store as numbers
from wonderland_backend.site_plans.store import keep
from wonderland_fabric_gateway.connection import Connection
from wonderland_simulator.configs import pad_toml
from wonderland_simulator.place.plans import site_plan
from wonderland_simulator.plan import Plan
from wonderland_simulator.scenario import DroneSpec, PadSite
from wonderland_simulator.stage.ledgers import EmbeddedStageLedger, FabricStageLedger, RunningStageLedger, StageLedger
from wonderland_simulator.stage.processes import PortClaims, Process, Processes
from wonderland_simulator.stage.registry import PAD_OPERATOR, REGISTRATION, Registry
from wonderland_simulator.world import LOOPBACK, Ports, anchor_path

Progress = Callable[[str], None]


def default_policy(pad: PadSite) -> Policy:
    """The pad's own buffer, everything else as the records say."""
    return Policy(buffer_mm=pad.buffer_mm, min_assurance=2)


@dataclass(frozen=True)
class StageSettings:
    """What differs from run to run. ``console``: directory of the built console, None to serve none."""

    pads: Sequence[PadSite]
    drones: Sequence[DroneSpec]
    console: Path | None = None
    port: int = 0
    ledger: str = "embedded"
    """``embedded`` or ``fabric``."""
    connection: Path | None = None
    """connection.json of a ledger that runs already, with identities for all pads and drones; None starts one."""
    backend_url: str = ""
    """A backend that runs already; empty: one is started."""
    pad_operator: str = PAD_OPERATOR
    map_archive: Path | None = None
    """PMTiles archive that the backend's map is drawn from; it may come while the backend runs."""
    policy: Callable[[PadSite], Policy] = default_policy
    commissioning: Callable[[PadSite], Commissioning] | None = None


@dataclass
class Stage:
    """Use as an asynchronous context; ``say`` hears how far it is."""

    directory: Path
    settings: StageSettings
    say: Progress = field(default=lambda _: None)
    connection: Connection = field(init=False)
    connection_file: Path = field(init=False)
    ports: Ports = field(init=False)
    backend: Process = field(init=False)
    """Where the stage has started one."""
    backend_url: str = field(init=False)
    processes: Processes = field(init=False)
    _ledger: StageLedger | None = field(init=False, default=None)
    _stack: AsyncExitStack = field(init=False, default_factory=AsyncExitStack)

    async def __aenter__(self) -> Self:
        try:
            await self._start()
        except BaseException:
            await self._stack.aclose()
            raise
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._stack.aclose()

    async def _start(self) -> None:
        self.directory.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._stack.push_async_callback(self._stop_ledger)  # last of all: the others still talk to it
        self.processes = await self._stack.enter_async_context(Processes(self.directory))
        self.say("Starting the ledger")
        self._ledger = self._make_ledger()
        self.connection_file = await self._ledger.start(self.settings.pads, self.settings.drones)
        self.connection = Connection.load(self.connection_file)
        self.backend_url = self.settings.backend_url
        if not self.backend_url:
            self.say("Starting the backend")
            self.backend = await self._start_backend()
            self.backend_url = self.backend.ready["url"]
        self.say("Registering pads and drones on the ledger")
        now_ms = time.time_ns() // 1_000_000
        channel = self.connection.open_channel()
        self._stack.push_async_callback(channel.close)
        registry = Registry(self.connection, channel, pad_operator=self.settings.pad_operator)
        await registry.pads(
            self.settings.pads,
            now_ms,
            policy=self.settings.policy,
            commissioning=self.settings.commissioning,
            site_plans=await self._keep_site_plans(now_ms),
        )
        await registry.drones(self.settings.drones, now_ms, commitments=await self._keep_numbers(now_ms))
        self._choose_ports()

    async def _keep_site_plans(self, now_ms: int) -> dict[str, str]:
        """Put the pads' plans into the database of the stage's own backend; their hashes by pad."""
        plans = {pad.pad_id: plan for pad in self.settings.pads if (plan := site_plan(pad.pad_id)) is not None}
        if self.settings.backend_url or not plans:
            return {}
        database = Database(self._database_url)
        try:
            async with database.write() as connection:
                return {pad_id: (await keep(connection, pad_id, plan, now_ms))[0] for pad_id, plan in plans.items()}
        finally:
            await database.close()

    async def _keep_numbers(self, now_ms: int) -> dict[str, str]:
        """Put the operator's number into the database of the stage's own backend; what the ledger gets, by drone."""
        if self.settings.backend_url:
            return {}
        database = Database(self._database_url)
        try:
            async with database.write() as connection:
                # A stage that goes on has registered them already.
                found = await numbers.openings_of(connection, [drone.uav_id for drone in self.settings.drones])
                for drone in self.settings.drones:
                    if drone.uav_id not in found:
                        opening = Opening.of(drone.uav_id, REGISTRATION, secrets.token_bytes(SALT_BYTES))
                        found[drone.uav_id] = opening
                        await numbers.keep(connection, opening, "the simulator", now_ms)
                return {uav_id: opening.commitment for uav_id, opening in found.items()}
        finally:
            await database.close()

    @property
    def _database_url(self) -> str:
        return f"sqlite:///{self.directory / 'backend.sqlite3'}"

    async def _stop_ledger(self) -> None:
        if self._ledger is not None:
            await self._ledger.stop()

    def _make_ledger(self) -> StageLedger:
        if self.settings.connection is not None:
            return RunningStageLedger(self.settings.connection)
        if self.settings.ledger == "fabric":
            return FabricStageLedger(self.directory / "network", self.say)
        return EmbeddedStageLedger(self.directory / "ledger", self.processes)

    async def _start_backend(self) -> Process:
        arguments = [
            "backend",
            "serve",
            "--connection",
            str(self.connection_file),
            "--identity",
            "mirror",
            "--database",
            self._database_url,
            "--listen",
            f"127.0.0.1:{self.settings.port}",
            "--demo",
            "--json",
        ]
        if self._ledger is not None and self._ledger.authorities is not None:
            arguments += ["--demo-registrar", str(self._ledger.authorities)]
        if self.settings.console is not None:
            arguments += ["--console", str(self.settings.console)]
        if self.settings.map_archive is not None:
            arguments += ["--map", str(self.settings.map_archive)]
        return await self.processes.start("backend", *arguments)

    def _choose_ports(self) -> None:
        pads, drones = self.settings.pads, self.settings.drones
        claims = PortClaims()
        self._stack.callback(claims.close)
        numbers = iter(claims.claim(len(pads) + len(drones) + 2))
        self.ports = Ports(
            rid={pad.pad_id: next(numbers) for pad in pads},
            position={drone.uav_id: next(numbers) for drone in drones},
            modes=next(numbers),
            commands=next(numbers),
        )

    async def start_world(self, *, seed: int = 1) -> None:
        """The world, then the pads' agents, then the drones' agents."""
        plan = Plan(
            directory=self.directory,
            connection=self.connection_file,
            pads=tuple(self.settings.pads),
            drones=tuple(self.settings.drones),
            ports=self.ports,
            seed=seed,
        )
        path = self.directory / "plan.json"
        plan.write(path)
        self.say("Starting the world")
        await self.processes.start("world", str(path), module="wonderland_simulator.run_world")
        await self.start_pads()
        self.say("Starting the drones' agents")
        await self.processes.start("fleet", str(path), module="wonderland_simulator.run_fleet")

    async def start_pads(self) -> None:
        """One agent for each pad; the world's serial devices must be there."""
        self.say("Starting the pads' agents")
        starting = []
        for pad in self.settings.pads:
            config = self.directory / "pads" / pad.pad_id / "pad.toml"
            config.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            config.write_text(self._pad_config(pad))
            arguments = ["pad", "run", "--config", str(config), "--json"]
            starting.append(asyncio.ensure_future(self.processes.start(f"pad-{pad.pad_id}", *arguments)))
        await asyncio.wait(starting)
        await asyncio.gather(*starting)  # the first error as itself

    def _pad_config(self, pad: PadSite) -> str:
        """The pad's configuration, as an operator would write it."""
        return pad_toml(
            pad.pad_id,
            self.connection_file,
            {site.anchor_id: anchor_path(self.directory, pad.pad_id, site.anchor_id) for site in pad.anchors},
            (LOOPBACK, self.ports.rid[pad.pad_id]),
            self.backend_url,
            extra=['metrics_file = "pad.prom"'],
        )
