"""A pad as a door of Open-RMF, and its queue as an ingestor's: what the ledger makes of them. Pure.

The door is open while a committed verdict permits somebody to act at the pad, and at no other time. That a door is
asked for is a wish: it is kept for a while, shown, and moves a closed door to *moving*, never to *open*.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from wonderland.asset_contract import CommittedEvent
from wonderland.messages.catalogue import message_of, text
from wonderland.proofs.queue import KEEPS_PLACE, Queue
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict

Message = Mapping[str, Any]

CLOSED, MOVING, OPEN, OFFLINE = 0, 1, 2, 3
MODES: Final = ("closed", "moving", "open", "offline")
WISH_MS: Final = 30_000
"""RMF repeats a wish each second while it has it."""
MAX_WISHES: Final = 64
IDLE, BUSY, AWAY = 0, 1, 2
RELEASE, LOCK = 0, 1
_WARNING, _ERROR = 1, 2
NEWS_MS: Final = 300_000
"""What is older is read from the ledger at a start, and alerts nobody any more."""
SEEN: Final = "Seen"


@dataclass(slots=True)
class _Wish:
    until_ms: int
    answered: bool = False


class Wishes:
    """Who asks for the door, by their own word; each is forgotten where it is not repeated."""

    def __init__(self) -> None:
        self._of: dict[str, _Wish] = {}

    def ask(self, requester: str, now_ms: int) -> bool:
        """Whether this is a new one. Of too many the one that was repeated least lately goes."""
        known = self._of.pop(requester, None)
        if known is not None and now_ms < known.until_ms:
            known.until_ms = now_ms + WISH_MS
            self._of[requester] = known
            return False
        while len(self._of) >= MAX_WISHES:
            del self._of[next(iter(self._of))]
        self._of[requester] = _Wish(now_ms + WISH_MS)
        return True

    def release(self, requester: str) -> bool:
        """Whether there was one."""
        return self._of.pop(requester, None) is not None

    def answer(self) -> None:
        """The ledger refused: what was wished until now keeps the door in motion no longer, though it be repeated."""
        for each in self._of.values():
            each.answered = True

    def held(self, now_ms: int, *, answered: bool = True) -> tuple[str, ...]:
        """Whose are kept, the oldest first; with ``answered`` false, those that still wait for a drone to prove."""
        for requester in [each for each, wish in self._of.items() if now_ms >= wish.until_ms]:
            del self._of[requester]
        return tuple(each for each, wish in self._of.items() if answered or not wish.answered)


def mode(queue: Queue | None, *, wished: bool) -> int:
    """The door's mode; ``queue`` is None while the pad's agent or the ledger is away."""
    if queue is None:
        return OFFLINE
    if permitted(queue) is not None:
        return OPEN
    return MOVING if queue.places or wished else CLOSED


def permitted(queue: Queue) -> Session | None:
    """Whose the pad is by a committed permission that holds; who has landed has used his."""
    occupant = queue.occupant
    return occupant.session if occupant is not None and not occupant.landed else None


def claimant(name: str) -> int:
    """The pad's number in a mutex group: far from those that RMF's schedule counts, and not the one for nobody."""
    return 1 << 63 | int.from_bytes(hashlib.sha256(name.encode()).digest()[:7])


def door_state(t_ms: int, name: str, value: int) -> Message:
    """``rmf_door_msgs/DoorState``."""
    return {"door_time": _stamp(t_ms), "door_name": name, "current_mode": {"value": value}}


def lock(group: str, name: str, since_ms: int, value: int) -> Message:
    """``rmf_fleet_msgs/MutexGroupRequest``; the same time in each request for the same lock."""
    return {"group": group, "claimant": claimant(name), "claim_time": _stamp(since_ms), "mode": value}


def ingestor_state(t_ms: int, name: str, queue: Queue | None) -> Message:
    """``rmf_ingestor_msgs/IngestorState``: who has the pad, and who waits in which order."""
    if queue is None:
        return {"time": _stamp(t_ms), "guid": name, "mode": AWAY}
    occupant = queue.occupant
    sessions = [] if occupant is None else [occupant.session]
    sessions += [each.session for each in queue.places]
    return {
        "time": _stamp(t_ms),
        "guid": name,
        "mode": BUSY if sessions else IDLE,
        "request_guid_queue": [f"{each.uav_id} {each.action} {each.session_id}" for each in sessions],
        "seconds_remaining": 0.0 if occupant is None else max(0, occupant.until_ms - t_ms) / 1_000,
    }


def refusal(door: str, verdict: Verdict, event: CommittedEvent) -> Message:
    """``rmf_task_msgs/Alert``: a verdict that permits nothing."""
    why = "\n".join(text("reasons", each.code, each.facts) for each in verdict.reasons)
    return _alert(
        door,
        f"{verdict.uav_id} was refused",
        why,
        tier=_ERROR if verdict.outcome == "refuted" else _WARNING,
        session_id=verdict.session_id,
        uav_id=verdict.uav_id,
        action=verdict.action,
        outcome=verdict.outcome,
        tx_id=event.tx_id,
    )


def broken_off(door: str, session: Session, event: CommittedEvent) -> Message | None:
    """``rmf_task_msgs/Alert``: a session that ended without what it was for; None where that is nobody's concern.

    A drone may change its mind; who is told to ask again keeps its place.
    """
    end = session.end or "cancelled"
    if session.state != "cancelled" or session.ended_by == "uav" or end in KEEPS_PLACE:
        return None
    why = text("console/end", end, {}) if message_of("console/end", end) else end.replace("_", " ")
    return _alert(
        door,
        f"the proof of {session.uav_id} was broken off",
        why,
        tier=_WARNING,
        session_id=session.session_id,
        uav_id=session.uav_id,
        action=session.action,
        outcome=end,
        tx_id=event.tx_id,
    )


def _alert(door: str, title: str, why: str, *, tier: int, session_id: str, **parameters: str) -> Message:
    return {
        "id": f"wonderland-{session_id}-{parameters['outcome']}",
        "title": f"{door}: {title}",
        "subtitle": f"{parameters['action']}: {parameters['outcome'].replace('_', ' ')}",
        "message": why,
        "display": True,
        "tier": tier,
        "responses_available": [SEEN],
        "alert_parameters": [
            {"name": name, "value": value}
            for name, value in {"door": door, "session_id": session_id, **parameters}.items()
        ],
    }


def _stamp(t_ms: int) -> Message:
    return {"sec": t_ms // 1_000, "nanosec": t_ms % 1_000 * 1_000_000}
