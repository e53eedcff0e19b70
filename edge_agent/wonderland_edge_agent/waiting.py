"""Whose turn it is at the pad: the ledger's queue (``wonderland.proofs.queue``), and what this agent has done with it.

The ids of what the queue depends on are kept durably, in the order of their requests; what stands behind them is read
from the ledger after a restart, so that who waited keeps its place.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Protocol

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.queue import EMERGENCY, Place, Queue
from wonderland.proofs.queue_book import RESERVATION_EVENTS, QueueBook
from wonderland_edge_agent.admission import MIN_SESSION_MS
from wonderland_edge_agent.spool import SpoolError

if TYPE_CHECKING:
    from wonderland.clock import Clock
    from wonderland.proofs.records.reservations import Reservations
    from wonderland.proofs.records.sessions import Session
    from wonderland.proofs.records.verdicts import Verdict
    from wonderland_edge_agent.spool import Spool

_log = logging.getLogger(__name__)

MAX_WAITING: Final = 64
"""Requests that wait for the pad. Of more, those whose turn would come last are ended: a flood ends its own."""
NOTE: Final = "queue"
AGAIN_S: Final = 1.0
_NOT_THERE: Final = 404


class QueueLedger(Protocol):
    """The ledger, as far as the queue goes."""

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        ...

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """Its verdict, if there is one."""

    async def read_reservations(self, pad_id: str) -> Reservations:
        """For whom the pad is kept."""
        ...

    async def give_precedence(self, session_id: str, reason: str) -> tuple[Session, Committed]:
        """Put a waiting request before all others."""
        ...


class Waiting:
    """The queue of this pad."""

    def __init__(self, pad_id: str, *, ledger: QueueLedger, spool: Spool, clock: Clock) -> None:
        self._book = QueueBook(pad_id)
        self._ledger = ledger
        self._spool = spool
        self._clock = clock
        self._begun: set[str] = set()
        self._noted: tuple[str, ...] = ()
        self._told = ""

    async def restore(self, begun: frozenset[str]) -> None:
        """Take up the queue of before a restart; ``begun``: sessions that were being served then."""
        self._begun |= begun
        await self._read_reservations()
        for session_id in await self._noted_ids():
            await self._read(session_id)

    async def _read_reservations(self) -> None:
        while True:
            try:
                self._book.reserved(await self._ledger.read_reservations(self._book.pad_id))
            except RefusedError as error:
                _log.warning("for whom the pad is kept is not known: %s", error)
                return
            except AwayError as error:
                _log.warning("the queue waits for the ledger: %s", error)
                await asyncio.sleep(AGAIN_S)
            else:
                return

    async def _noted_ids(self) -> list[str]:
        try:
            note = await self._spool.note(NOTE)
            ids = json.loads(note) if note else []
        except (SpoolError, ValueError) as error:
            _log.error("the queue of before the restart cannot be read: %s", error)
            return []
        return [each for each in ids if isinstance(each, str)] if isinstance(ids, list) else []

    async def _read(self, session_id: str) -> None:
        while True:
            try:
                session = await self._ledger.read_session(session_id)
                verdict = await self._ledger.read_verdict(session_id) if session.state == "decided" else None
            except RefusedError as error:
                if error.status != _NOT_THERE:
                    _log.warning("session %.12s: not taken up into the queue: %s", session_id, error)
                return
            except AwayError as error:
                _log.warning("the queue waits for the ledger: %s", error)
                await asyncio.sleep(AGAIN_S)
            else:
                self._book.put(session)
                if verdict is not None:
                    self._book.decided(verdict)
                return

    async def take(self, name: str, record: Mapping[str, Any]) -> None:
        """An event about this pad. Raises ProofError and AwayError.

        What frees the pad or puts somebody first is believed when the ledger's own record says it.
        """
        if name in {"PrecedenceGiven", "DepartureRecorded"}:
            session_id = record.get("session_id")
            if isinstance(session_id, str):
                await self._read(session_id)
        elif name in RESERVATION_EVENTS:
            await self._read_reservations()
        else:
            self._book.take(name, record)
        await self._note()

    async def _note(self) -> None:
        ids = self._book.session_ids
        if ids == self._noted:
            return
        try:
            await self._spool.put_note(NOTE, json.dumps(ids).encode())
            self._noted = ids
        except SpoolError as error:
            _log.error("the queue is not noted: %s", error)

    def queue(self) -> Queue:
        """As it is now."""
        queue = self._book.queue(self._clock())
        told = "" if queue.occupant is None or not queue.places else queue.occupant.session.uav_id
        if told and told != self._told and queue.occupant is not None and queue.occupant.landed:
            _log.warning("%s is on the pad; %d wait until it has left", told, len(queue.places))
        self._told = told
        return queue

    def waits(self, session_id: str) -> bool:
        """Whether this agent knows it as waiting, after a restart, too."""
        session = self._book.find(session_id)
        return session is not None and session.state == "requested" and session_id not in self._begun

    def next(self) -> Session | None:
        """Whom to serve now; it counts as begun from here on."""
        for place in self.queue().places:
            if not place.blocked_by and place.session.session_id not in self._begun and not self._late(place):
                self._begun.add(place.session.session_id)
                return place.session
        return None

    def again(self, session: Session) -> None:
        """It was not begun after all."""
        self._begun.discard(session.session_id)

    def to_end(self) -> list[tuple[str, str, str]]:
        """(session, reason, note) of those who waited too long, and of too many."""
        places = [place for place in self.queue().places if place.session.session_id not in self._begun]
        late = [(number, place) for number, place in enumerate(places, 1) if self._late(place)]
        ended = [(place, "queue_timeout", _why(place, number, len(places))) for number, place in late]
        ended += [(place, "pad_overloaded", "") for place in places[MAX_WAITING:] if not self._late(place)]
        self._begun |= {place.session.session_id for place, _, _ in ended}
        return [(place.session.session_id, reason, note) for place, reason, note in ended]

    def _late(self, place: Place) -> bool:
        return self._clock() > place.session.expires_ms - MIN_SESSION_MS

    async def record_override(self, session: Session) -> None:
        """Put on record that an emergency goes before others who came earlier."""
        queue = self.queue()
        place = next((each for each in queue.places if each.session.session_id == session.session_id), None)
        passed = queue.passed_over(session.session_id)
        if place is None or place.rank != EMERGENCY or not passed:
            return
        reason = f"emergency, by the drone's own word; before {passed} who came earlier"
        _log.warning("session %.12s: %s goes first: %s", session.session_id, session.uav_id, reason)
        try:
            put, _ = await self._ledger.give_precedence(session.session_id, reason)
        except (AwayError, RefusedError) as error:
            _log.warning("session %.12s: the override is not on record: %s", session.session_id, error)
        else:
            self._book.put(put)

    def status(self) -> dict[str, Any]:
        """For ``wonderland pad status``."""
        queue = self.queue()
        on_pad = queue.occupant
        return {
            "on_pad": "" if on_pad is None else on_pad.session.uav_id,
            "waiting": [place.session.uav_id for place in queue.places if place.session.session_id not in self._begun],
        }


def _why(place: Place, number: int, waiting: int) -> str:
    """For the drone's operator, who reads it in the session."""
    reason = "others go first"
    if place.blocked_by:
        reason = f"the pad is kept for {place.blocked_by}" if place.kept else f"{place.blocked_by} is on the pad"
    return f"{reason}; number {number} of {waiting}, {round(place.at_most_ms / 60_000)} min at most"
