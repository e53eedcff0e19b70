"""A pad's sessions as the ledger's events tell them, kept as far as its queue depends on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from wonderland.proofs.queue import HOUR_MS, Queue, queue_of
from wonderland.proofs.records.reservations import Reservation, Reservations
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict

DECIDED: Final = "ProofDecided"
EVENTS: Final = frozenset(
    {"ProofRequested", DECIDED, "ProofCancelled", "InteractionCompleted", "PrecedenceGiven", "DepartureRecorded"}
)
RESERVATION_EVENTS: Final = frozenset({"PadReserved", "ReservationCancelled"})
_STAGE: Final = {"requested": 0, "decided": 1, "completed": 2, "cancelled": 2}


class QueueBook:
    """Of one pad. Events may come twice, as after a restart: nothing goes back by them."""

    def __init__(self, pad_id: str) -> None:
        self.pad_id: Final = pad_id
        self._sessions: dict[str, Session] = {}
        self._permitted: set[str] = set()
        self._reservations: tuple[Reservation, ...] = ()

    @property
    def session_ids(self) -> tuple[str, ...]:
        """In the order of their requests."""
        return tuple(self._sessions)

    def find(self, session_id: str) -> Session | None:
        """A session that is kept here."""
        return self._sessions.get(session_id)

    def take(self, name: str, record: Mapping[str, Any]) -> None:
        """An event of the contract. Raises ProofError for a record that cannot be read."""
        if name not in EVENTS | RESERVATION_EVENTS or record.get("pad_id") != self.pad_id:
            return
        if name in RESERVATION_EVENTS:
            self.reserved(Reservations.parse(record))
        elif name == DECIDED:
            self.decided(Verdict.parse(record))
        else:
            self.put(Session.parse(record))

    def put(self, session: Session) -> None:
        """A session as the ledger has it; an older state than the one that is kept changes nothing."""
        kept = self._sessions.get(session.session_id)
        if kept is not None:
            if _STAGE[session.state] < _STAGE[kept.state]:
                return
            session = replace(
                session,
                precedence=session.precedence or kept.precedence,
                departure=session.departure or kept.departure,
            )
        self._sessions[session.session_id] = session

    def decided(self, verdict: Verdict) -> None:
        """A verdict came; the session has not ended by it."""
        kept = self._sessions.get(verdict.session_id)
        if kept is None:
            return
        if kept.state == "requested":
            self._sessions[kept.session_id] = replace(kept, state="decided", decided_ms=verdict.decided_ms)
        if verdict.permission == "granted":
            self.permitted(verdict.session_id)

    def permitted(self, session_id: str) -> None:
        """Its verdict gives a permission."""
        if session_id in self._sessions:
            self._permitted.add(session_id)

    def reserved(self, reservations: Reservations) -> None:
        """For whom the pad is kept, as the ledger has it now."""
        self._reservations = reservations.reservations

    def queue(self, now_ms: int) -> Queue:
        """As it is now; what it depends on no longer is forgotten."""
        queue = queue_of(tuple(self._sessions.values()), self._permitted, now_ms, self._reservations)
        keep = queue.occupant.session.session_id if queue.occupant is not None else ""
        for session in list(self._sessions.values()):
            old = now_ms - max(session.expires_ms, session.ended_ms or 0) > HOUR_MS
            if old and session.session_id != keep:
                del self._sessions[session.session_id]
                self._permitted.discard(session.session_id)
        return queue
