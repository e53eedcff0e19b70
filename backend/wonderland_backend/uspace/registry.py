"""Who operates a drone that does not say so itself: the number that is kept here of its registration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from wonderland_backend.db.engine import Database
from wonderland_backend.drones.queries import records_of
from wonderland_backend.numbers.store import numbers_of
from wonderland_backend.uspace.flights import Flight
from wonderland_remote_id.operators import public_operator_id

MAX_AT_ONCE: Final = 500


class Registry:
    """Looks registrations up, once for each flight."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._asked: set[str] = set()

    async def complete(self, flights: Iterable[Flight]) -> None:
        """Put the registered operator where a drone named none."""
        present = [flight for flight in flights if not flight.simulated]
        self._asked &= {flight.flight_id for flight in present}
        bare = [
            flight
            for flight in present
            if flight.details.operator.registration is None and flight.flight_id not in self._asked
        ][:MAX_AT_ONCE]
        if not bare:
            return
        self._asked |= {flight.flight_id for flight in bare}
        found = await self._registrations([flight.drone for flight in bare])
        for flight in bare:
            registration = found.get(flight.drone)
            if registration:
                operator = replace(flight.details.operator, registration=registration)
                flight.details = replace(flight.details, operator=operator)

    async def _registrations(self, drones: list[str]) -> dict[str, str]:
        async with self._database.read() as session:
            rows = await records_of(session, drones)
            found = await numbers_of(session, [record for _, record in rows])
        return {uav_id: public_operator_id(each.value) for uav_id, each in found.items()}
