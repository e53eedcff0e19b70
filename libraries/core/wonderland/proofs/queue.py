"""Who waits at a pad, in which order, and who stands on it: a pure function of the pad's sessions and the clock.

Pad, backend, drone and whoever reads the ledger compute the same from the sessions in the order of their requests on
the ledger (block, place in the block); nobody's list is believed, and no sender's clock moves him forward.

1. Who stands on the pad and asks to take off, for that is what frees it.
2. Who was put first (``Session.precedence``).
3. Emergencies, whom the pad is reserved for, low batteries, all others. An organisation's claims count up to
   ``CLAIMS_PER_HOUR`` at a pad. A reservation keeps low batteries waiting and all others, from so long before it
   that who is served then is done, until its drone has landed or it is over.
4. Among these in turn by organisation, so that many drones of one keep no drone of another waiting; then as they came.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.records.reservations import Reservation
from wonderland.proofs.records.sessions import Session

CLAIMS_PER_HOUR: Final = 6
HOUR_MS: Final = 3_600_000
LONGEST_MS: Final = 604_800_000
"""No policy keeps a pad for a drone that landed for longer than a week."""
RETURN_MS: Final = 30_000
"""Who was told to ask again keeps its place if it does so within this time."""
KEEPS_PLACE: Final = frozenset({"queue_timeout", "agent_restart"})
"""Ends of a waiting request that are nobody's refusal."""
ENTER: Final = frozenset({"land", "dock"})
COMPLETION_MS: Final = 62_000
"""A pad takes back a permission of which nothing was heard for so long, where the session does not live longer."""

LEAVES, PRECEDENCE, EMERGENCY, RESERVED = "leaves", "precedence", "emergency", "reserved"
LOW_BATTERY, NORMAL = "low_battery", "normal"
_RANKS: Final = {LEAVES: 0, PRECEDENCE: 1, EMERGENCY: 2, RESERVED: 3, LOW_BATTERY: 4, NORMAL: 5}


@dataclass(frozen=True, slots=True)
class Occupant:
    """Who has the pad, since when, and until when at most. ``landed``: it stands there; else it has a permission."""

    session: Session
    since_ms: int
    until_ms: int
    landed: bool

    def keeps_out(self, session: Session) -> bool:
        """Whether that request has to wait until this one has left."""
        return session.uav_id != self.session.uav_id and (session.action in ENTER or not self.landed)


@dataclass(frozen=True, slots=True)
class Place:
    """One waiting request. ``rank``: why it stands where it does; ``claim_ignored``: too many claims of priority."""

    session: Session
    arrival: int
    since_ms: int
    rank: str
    claim_ignored: bool
    blocked_by: str
    """The drone on the pad that has to leave first, or that the pad is kept for; empty: none."""
    at_most_ms: int
    """Until its turn, if nobody comes who goes first."""
    kept: bool = False
    """Whether a reservation is what blocks it."""


@dataclass(frozen=True, slots=True)
class Queue:
    """A pad's queue at a moment."""

    occupant: Occupant | None
    places: tuple[Place, ...]
    reservations: tuple[Reservation, ...] = ()
    """Those that are to come or hold, by their beginning."""

    def passed_over(self, session_id: str) -> int:
        """How many came before that request and are served after it."""
        place = next((each for each in self.places if each.session.session_id == session_id), None)
        if place is None:
            return 0
        behind = self.places[self.places.index(place) + 1 :]
        return sum(each.arrival < place.arrival for each in behind)


@dataclass(slots=True)
class _Root:
    """Where a drone's place in the queue began."""

    index: int
    since_ms: int
    precedence: bool


def queue_of(
    sessions: Sequence[Session],
    permitted: Container[str],
    now_ms: int,
    reservations: Sequence[Reservation] = (),
) -> Queue:
    """The queue of one pad.

    ``sessions``: in the order of their requests on the ledger, of the last hour, and who stands on the pad.
    ``permitted``: the ids of those whose verdict gives a permission.
    """
    to_come = tuple(each for each in reservations if now_ms < each.until_ms and not _used(each, sessions))
    occupant = _permitted(sessions, permitted, now_ms) or _landed(sessions, now_ms)
    roots = _roots(sessions)
    counted = _counted(sessions, roots, now_ms)
    waiting: list[tuple[str, _Root, Session]] = []
    for session in sessions:
        if session.state == "requested" and now_ms < session.expires_ms:
            root = roots[session.session_id]
            rank = _rank(session, root, occupant, counted)
            if _RANKS[rank] > _RANKS[RESERVED] and any(_holds(each, session, now_ms) for each in to_come):
                rank = RESERVED
            waiting.append((rank, root, session))
    waiting.sort(key=lambda each: (_RANKS[each[0]], each[1].index))
    turns: Counter[tuple[str, str]] = Counter()
    keyed: list[tuple[int, int, int, str, _Root, Session]] = []
    for rank, root, session in waiting:
        turn = turns[rank, session.uav.msp_id]
        turns[rank, session.uav.msp_id] += 1
        keyed.append((_RANKS[rank], turn, root.index, rank, root, session))
    keyed.sort(key=lambda each: each[:3])
    return Queue(occupant, tuple(_places(keyed, occupant, counted, to_come, now_ms)), to_come)


