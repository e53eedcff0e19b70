"""The display provider: what service providers tell of a view, for people and test observers to look at.

What others tell is kept in memory for the standard's minute and never written down; the 24 hours that the standard
allows are not used.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import quote, urlsplit

from uas_standards.astm.f3411.v22a.constants import Scope

from wonderland_backend.http.backoff import Backoff, retry_after_s
from wonderland_backend.http.transfer import TransferError, parse_object
from wonderland_backend.uspace.claims import Details
from wonderland_backend.uspace.dss.models import parse
from wonderland_backend.uspace.flights import Flight, Flights
from wonderland_backend.uspace.geo import TILES, Box, cells_of
from wonderland_backend.uspace.netrid.clusters import Cluster, clusters_of, shows_each
from wonderland_backend.uspace.netrid.foreign import DetailsAnswer, FlightsAnswer, ForeignFlight
from wonderland_backend.uspace.netrid.provider import MAX_RECENT_S, ServiceProvider
from wonderland_backend.uspace.netrid.watches import Watches
from wonderland_backend.uspace.peers import Peers

logger = logging.getLogger(__name__)

POLL_MS: Final = 1_000
"""A view is asked for at most once a second, however many look at it."""
AGAIN_MS: Final = 5_000
"""A view that was not asked for so long begins anew, with all recent positions."""
QUIET_MS: Final = 10_000
"""A provider that has no area in a view is not asked again for so long."""
PATIENCE_S: Final = 2.5
"""Whoever looks waits so long for slow providers; what they answer later is there the next time."""
MAX_POLLS: Final = 2_000
PER_SECOND: Final = 20
"""Most requests to one provider within a second, over all views."""
SHOWN_MS: Final = 60_000
DISPLAY_PROVIDER: Final = Scope.DisplayProvider.value


@dataclass(frozen=True)
class Shown:
    """What may be shown of a view: `flights` where it is small, `clusters` where it is not."""

    flights: list[Flight]
    clusters: list[Cluster]
    providers: dict[str, str]
    """Who serves there besides us, by host name, and what is wrong with one: "" when nothing is."""


@dataclass
class _Provider:
    url: str
    backoff: Backoff = field(default_factory=Backoff)
    problem: str = ""
    second: int = 0
    asked: int = 0

    def may_ask(self, now_ms: int) -> bool:
        """Count a request, if it may be made."""
        if not self.backoff.is_open(now_ms):
            return False
        if self.second != now_ms // 1000:
            self.second, self.asked = now_ms // 1000, 0
        self.asked += 1
        return self.asked <= PER_SECOND


@dataclass
class _Poll:
    asked_ms: int = 0
    quiet_ms: int = 0
    task: asyncio.Task[None] | None = None


class DisplayProvider:
    """Looks at views."""

    def __init__(self, watches: Watches, peers: Peers, own: ServiceProvider, clock: Callable[[], int]) -> None:
        self.watches = watches
        self._peers = peers
        self._own = own
        self._clock = clock
        self._flights = Flights(clock, lambda: str(uuid.uuid4()))
        self._origins: dict[str, tuple[str, ForeignFlight]] = {}
        """By our id: who told of a flight, and as what."""
        self._providers: dict[str, _Provider] = {}
        self._polls: dict[tuple[str, Box], _Poll] = {}
        self._shown_ms: dict[str, int] = {}

    async def look_at_view(self, view: Box) -> Shown:
        """What is in a view now. Raises `TooManyRequests`."""
        urls = await self.watches.providers(cells_of(view, TILES))
        asking = [task for url in sorted(urls) if (task := self._ask(url, view)) is not None]
        if asking:
            await asyncio.wait(asking, timeout=PATIENCE_S)
        found = [flight for flight in self._all() if view.contains(flight.current.lat, flight.current.lng)]
        problems = {_host(url): self._provider(url).problem for url in urls}
        if not shows_each(view):
            return Shown([], clusters_of(found, view), problems)
        until_ms = self._clock() + SHOWN_MS
        self._shown_ms.update({flight.flight_id: until_ms for flight in found})
        return Shown(found, [], problems)

    async def details(self, flight_id: str) -> Details | None:
        """Who flies; None unless the flight was shown by itself within the last minute. Raises `TransferError`."""
        if self._shown_ms.get(flight_id, 0) < self._clock():
            return None
        own = next((flight for flight in self._own.served() if flight.flight_id == flight_id), None)
        if own is not None:
            return own.details
        origin, flight = self._origins.get(flight_id), self._flights.find_flight(flight_id)
        if origin is None or flight is None:
            return None
        url, told = origin
        if not flight.details.uas_id:
            address = f"{url}/uss/flights/{quote(told.id, safe='')}/details"
            status, _, body = await self._peers.ask("GET", address, DISPLAY_PROVIDER)
            if status == HTTPStatus.NOT_FOUND:
                return None
            if status != HTTPStatus.OK:
                raise TransferError(f"{_host(url)} answered {status}")
            try:
                answer = parse(DetailsAnswer, parse_object(body, url))
            except ValueError as error:
                raise TransferError(f"{_host(url)} answered what it should not: {error}") from None
            flight.details = answer.details.details(told.aircraft_type)
        return flight.details

    def provider_of(self, flight: Flight) -> str | None:
        """Host name of who told of a flight; None for our own."""
        origin = self._origins.get(flight.flight_id)
        return None if origin is None else _host(origin[0])

    def tidy(self) -> None:
        """Forget what is over."""
        self._flights.tidy()
        now = self._clock()
        self._origins = {
            each: told for each, told in self._origins.items() if self._flights.find_flight(each) is not None
        }
        self._shown_ms = {each: until for each, until in self._shown_ms.items() if until >= now}
        self._polls = {key: poll for key, poll in self._polls.items() if now - poll.asked_ms < 2 * SHOWN_MS}
        asked = {url for url, _ in self._polls}
        self._providers = {url: each for url, each in self._providers.items() if url in asked}

    async def close(self) -> None:
        """End what is under way."""
        tasks = [poll.task for poll in self._polls.values() if poll.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _all(self) -> Iterator[Flight]:
        yield from self._flights
        yield from self._own.served()

    def _provider(self, url: str) -> _Provider:
        return self._providers.setdefault(url, _Provider(url))

    def _ask(self, url: str, view: Box) -> asyncio.Task[None] | None:
        """Ask a provider for a view, unless it was asked just now: then its answer, where it is still on its way."""
        now = self._clock()
        poll = self._polls.get((url, view))
        if poll is None:
            if len(self._polls) >= MAX_POLLS:
                return None
            poll = self._polls[url, view] = _Poll()
        if poll.task is not None and not poll.task.done():
            return poll.task
        if now - poll.asked_ms < POLL_MS or now < poll.quiet_ms or not self._provider(url).may_ask(now):
            return None
        recent_s = MAX_RECENT_S if now - poll.asked_ms > AGAIN_MS else 0
        poll.asked_ms = now
        poll.task = asyncio.create_task(self._poll(url, view, recent_s, poll))
        return poll.task

    async def _poll(self, url: str, view: Box, recent_s: int, poll: _Poll) -> None:
        provider = self._provider(url)
        try:
            answer = await self._flights_of(url, view, recent_s)
        except _Later as error:
            provider.problem = str(error)
            provider.backoff.failed(self._clock(), error.retry_s)
        except TransferError as error:
            provider.problem = str(error)
            provider.backoff.failed(self._clock())
            logger.warning("a service provider could not be asked: %s", error)
        else:
            provider.backoff.succeeded()
            provider.problem = self._take(url, answer)
            if answer.no_isas_present:
                poll.quiet_ms = self._clock() + QUIET_MS

    async def _flights_of(self, url: str, view: Box, recent_s: int) -> FlightsAnswer:
        query: dict[str, Any] = {"view": view.view()}
        if recent_s:
            query["recent_positions_duration"] = recent_s
        status, headers, body = await self._peers.ask("GET", f"{url}/uss/flights", DISPLAY_PROVIDER, params=query)
        if status in {HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE}:
            raise _Later(f"{_host(url)} answered {status}", retry_after_s(headers.get("retry-after"), self._clock()))
        if status != HTTPStatus.OK:
            raise TransferError(f"{_host(url)} answered {status}")
        try:
            return parse(FlightsAnswer, parse_object(body, url))
        except ValueError as error:
            raise TransferError(f"{_host(url)} answered what it should not: {error}") from None

    def _take(self, url: str, answer: FlightsAnswer) -> str:
        """Take in what a provider told; what is wrong with it, "" when nothing is."""
        flights, bad = answer.good()
        now = self._clock()
        for told in flights:
            for state in told.states():
                if state.t_ms > now + 1000 * MAX_RECENT_S:
                    continue  # a clock that is wrong must not keep a flight for ever
                details = Details({}, told.aircraft_type)
                flight = self._flights.take_state(f"{url} {told.id}", state, details, heard_ms=now)
                if flight is not None:
                    self._origins[flight.flight_id] = url, told
        return f"{bad} of its flights cannot be read" if bad else ""


class _Later(TransferError):  # noqa: N818 - an answer
    """A provider asks to be left alone for a while."""

    def __init__(self, problem: str, retry_s: float) -> None:
        super().__init__(problem)
        self.retry_s = retry_s


def _host(url: str) -> str:
    return urlsplit(url).netloc
