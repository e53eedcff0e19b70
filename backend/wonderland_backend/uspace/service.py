"""U-space as a part of a running backend."""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Final
from urllib.parse import urlsplit

from wonderland.geoid import Geoid, GeoidError
from wonderland_backend.agents.connected import UAV
from wonderland_backend.context import part
from wonderland_backend.errors import SettingsError
from wonderland_backend.http.limits import RateLimits
from wonderland_backend.http.targets import Destinations
from wonderland_backend.http.transfer import TransferError, new_client
from wonderland_backend.settings import Settings
from wonderland_backend.tokens import TokenVerifier
from wonderland_backend.uspace.claims import details_of, state_of
from wonderland_backend.uspace.dss.client import DssClient
from wonderland_backend.uspace.eu664.traffic import TrafficInformation
from wonderland_backend.uspace.flights import Flight, Flights
from wonderland_backend.uspace.geo import TILES, Box, Cell
from wonderland_backend.uspace.netrid.areas import Areas
from wonderland_backend.uspace.netrid.display import DisplayProvider
from wonderland_backend.uspace.netrid.harness import Harness
from wonderland_backend.uspace.netrid.notify import Notifier
from wonderland_backend.uspace.netrid.provider import ServiceProvider
from wonderland_backend.uspace.netrid.watches import Watches
from wonderland_backend.uspace.peers import Peers
from wonderland_backend.uspace.registry import Registry
from wonderland_backend.uspace.token_client import TokenClient

if TYPE_CHECKING:
    from wonderland_backend.agents.connected import Agents
    from wonderland_backend.db.engine import Database
    from wonderland_backend.ingest.batch import Batch
    from wonderland_backend.ingest.intake import Intake

logger = logging.getLogger(__name__)

STEP_S: Final = 1.0


class USpace:
    """What U-space's endpoints work on, and what runs beside them."""

    def __init__(self, settings: Settings, clock: Callable[[], int]) -> None:
        """`clock` gives milliseconds since the Unix epoch. Raises `SettingsError`."""
        self.settings = settings.uspace
        self.clock = clock
        self._client = new_client()
        self.host = urlsplit(settings.public_url or "http://localhost").hostname or "localhost"
        audiences = self.settings.audiences or (self.host,)
        try:
            self.verifier = TokenVerifier(
                self.settings.issuers,
                audiences,
                clock=clock,
                client=self._client,
                leeway_s=self.settings.clock_leeway_s,
            )
        except TransferError as error:
            raise SettingsError(f"uspace.issuers: {error}") from None
        self.limits = RateLimits(self.settings.requests_per_min, clock)
        self._operators = frozenset(self.settings.operators)
        self._drones = frozenset(self.settings.drones)
        self.is_connected: Callable[[str], bool] = lambda _: False
        """Whether a drone's own agent is connected."""
        self.flights = Flights(clock, lambda: str(uuid.uuid4()))
        self.provider = ServiceProvider(self.flights, clock, self.serves)
        try:
            geoid = Geoid(self.settings.geoid_file) if self.settings.geoid_file is not None else None
        except GeoidError as error:
            raise SettingsError(f"uspace.geoid_file: {error}") from None
        self.traffic = TrafficInformation(self.flights, self.serves, geoid)
        self.tokens = TokenClient(self.settings, clock=clock, client=self._client)
        self._registry: Registry | None = None
        self.problems = 0
        """How often an area could not be announced."""
        self.harness = Harness(self.flights, clock)
        known = (urlsplit(url).hostname or "" for url in self.settings.dss)
        self._others = new_client(keep=0)
        destinations = Destinations(frozenset(self.settings.allowed_hosts), settings.outbound_hosts)
        self.peers = peers = Peers(self._others, self.tokens, known=known, destinations=destinations)
        base_url = (settings.public_url or "").rstrip("/")
        dss = DssClient(self.settings.dss, clock=clock, peers=peers)
        self._notifier = Notifier(peers)
        self.areas = Areas(dss, self._notifier, base_url=base_url, clock=clock, on_problem=self._on_problem)
        watches = Watches(dss, base_url=base_url, clock=clock)
        self.display = DisplayProvider(watches, peers, self.provider, clock)

    def attach(self, intake: Intake, agents: Agents, database: Database) -> None:
        """Hear what agents report, learn which drones' are connected, and who operates them."""
        intake.listeners.append(self.hear)
        self._registry = Registry(database)
        self.is_connected = lambda drone: agents.is_connected(drone, UAV)

    def _on_problem(self, problem: str) -> None:
        self.problems += 1
        self.harness.notify(problem)

    def hear(self, batch: Batch) -> None:
        """What an agent reported, once the rest of it is durable."""
        for networked, positions in ((False, batch.heard), (True, batch.networked)):
            for t_ms, body in positions:
                state, details = state_of(body, t_ms), details_of(body)
                self.flights.take_state(body.uav_id, state, details, heard_ms=t_ms, networked=networked)

    @property
    def served(self) -> int:
        """How many flights other systems are told of."""
        return sum(1 for _ in self.provider.served())

    def serves(self, flight: Flight) -> bool:
        """Whether we are this drone's service provider: by agreement, never because a pad happens to hear it."""
        if flight.simulated or self.settings.serve == "heard":
            return True
        operator = flight.details.operator.registration
        return flight.drone in self._drones or operator in self._operators or self.is_connected(flight.drone)

    def covers(self, view: Box) -> bool:
        """Whether an identification service area of ours meets a view."""
        return self.areas.covers(view)

    async def run(self, instance: str) -> None:
        """Keep the DSS told, and forget what is over, until cancelled. `instance` names this installation."""
        self.areas.instance = instance
        while True:
            try:
                await self.step()
            except Exception:
                logger.exception("U-space: a step failed; the next one follows")
            await asyncio.sleep(STEP_S)

    async def step(self) -> None:
        """What is due now."""
        self.harness.advance()
        self.flights.tidy()
        self.display.tidy()
        if self._registry is not None:
            await self._registry.complete(self.flights)
        if not self.settings.dss:
            return
        flown = (state for flight in self.provider.served() for state in flight.states)
        await self.areas.step({Cell.at(state.lat, state.lng, TILES) for state in flown})
        await self.display.watches.tidy()

    async def close(self) -> None:
        """Close connections to other systems."""
        await self._notifier.close()
        await self.display.close()
        await self._client.aclose()
        await self._others.aclose()


USpaceDep = Annotated[USpace, part(USpace)]
