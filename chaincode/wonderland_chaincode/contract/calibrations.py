"""Calibrations of drones: what a drone's own node adds to every range, measured and signed by the pad's side.

Who flies a drone does not register it: neither its organisation nor, at its own pads, its operator. It rests on
sessions that the ledger has (the drone's own, under the pad's present commissioning) and holds at that pad only, whose
operator could bend every anchor's bias table anyway. What a false one is worth in a verdict: ``proofs.uncorrected``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.calibrations import MAX_CALIBRATIONS, Calibration, DroneOffset
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.uavs import Uav
from wonderland.proofs.records.verdicts import Verdict
from wonderland_chaincode.contract import access, pads, uavs
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import bad_input, conflict, not_allowed, not_there, refused

MIN_ROUNDS: Final = 30
"""Fewer tell an offset no better than a single place's reflections."""
LEAST_ASSURANCE: Final = 1
"""Ranges that the drone measured itself, or that nothing ties to it, are its own word."""
DAY_MS: Final = 86_400_000
MAX_AGE_MS: Final = 30 * DAY_MS
MAX_VALID_MS: Final = 366 * DAY_MS


async def register(call: Call, argument: tx.CalibrateUav) -> Answer:
    """CalibrateUav."""
    ids = [each.session_id for each in argument.sessions]
    if len(set(ids)) != len(ids):
        raise bad_input("SESSION_TWICE", "sessions: one is named twice")
    uav = await uavs.require(call, argument.uav_id)
    uavs.require_not_retired(uav)
    pad = await pads.require_in_service(call, argument.pad_id)
    _require_stranger(call, uav, pad)
    _, digest = pads.commissioned(pad, call.now_ms)
    rounds, first_ms, last_ms = await _ranged(call, argument, digest)
    if rounds < MIN_ROUNDS:
        raise refused(
            "CALIBRATION_TOO_SHORT", f"sessions: {rounds} usable rounds together, {MIN_ROUNDS} are needed; range longer"
        )
    if first_ms < call.now_ms - MAX_AGE_MS:
        raise refused("CALIBRATION_TOO_OLD", "sessions: one is more than 30 days old; range the drone again")
    if not call.now_ms < argument.valid_until_ms <= last_ms + MAX_VALID_MS:
        raise refused(
            "CALIBRATION_NOT_VALID", "valid_until_ms: must be in the future, and at most 366 days after the ranging"
        )
    before = _of_pad(uav, argument.pad_id)
    if before is not None and last_ms <= before.measured_ms:
        raise conflict(
            "CALIBRATION_NOT_NEWER",
            f"drone {uav.uav_id} has a calibration of {before.measured_ms} at pad {pad.pad_id}; an older one, or the "
            "same again, replaces nothing; range it again",
        )
    calibration = Calibration(
        pad_id=pad.pad_id,
        commissioning_sha256=digest,
        offset_mm=argument.offset_mm,
        sigma_mm=argument.sigma_mm,
        sessions=len(ids),
        rounds=rounds,
        measured_ms=last_ms,
        valid_until_ms=argument.valid_until_ms,
        registered_ms=call.now_ms,
        registered_by=access.name_of(call.who),
        msp_id=call.who.msp_id,
        node=argument.node,
    )
    return await _kept(call, uav, calibration)


async def withdraw(call: Call, argument: tx.WithdrawCalibration) -> Answer:
    """WithdrawCalibration: the authority, the pad's operator, or the drone's, who knows what was changed on it.

    It stays in the record, so that the same measurement cannot be registered again.
    """
    uav = await uavs.require(call, argument.uav_id)
    if not access.is_authority(call.who) and call.who.msp_id != uav.msp_id:
        access.require_pad_owner(call.who, await pads.require(call, argument.pad_id))
    calibration = _of_pad(uav, argument.pad_id)
    if calibration is None or calibration.withdrawn is not None:
        raise not_there(
            "CALIBRATION_UNKNOWN", f"drone {argument.uav_id} has no calibration at pad {argument.pad_id} to withdraw"
        )
    return await _kept(call, uav, replace(calibration, withdrawn=argument.reason))


