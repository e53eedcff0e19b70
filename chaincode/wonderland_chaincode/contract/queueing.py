"""Who goes first at a pad, and who has left it. The order itself follows from the sessions (``proofs.queue``)."""

from __future__ import annotations

from dataclasses import replace

from wonderland.proofs.queue import ENTER
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.sessions import Departure, Precedence
from wonderland_chaincode.contract import access, sessions
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import conflict, not_allowed, refused


async def give_precedence(call: Call, argument: tx.GivePrecedence) -> Answer:
    """GivePrecedence."""
    session = await sessions.require(call, argument.session_id)
    part = access.part_in(call.who, session)
    if part == "pad" and session.priority != "emergency":
        raise not_allowed("NO_EMERGENCY", "a pad puts first by itself only who asked with priority emergency")
    if session.precedence is not None:
        raise conflict("PRECEDENCE_GIVEN", f"session {session.session_id[:12]}… was put first already")
    if session.state != "requested" or call.now_ms >= session.expires_ms:
        raise refused("NOT_WAITING", f"session {session.session_id[:12]}… waits no longer")
    given = Precedence(by=part, name=access.name_of(call.who), reason=argument.reason, t_ms=call.now_ms)
    session = replace(session, precedence=given)
    await call.store(keys.composite(keys.SESSION, session.session_id), session)
    return Answer.of(session)


async def record_departure(call: Call, argument: tx.RecordDeparture) -> Answer:
    """RecordDeparture."""
    session = await sessions.require(call, argument.session_id)
    part = access.part_in(call.who, session)
    if session.action not in ENTER or session.state != "completed" or session.end != "done":
        raise refused("NOT_LANDED", f"session {session.session_id[:12]}… brought no drone onto the pad")
    if session.departure is not None:
        raise conflict("DEPARTED", f"session {session.session_id[:12]}… has a departure already")
    left = Departure(by=part, name=access.name_of(call.who), t_ms=call.now_ms, note=argument.note)
    session = replace(session, departure=left)
    await call.store(keys.composite(keys.SESSION, session.session_id), session)
    return Answer.of(session)
