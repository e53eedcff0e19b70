"""Reservations: a pad kept for a drone's landing. Whom that keeps waiting follows from them (``proofs.queue``).

A transaction's time is its sender's word. So nothing of another organisation's is dropped because its time is over.
"""

from __future__ import annotations

from typing import Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.reservations import AHEAD_MS, EACH, MAX_RESERVATIONS, Reservation, Reservations
from wonderland_chaincode.contract import access, pads, policies, uavs
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import conflict, not_allowed, not_there, refused

LANDING: Final = "land"


async def reserve(call: Call, argument: tx.ReservePad) -> Answer:
    """ReservePad."""
    await pads.require_in_service(call, argument.pad_id)
    uav = await uavs.require(call, argument.uav_id)
    if call.who.role == tx.UAV and call.who.pol_id != uav.uav_id:
        raise not_allowed("NOT_THIS_UAV", f"drone {call.who.pol_id!r} reserves for itself, not for {uav.uav_id}")
    access.require_uav_owner(call.who, uav)
    if uav.status != uavs.ACTIVE:
        raise refused("UAV_NOT_ACTIVE", f"drone {uav.uav_id} is {uav.status}; no pad is kept for it")
    longest_ms = (await policies.in_force(call, argument.pad_id, LANDING)).reservation_ms
    if longest_ms is None:
        raise refused("NO_RESERVATIONS", f"pad {argument.pad_id} takes no reservations; ask for the proof on arrival")
    if argument.until_ms - argument.from_ms > longest_ms:
        raise refused("RESERVATION_TOO_LONG", f"pad {argument.pad_id} is kept for {longest_ms // 60_000} min at most")
    if argument.until_ms <= call.now_ms or argument.from_ms > call.now_ms + AHEAD_MS:
        raise refused("RESERVATION_NOT_SOON", "a reservation ends in the future and begins within seven days")
    kept = await _of(call, argument.pad_id)
    taken = next((each for each in kept if each.overlaps(argument.from_ms, argument.until_ms)), None)
    if taken is not None:
        raise conflict("PAD_RESERVED", f"pad {argument.pad_id} is kept for {taken.uav_id} at that time")
    own = [each for each in kept if each.msp_id == uav.msp_id]
    over = next((each for each in own if each.until_ms <= call.now_ms), None)
    if over is not None:
        kept.remove(over)
    elif len(own) >= EACH:
        raise refused("TOO_MANY_RESERVATIONS", f"{uav.msp_id} has {EACH} at pad {argument.pad_id}; cancel one first")
    if len(kept) >= MAX_RESERVATIONS:
        raise refused("TOO_MANY_RESERVATIONS", f"pad {argument.pad_id} has {MAX_RESERVATIONS}; have old ones cancelled")
    made = Reservation(
        reservation_id=call.stub.tx_id,
        uav_id=uav.uav_id,
        msp_id=uav.msp_id,
        from_ms=argument.from_ms,
        until_ms=argument.until_ms,
        reserved_by=access.name_of(call.who),
        reserved_ms=call.now_ms,
    )
    return await _store(call, argument.pad_id, [*kept, made])


async def cancel(call: Call, argument: tx.CancelReservation) -> Answer:
    """CancelReservation."""
    kept = await _of(call, argument.pad_id)
    its = next((each for each in kept if each.reservation_id == argument.reservation_id), None)
    if its is None:
        raise not_there("RESERVATION_UNKNOWN", f"pad {argument.pad_id} has no such reservation")
    if call.who.role == tx.PAD_OPERATOR:
        access.require_pad_owner(call.who, await pads.require(call, argument.pad_id))
    elif call.who.role == tx.UAV and call.who.pol_id != its.uav_id:
        raise not_allowed("NOT_THIS_UAV", f"the reservation is {its.uav_id}'s, not {call.who.pol_id!r}'s")
    else:
        access.require_uav_owner(call.who, await uavs.require(call, its.uav_id))
    return await _store(call, argument.pad_id, [each for each in kept if each is not its])


async def read(call: Call, argument: tx.PadById) -> Answer:
    """ReadReservations."""
    await pads.require(call, argument.pad_id)
    return Answer(Reservations(pad_id=argument.pad_id, reservations=tuple(await _of(call, argument.pad_id))).to_json())


async def _of(call: Call, pad_id: str) -> list[Reservation]:
    found = await call.find_record(keys.composite(keys.RESERVATIONS, pad_id), Reservations)
    return [] if found is None else list(found.reservations)


async def _store(call: Call, pad_id: str, reservations: list[Reservation]) -> Answer:
    kept = Reservations(pad_id=pad_id, reservations=tuple(sorted(reservations, key=lambda each: each.from_ms)))
    await call.store(keys.composite(keys.RESERVATIONS, pad_id), kept)
    return Answer.of(kept)
