"""Drones: registration, status, maintenance, authorisations, and why one may not do what it asks."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs.reasons import reason
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import Reinstatement
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.uavs import Authorisation, Maintenance, Uav
from wonderland.proofs.records.verdicts import Reason
from wonderland_chaincode.contract import access, pads
from wonderland_chaincode.contract.call import Answer, Call, stored
from wonderland_chaincode.contract.errors import bad_input, conflict, not_allowed, not_there, refused

ACTIVE, SUSPENDED, RETIRED = "active", "suspended", "retired"
MAX_AUTHORISATIONS: Final = 256
"""Of one drone at a time: what a verdict may have to look through. Ended ones make room; history keeps them."""
MAX_SKEW_MS: Final = 5_000
"""How far the clocks of two honest clients may differ where no policy says so."""


async def require(call: Call, uav_id: str) -> Uav:
    """The drone, or ContractError (404)."""
    uav = await call.find_record(keys.composite(keys.UAV, uav_id), Uav)
    if uav is None:
        raise not_there("UAV_UNKNOWN", f"there is no drone {uav_id}; RegisterUav makes one known")
    return uav


def require_not_retired(uav: Uav) -> None:
    """Retirement is final: ContractError (422)."""
    if uav.status == RETIRED:
        raise refused("UAV_RETIRED", f"drone {uav.uav_id} is retired for good; register it under another identifier")


async def register(call: Call, argument: tx.RegisterUav) -> Answer:
    """RegisterUav."""
    key = keys.composite(keys.UAV, argument.uav_id)
    if await call.stub.get(key) is not None:
        raise conflict("UAV_EXISTS", f"drone {argument.uav_id} is registered already")
    uav = Uav(
        uav_id=argument.uav_id,
        operator_id=argument.operator_id,
        msp_id=call.who.msp_id,
        registration_commitment=argument.registration_commitment,
        model=argument.model,
        status=ACTIVE,
        registered_ms=call.now_ms,
        updated_ms=call.now_ms,
    )
    await call.store(key, uav)
    return Answer.of(uav)


async def set_status(call: Call, argument: tx.SetUavStatus) -> Answer:
    """SetUavStatus: the authority suspends and retires; an operator may retire its own drone."""
    uav = await require(call, argument.uav_id)
    access.require_uav_owner(call.who, uav)
    if not access.is_authority(call.who) and argument.status != RETIRED:
        raise not_allowed(
            "OPERATOR_MAY_ONLY_RETIRE", "a fleet operator may retire its drone; suspensions are the authority's"
        )
    require_not_retired(uav)
    if argument.status == ACTIVE:
        raise not_allowed(
            "TWO_PEOPLE_NEEDED",
            "a suspension is lifted by two people: one sends ProposeReinstatement, another one ApproveChange",
        )
    return await _changed(call, replace(uav, status=argument.status, status_reason=argument.reason))


async def reinstate(call: Call, wanted: Reinstatement) -> None:
    """Lift a suspension. Raises ContractError where there is none."""
    uav = await require_suspended(call, wanted.uav_id)
    await _changed(call, replace(uav, status=ACTIVE, status_reason=wanted.reason))


async def require_suspended(call: Call, uav_id: str) -> Uav:
    """The drone, which is suspended; else ContractError (404, 422)."""
    uav = await require(call, uav_id)
    require_not_retired(uav)
    if uav.status != SUSPENDED:
        raise refused("UAV_NOT_SUSPENDED", f"drone {uav_id} is {uav.status}; there is no suspension to lift")
    return uav


async def record_maintenance(call: Call, argument: tx.RecordMaintenance) -> Answer:
    """RecordMaintenance."""
    if argument.valid_until_ms <= argument.performed_ms:
        raise bad_input("MAINTENANCE_NEVER_VALID", "valid_until_ms: must be after performed_ms")
    uav = await require(call, argument.uav_id)
    access.require_uav_owner(call.who, uav)
    require_not_retired(uav)
    if argument.performed_ms > call.now_ms + MAX_SKEW_MS:
        raise refused("MAINTENANCE_IN_FUTURE", "performed_ms: lies in the future; record maintenance once it is done")
    maintenance = Maintenance(
        performed_ms=argument.performed_ms,
        valid_until_ms=argument.valid_until_ms,
        work=argument.work,
        recorded_by=access.name_of(call.who),
    )
    return await _changed(call, replace(uav, maintenance=maintenance))


async def grant(call: Call, argument: tx.GrantAuthorisation) -> Answer:
    """GrantAuthorisation."""
    if len(set(argument.actions)) != len(argument.actions):
        raise bad_input("ACTION_TWICE", "actions: one is named twice")
    require_not_retired(await require(call, argument.uav_id))
    if argument.pad_id != "*":
        await pads.require_in_service(call, argument.pad_id)
    if argument.valid_until_ms <= call.now_ms:
        raise refused("AUTHORISATION_OVER", "valid_until_ms: this authorisation would be over already")
    key = _authorisation_key(argument.uav_id, argument.authorisation_id)
    if await call.stub.get(key) is not None:
        raise conflict(
            "AUTHORISATION_EXISTS",
            f"drone {argument.uav_id} has an authorisation {argument.authorisation_id} already; choose another id",
        )
    await _make_room(call, argument.uav_id)
    authorisation = Authorisation(
        authorisation_id=argument.authorisation_id,
        uav_id=argument.uav_id,
        pad_id=argument.pad_id,
        actions=argument.actions,
        valid_from_ms=argument.valid_from_ms,
        valid_until_ms=argument.valid_until_ms,
        granted_by=access.name_of(call.who),
        granted_ms=call.now_ms,
        revoked=False,
    )
    await call.store(key, authorisation)
    return Answer.of(authorisation)


async def revoke(call: Call, argument: tx.RevokeAuthorisation) -> Answer:
    """RevokeAuthorisation."""
    key = _authorisation_key(argument.uav_id, argument.authorisation_id)
    authorisation = await call.find_record(key, Authorisation)
    if authorisation is None:
        raise not_there(
            "AUTHORISATION_UNKNOWN", f"drone {argument.uav_id} has no authorisation {argument.authorisation_id}"
        )
    if authorisation.revoked:
        raise refused("AUTHORISATION_REVOKED", f"authorisation {argument.authorisation_id} is revoked already")
    authorisation = replace(authorisation, revoked=True, revoked_reason=argument.reason, revoked_ms=call.now_ms)
    await call.store(key, authorisation)
    return Answer.of(authorisation)


async def read(call: Call, argument: tx.UavById) -> Answer:
    """ReadUav."""
    return Answer((await require(call, argument.uav_id)).to_json())


async def reasons_against(call: Call, session: Session) -> tuple[Reason, ...]:
    """Why the session's drone may not do what it asked, now; empty where it may."""
    uav = await require(call, session.uav_id)
    policy = session.policy
    return (
        *_status_reasons(uav),
        *_maintenance_reasons(uav, policy, call.now_ms),
        *(await _authorisation_reasons(call, session) if policy.require_authorisation else ()),
    )