def _served_ms(session: Session) -> int:
    """How long a request can take the pad, from its turn to the landing."""
    return session.policy.session_ttl_ms + COMPLETION_MS


def _used(reservation: Reservation, sessions: Sequence[Session]) -> bool:
    """Whether its drone has landed by it."""
    return any(
        session.uav_id == reservation.uav_id
        and session.action in ENTER
        and session.end == "done"
        and (session.ended_ms or 0) >= reservation.from_ms - _served_ms(session)
        for session in sessions
    )


def _near(reservation: Reservation, session: Session, now_ms: int) -> bool:
    return session.action in ENTER and reservation.from_ms - _served_ms(session) <= now_ms < reservation.until_ms


def _holds(reservation: Reservation, session: Session, now_ms: int) -> bool:
    its = (reservation.uav_id, reservation.msp_id) == (session.uav_id, session.uav.msp_id)
    return its and _near(reservation, session, now_ms)


def _places(
    keyed: Iterable[tuple[int, int, int, str, _Root, Session]],
    occupant: Occupant | None,
    counted: frozenset[str],
    to_come: Sequence[Reservation],
    now_ms: int,
) -> Iterable[Place]:
    ahead_ms = 0
    for _, _, _, rank, root, session in keyed:
        blocked_by, until_ms, kept = "", now_ms, False
        if occupant is not None and occupant.keeps_out(session):
            blocked_by, until_ms = occupant.session.uav_id, occupant.until_ms
        elif _RANKS[rank] > _RANKS[RESERVED] and (near := [each for each in to_come if _near(each, session, now_ms)]):
            blocked_by, until_ms, kept = near[0].uav_id, max(each.until_ms for each in near), True
        yield Place(
            session=session,
            arrival=root.index,
            since_ms=root.since_ms,
            rank=rank,
            claim_ignored=session.priority is not None and session.session_id not in counted,
            blocked_by=blocked_by,
            at_most_ms=ahead_ms + until_ms - now_ms,
            kept=kept,
        )
        stays_ms = session.policy.occupied_ms or 0 if session.action in ENTER else 0
        ahead_ms += _served_ms(session) + stays_ms


def _permitted(sessions: Sequence[Session], permitted: Container[str], now_ms: int) -> Occupant | None:
    """The drone that may act now: the pad is its own until it has, or the permission lapses."""
    for session in sessions:
        if session.state == "decided" and session.decided_ms is not None and session.session_id in permitted:
            until_ms = max(session.expires_ms, session.decided_ms + COMPLETION_MS)
            if now_ms < until_ms:
                return Occupant(session, session.decided_ms, until_ms, landed=False)
    return None


def _landed(sessions: Sequence[Session], now_ms: int) -> Occupant | None:
    """The last drone that landed, while its policy keeps the pad for it and nothing says that it left."""
    done = [each for each in sessions if each.state == "completed" and each.end == "done" and each.ended_ms is not None]
    here: Session | None = None
    for session in sorted(done, key=lambda each: each.ended_ms or 0):
        if session.action in ENTER:
            here = session
        elif here is not None and session.uav_id == here.uav_id:
            here = None
    if here is None or here.ended_ms is None or here.departure is not None or here.policy.occupied_ms is None:
        return None
    until_ms = here.ended_ms + here.policy.occupied_ms
    return Occupant(here, here.ended_ms, until_ms, landed=True) if now_ms < until_ms else None


def _roots(sessions: Sequence[Session]) -> dict[str, _Root]:
    """By session, where its place began: with itself, or with the request that it takes up again."""
    roots: dict[str, _Root] = {}
    last: dict[tuple[str, str], Session] = {}
    for index, session in enumerate(sessions):
        before = last.get((session.uav_id, session.action))
        if before is not None and _takes_up(before, session):
            kept = roots[before.session_id]
            root = _Root(kept.index, kept.since_ms, kept.precedence or session.precedence is not None)
        else:
            root = _Root(index, session.requested_ms, session.precedence is not None)
        roots[session.session_id] = root
        last[session.uav_id, session.action] = session
    return roots


def _takes_up(before: Session, session: Session) -> bool:
    if before.state != "cancelled" or before.end not in KEEPS_PLACE or before.ended_by != "pad":
        return False
    if before.ended_ms is None or before.uav.msp_id != session.uav.msp_id:
        return False
    return abs(session.requested_ms - before.ended_ms) <= RETURN_MS


def _counted(sessions: Sequence[Session], roots: dict[str, _Root], now_ms: int) -> frozenset[str]:
    """The sessions whose claim of a priority counts: so many a place, an organisation and an hour."""
    claims: dict[str, set[int]] = {}
    counted: set[str] = set()
    for session in sessions:
        if session.priority is None or session.requested_ms < now_ms - HOUR_MS:
            continue
        places = claims.setdefault(session.uav.msp_id, set())
        index = roots[session.session_id].index
        if index in places or len(places) < CLAIMS_PER_HOUR:
            places.add(index)
            counted.add(session.session_id)
    return frozenset(counted)


def _rank(session: Session, root: _Root, occupant: Occupant | None, counted: frozenset[str]) -> str:
    if occupant is not None and session.uav_id == occupant.session.uav_id and session.action not in ENTER:
        return LEAVES
    if root.precedence:
        return PRECEDENCE
    if session.priority is not None and session.session_id in counted:
        return session.priority
    return NORMAL