def in_force(uav: Uav, pad: Pad, now_ms: int) -> DroneOffset | None:
    """What a session that is requested now at this pad is judged with; None: what is known of nodes in general."""
    found = _of_pad(uav, pad.pad_id)
    if found is None or not _holds(found, pad.commissioning_sha256, now_ms):
        return None
    return DroneOffset(offset_mm=found.offset_mm, sigma_mm=found.sigma_mm, measured_ms=found.measured_ms)


def _holds(calibration: Calibration, commissioning_sha256: str | None, now_ms: int) -> bool:
    return (
        calibration.withdrawn is None
        and calibration.commissioning_sha256 == commissioning_sha256
        and now_ms < calibration.valid_until_ms
    )


def _of_pad(uav: Uav, pad_id: str) -> Calibration | None:
    return next((each for each in uav.calibrations or () if each.pad_id == pad_id), None)


def _require_stranger(call: Call, uav: Uav, pad: Pad) -> None:
    """The pad's organisation or the authority, and nobody who flies the drone. Raises ContractError (403)."""
    who = call.who
    if not access.is_authority(who):
        access.require_pad_owner(who, pad)
    own_operator = pad.operator_id == uav.operator_id and not access.is_authority(who)
    if who.msp_id == uav.msp_id or own_operator:
        raise not_allowed(
            "CALIBRATED_BY_OWNER",
            f"drone {uav.uav_id} is flown by {uav.operator_id} of {uav.msp_id}, which may not calibrate it itself; "
            "have another pad's operator, or an inspector of the authority, do it",
        )


async def _ranged(call: Call, argument: tx.CalibrateUav, digest: str) -> tuple[int, int, int]:
    """Usable rounds of the sessions named, and when the first and the last was decided. Raises ContractError."""
    wanted = [
        keys.composite(kind, each.session_id) for each in argument.sessions for kind in (keys.SESSION, keys.VERDICT)
    ]
    await call.read_ahead(wanted)
    rounds = 0
    times = []
    for each in argument.sessions:
        name = f"session {each.session_id[:12]}…"
        session = await call.find_record(keys.composite(keys.SESSION, each.session_id), Session)
        if session is None:
            raise not_there("SESSION_UNKNOWN", f"there is no {name}; its id is the id of its RequestProof")
        if (session.uav_id, session.pad_id) != (argument.uav_id, argument.pad_id):
            raise refused(
                "CALIBRATION_OF_ANOTHER", f"{name} was of drone {session.uav_id} at pad {session.pad_id}, not of these"
            )
        if session.commissioning_sha256 != digest:
            raise refused(
                "CALIBRATION_OUTDATED", f"pad {argument.pad_id} was commissioned anew since {name}; range again"
            )
        verdict = await call.find_record(keys.composite(keys.VERDICT, each.session_id), Verdict)
        if verdict is None or session.decided_ms is None or verdict.assurance < LEAST_ASSURANCE:
            raise refused(
                "CALIBRATION_UNMEASURED", f"{name} has no ranges that the pad measured and that are tied to the drone"
            )
        rounds += verdict.rounds
        times.append(session.decided_ms)
    return rounds, min(times), max(times)


async def _kept(call: Call, uav: Uav, calibration: Calibration) -> Answer:
    """The drone with this calibration in place of the pad's last one. Those that are over make room for others."""
    others = [each for each in uav.calibrations or () if each.pad_id != calibration.pad_id]
    if len(others) >= MAX_CALIBRATIONS:
        others = [each for each in others if each.withdrawn is None and each.valid_until_ms > call.now_ms]
    if len(others) >= MAX_CALIBRATIONS:
        raise refused(
            "TOO_MANY_CALIBRATIONS",
            f"drone {uav.uav_id} is calibrated at {len(others)} pads; withdraw one that it no longer visits",
        )
    kept = tuple(sorted((*others, calibration), key=lambda each: each.pad_id))
    changed = replace(uav, calibrations=kept, updated_ms=call.now_ms)
    await call.store(keys.composite(keys.UAV, uav.uav_id), changed)
    return Answer.of(changed)