def _status_reasons(uav: Uav) -> tuple[Reason, ...]:
    if uav.status == ACTIVE:
        return ()
    return (reason(f"uav_{uav.status}"),)


def _maintenance_reasons(uav: Uav, policy: Policy, now_ms: int) -> tuple[Reason, ...]:
    if not policy.require_maintenance:
        return ()
    if uav.maintenance is None:
        return (reason("maintenance_missing"),)
    if now_ms >= uav.maintenance.valid_until_ms:
        return (reason("maintenance_lapsed", until_ms=uav.maintenance.valid_until_ms),)
    return ()


async def _authorisation_reasons(call: Call, session: Session) -> tuple[Reason, ...]:
    start, end = keys.prefix_range(keys.AUTHORISATION, session.uav_id)
    async for _, data in call.stub.range(start, end):
        authorisation = stored(data, Authorisation)
        if (
            not authorisation.revoked
            and authorisation.pad_id in {"*", session.pad_id}
            and session.action in authorisation.actions
            and authorisation.valid_from_ms <= call.now_ms < authorisation.valid_until_ms
        ):
            return ()
    return (reason("not_authorised", action=session.action, pad_id=session.pad_id),)


async def _make_room(call: Call, uav_id: str) -> None:
    """Keep one drone's authorisations countable: beyond the limit those that have ended leave the state."""
    count = 0
    ended = []
    start, end = keys.prefix_range(keys.AUTHORISATION, uav_id)
    async for key, data in call.stub.range(start, end):
        count += 1
        authorisation = stored(data, Authorisation)
        if authorisation.revoked or authorisation.valid_until_ms <= call.now_ms:
            ended.append(key)
    if count < MAX_AUTHORISATIONS:
        return
    if not ended:
        raise refused(
            "TOO_MANY_AUTHORISATIONS", f"drone {uav_id} has {count} authorisations in force; revoke some or use *"
        )
    for key in ended:
        await call.stub.delete(key)


async def _changed(call: Call, uav: Uav) -> Answer:
    uav = replace(uav, updated_ms=call.now_ms)
    await call.store(keys.composite(keys.UAV, uav.uav_id), uav)
    return Answer.of(uav)


def _authorisation_key(uav_id: str, authorisation_id: str) -> str:
    return keys.composite(keys.AUTHORISATION, uav_id, authorisation_id)
