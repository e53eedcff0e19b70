"""A pad's queue by REST: what `wonderland.proofs.queue` makes of the sessions that the mirror has."""

from __future__ import annotations

from typing import Any

from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.queue import Occupant, Place, Queue, queue_of
from wonderland_backend.pads import queries


async def read_queue(database: AsyncSession, pad_id: str, now_ms: int) -> dict[str, Any]:
    """The queue of a pad at a moment, as JSON."""
    sessions, permitted = await queries.queueing(database, now_ms, pad_id)
    kept = (await queries.reservations(database, pad_id)).get(pad_id)
    queue = queue_of(sessions, permitted, now_ms, () if kept is None else kept.reservations)
    served = await queries.being_measured(database, [place.session.session_id for place in queue.places])
    return _queue_json(pad_id, now_ms, queue, served)


def _queue_json(pad_id: str, now_ms: int, queue: Queue, served: set[str]) -> dict[str, Any]:
    found: dict[str, Any] = {
        "pad_id": pad_id,
        "t_ms": now_ms,
        "waiting": [_place(place, number, served) for number, place in enumerate(queue.places, 1)],
        "reservations": [each.to_json() for each in queue.reservations],
    }
    if queue.occupant is not None:
        found["occupant"] = _occupant(queue.occupant)
    return found


def _occupant(occupant: Occupant) -> dict[str, Any]:
    session = occupant.session
    return {
        "session_id": session.session_id,
        "uav_id": session.uav_id,
        "action": session.action,
        "landed": occupant.landed,
        "since_ms": occupant.since_ms,
        "until_ms": occupant.until_ms,
    }


def _place(place: Place, number: int, served: set[str]) -> dict[str, Any]:
    session = place.session
    found: dict[str, Any] = {
        "place": number,
        "session_id": session.session_id,
        "uav_id": session.uav_id,
        "msp_id": session.uav.msp_id,
        "action": session.action,
        "rank": place.rank,
        "being_measured": session.session_id in served,
        "since_ms": place.since_ms,
        "at_most_ms": place.at_most_ms,
        "claim_ignored": place.claim_ignored,
    }
    if place.blocked_by:
        found["blocked_by"] = place.blocked_by
        found["kept"] = place.kept
    for name in ("priority", "battery_percent"):
        value = getattr(session, name)
        if value is not None:
            found[name] = value
    if session.precedence is not None:
        found["precedence"] = session.precedence.to_json()
    return found


def summary(queue: Queue) -> dict[str, Any] | None:
    """A queue on the live map: who has the pad, how many wait, for whom it is kept next; None where nobody does."""
    if queue.occupant is None and not queue.places and not queue.reservations:
        return None
    found: dict[str, Any] = {"waiting": len(queue.places)}
    if queue.occupant is not None:
        found["occupant"] = _occupant(queue.occupant)
    if queue.reservations:
        found["reservation"] = queue.reservations[0].to_json()
    return found
