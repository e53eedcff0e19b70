"""The witness: a second pad that time-stamps the same drone, in a transaction of its own (assurance 4).

A policy names it; the drone's request consumes one of its prekeys, so that drone and witness have keys of their own.
It testifies before the pad submits; what it brought is judged with the pad's evidence, in the witness's own frame and
by its own survey.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Final

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Commissioning, Pad, Prekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Party, Session, Testimony, Witness
from wonderland.proofs.testimony import WitnessBrought
from wonderland_chaincode.contract import access, pads
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import ContractError, bad_input, conflict, not_there, refused

WITNESSED: Final = 4
"""Assurance that only a witness gives."""

Commissioned = Callable[[Pad, int], tuple[Commissioning, str]]
TakePrekey = Callable[[Call, str, str, Policy], Awaitable[Prekey]]


async def chosen(
    call: Call, argument: tx.RequestProof, policy: Policy, commissioned: Commissioned, take_prekey: TakePrekey
) -> Witness | None:
    """The witness of a request, whose prekey it consumes; None where the policy names none or the drone brings none.

    Raises ContractError where the policy cannot do without one.
    """
    witness_id = policy.witness_pad_id
    if witness_id is None:
        if argument.witness_prekey_id is not None:
            raise bad_input("NO_WITNESS_NAMED", "witness_prekey_id: the policy of this pad and action names no witness")
        return None
    if witness_id == argument.pad_id:
        raise refused("WITNESS_IS_PAD", f"the policy names pad {witness_id} as its own witness; propose another one")
    if argument.witness_prekey_id is None:
        if policy.min_assurance >= WITNESSED:
            raise refused(
                "WITNESS_PREKEY_MISSING",
                f"this policy demands a witness; name one of pad {witness_id}'s prekeys (ListPrekeys)",
            )
        return None
    pad = await pads.require_in_service(call, witness_id)
    found, digest = commissioned(pad, call.now_ms)
    if found.timestamp_sigma_mm is None:
        raise refused("WITNESS_WITHOUT_CLOCK", f"pad {witness_id}'s nodes share no commissioned clock; it sees nothing")
    prekey = await take_prekey(call, witness_id, argument.witness_prekey_id, policy)
    return Witness(
        pad_id=witness_id,
        prekey_id=prekey.prekey_id,
        pad_key=prekey.public_key,
        party=Party(msp_id=prekey.msp_id, certificate_sha256=prekey.certificate_sha256),
        commissioning_sha256=digest,
    )


async def testify(call: Call, argument: tx.WitnessProof) -> Answer:
    """WitnessProof: once, by the witness that the session names, before the session is decided."""
    session = await call.find_record(keys.composite(keys.SESSION, argument.session_id), Session)
    if session is None:
        raise not_there("SESSION_UNKNOWN", f"there is no session {argument.session_id}")
    witness = session.witness
    if witness is None:
        raise refused("NO_WITNESS_NAMED", f"session {session.session_id[:12]}… names no witness")
    access.require_pad_itself(call.who, witness.pad_id, witness.party.msp_id)
    if session.state != "requested":
        raise ContractError(
            422, f"SESSION_{session.state.upper()}", f"session {session.session_id[:12]}… is {session.state}: too late"
        )
    if call.now_ms >= session.expires_ms:
        raise refused("SESSION_EXPIRED", f"session {session.session_id[:12]}… expired at {session.expires_ms} ms")
    pad = await pads.require_in_service(call, witness.pad_id)
    if pad.commissioning_sha256 != witness.commissioning_sha256:
        raise conflict("COMMISSIONING_CHANGED", f"pad {pad.pad_id} was commissioned anew since the request")
    key = keys.composite(keys.TESTIMONY, session.session_id)
    if await call.stub.get(key) is not None:
        raise conflict("TESTIMONY_EXISTS", f"session {session.session_id[:12]}… has its witness's testimony already")
    testimony = Testimony(
        session_id=session.session_id,
        pad_id=witness.pad_id,
        msp_id=call.who.msp_id,
        certificate_sha256=call.who.certificate_sha256,
        commissioning_sha256=witness.commissioning_sha256,
        radio=argument.radio,
        time_stamps=argument.time_stamps,
        testified_ms=call.now_ms,
    )
    await call.store_new(key, testimony, witness.party.msp_id)
    return Answer.of(testimony)


async def read(call: Call, argument: tx.SessionById) -> Answer:
    """ReadTestimony."""
    testimony = await call.find_record(keys.composite(keys.TESTIMONY, argument.session_id), Testimony)
    if testimony is None:
        raise not_there("TESTIMONY_UNKNOWN", f"session {argument.session_id} has no testimony (yet)")
    return Answer(testimony.to_json())


async def brought(call: Call, session: Session) -> WitnessBrought | None:
    """What the session's witness brought, with the survey that it rests on; None where nothing serves."""
    if session.witness is None:
        return None
    testimony = await call.find_record(keys.composite(keys.TESTIMONY, session.session_id), Testimony)
    if testimony is None:
        return None
    pad = await pads.require(call, session.witness.pad_id)
    if pad.commissioning is None or pad.commissioning_sha256 != session.witness.commissioning_sha256:
        return None
    return WitnessBrought(testimony, pad.commissioning)
