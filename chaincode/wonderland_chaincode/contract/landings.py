"""Landings without a permission: a drone's own word, in a transaction that it signed. No record changes."""

from __future__ import annotations

from typing import Final

from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.landings import Landing
from wonderland_chaincode.contract import access, pads, uavs
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import refused

MAX_AGE_MS: Final = 86_400_000
"""A drone that had no network meanwhile reports later."""
AHEAD_MS: Final = 60_000


async def report(call: Call, argument: tx.ReportLanding) -> Answer:
    """ReportLanding."""
    uav = await uavs.require(call, access.uav_id_of(call.who))
    access.require_uav_owner(call.who, uav)
    pad = await pads.require(call, argument.pad_id)
    if not call.now_ms - MAX_AGE_MS <= argument.claim.t_ms <= call.now_ms + AHEAD_MS:
        raise refused(
            "LANDING_TIME", "claim.t_ms: a landing is reported within a day, and by a clock that is not ahead; set it"
        )
    landing = Landing(
        uav_id=uav.uav_id,
        pad_id=pad.pad_id,
        cause=argument.cause,
        claim=argument.claim,
        reported_ms=call.now_ms,
    )
    return Answer(landing.to_json(), event=landing.to_json())
