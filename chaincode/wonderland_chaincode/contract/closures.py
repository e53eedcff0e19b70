"""Closures: an authority publishes when zones forbid what at a pad; a permission asks here first.

Zones, their shapes, schedules and daylight stay off the ledger; here is only what follows from them for one pad.
"""

from __future__ import annotations

from typing import Final

from wonderland.proofs.reasons import reason
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.closures import Closures
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Reason
from wonderland_chaincode.contract import access, pads
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import not_there, refused

MAX_NAMED: Final = 8
"""A verdict names no more zones than this: it has room for so many reasons, and one is enough."""


def key_of(pad_id: str) -> str:
    """Where the closures of a pad stand."""
    return keys.composite(keys.CLOSURES, pad_id)


async def set_closures(call: Call, argument: tx.SetClosures) -> Answer:
    """SetClosures. They replace those before, and hold for sessions that are decided from now on."""
    await pads.require_in_service(call, argument.pad_id)
    if argument.valid_until_ms <= call.now_ms:
        raise refused(
            "CLOSURES_OUTDATED", "valid_until_ms has passed, so that nothing would be permitted; work them out anew"
        )
    await call.stub.get(key_of(argument.pad_id))  # so that of two who set them on the same ground one is refused (MVCC)
    closures = Closures(
        pad_id=argument.pad_id,
        closures=argument.closures,
        valid_until_ms=argument.valid_until_ms,
        set_by=access.name_of(call.who),
        set_ms=call.now_ms,
    )
    await call.store(key_of(argument.pad_id), closures)
    return Answer.of(closures)


async def read(call: Call, argument: tx.PadById) -> Answer:
    """ReadClosures."""
    closures = await call.find_record(key_of(argument.pad_id), Closures)
    if closures is None:
        raise not_there("CLOSURES_UNKNOWN", f"no closures were ever set for pad {argument.pad_id}; no zone closes it")
    return Answer(closures.to_json())


async def reasons_against(call: Call, session: Session) -> tuple[Reason, ...]:
    """Which zones forbid what the session asks for, now or before a permission would expire.

    None at a pad that never had closures.
    """
    closures = await call.find_record(key_of(session.pad_id), Closures)
    if closures is None:
        return ()
    if session.expires_ms > closures.valid_until_ms:
        return (reason("closures_outdated", pad_id=session.pad_id, until_ms=closures.valid_until_ms),)
    span = call.now_ms, session.expires_ms
    zones = sorted({each.zone_id for each in closures.closures if each.forbids(session.action, *span)})
    return tuple(
        reason("zone_active", zone_id=zone_id, action=session.action, pad_id=session.pad_id)
        for zone_id in zones[:MAX_NAMED]
    )
