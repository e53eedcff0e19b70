"""Four eyes: a policy, and the lifting of a suspension, are proposed by one person and approved by another.

What makes two people of two signatures is all that a contract can see of them: certificates with different names, that
certify different keys. Who enrols people must see to it that nobody gets two (decision 0031).
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import (
    APPROVED,
    LIFE_MS,
    OPEN,
    WITHDRAWN,
    PolicyChange,
    ProposedChange,
    Reinstatement,
    Signatory,
)
from wonderland_chaincode.contract import access, policies, uavs
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import conflict, not_allowed, not_there, refused


async def propose_policy(call: Call, argument: tx.ProposePolicy) -> Answer:
    """ProposePolicy. Approved, it holds for sessions requested from then on; a session keeps that of its request."""
    wanted = PolicyChange(pad_id=argument.pad_id, action=argument.action, policy=argument.policy)
    await policies.require_possible(call, wanted)
    return await _propose(call, policy=wanted, note=argument.note)


async def propose_reinstatement(call: Call, argument: tx.ProposeReinstatement) -> Answer:
    """ProposeReinstatement."""
    await uavs.require_suspended(call, argument.uav_id)
    return await _propose(call, reinstatement=Reinstatement(uav_id=argument.uav_id, reason=argument.reason))


async def approve(call: Call, argument: tx.ApproveChange) -> Answer:
    """ApproveChange: by somebody else, in time, of what was proposed, on what it was proposed on."""
    change = await _open(call, argument.change_id)
    approved_by = _signatory(call)
    proposed_by = change.proposed_by
    if (approved_by.msp_id, approved_by.name) == (proposed_by.msp_id, proposed_by.name):
        raise not_allowed(
            "SAME_PERSON",
            f"{proposed_by.name!r} of {proposed_by.msp_id} proposed this; another person has to approve it",
        )
    if approved_by.key_sha256 == proposed_by.key_sha256:
        raise not_allowed(
            "SAME_KEY",
            f"the key that approves is the one that {proposed_by.name!r} proposed with; use a key of one's own",
        )
    if call.now_ms >= change.expires_ms:
        raise refused("CHANGE_EXPIRED", "the time to approve this is over; propose it again")
    if (argument.policy, argument.reinstatement) != (change.policy, change.reinstatement):
        raise conflict("CHANGE_NOT_AS_PROPOSED", "what is approved is not what was proposed; read the proposal again")
    if await _digest_at(call, _key_of(change)) != change.replaces_sha256:
        raise conflict(
            "CHANGE_OVERTAKEN", "what this would change is no longer as it was when it was proposed; propose it again"
        )
    if change.policy is not None:
        await policies.require_possible(call, change.policy)
        await call.store(_key_of(change), change.policy.policy)
    if change.reinstatement is not None:
        await uavs.reinstate(call, change.reinstatement)
    return await _write(call, replace(change, state=APPROVED, decided_by=approved_by, decided_ms=call.now_ms))


async def withdraw(call: Call, argument: tx.WithdrawChange) -> Answer:
    """WithdrawChange: by its proposer, or by somebody else who turns it down."""
    change = await _open(call, argument.change_id)
    by, now_ms = _signatory(call), call.now_ms
    return await _write(
        call, replace(change, state=WITHDRAWN, decided_by=by, decided_ms=now_ms, decided_note=argument.reason)
    )


async def read(call: Call, argument: tx.ChangeById) -> Answer:
    """ReadChange."""
    return Answer((await _require(call, argument.change_id)).to_json())


async def _propose(
    call: Call,
    *,
    policy: PolicyChange | None = None,
    reinstatement: Reinstatement | None = None,
    note: str | None = None,
) -> Answer:
    change = ProposedChange(
        change_id=call.stub.tx_id,
        policy=policy,
        reinstatement=reinstatement,
        proposed_by=_signatory(call),
        proposed_ms=call.now_ms,
        expires_ms=call.now_ms + LIFE_MS,
        note=note,
        state=OPEN,
    )
    return await _write(call, replace(change, replaces_sha256=await _digest_at(call, _key_of(change))))


async def _require(call: Call, change_id: str) -> ProposedChange:
    change = await call.find_record(keys.composite(keys.CHANGE, change_id), ProposedChange)
    if change is None:
        raise not_there("CHANGE_UNKNOWN", f"nobody has proposed a change {change_id[:12]}…")
    return change


async def _open(call: Call, change_id: str) -> ProposedChange:
    change = await _require(call, change_id)
    if change.state != OPEN:
        raise refused("CHANGE_DECIDED", f"this change was {change.state} already; propose another one")
    return change


async def _write(call: Call, change: ProposedChange) -> Answer:
    await call.store(keys.composite(keys.CHANGE, change.change_id), change)
    return Answer.of(change)


async def _digest_at(call: Call, key: str) -> str | None:
    """What stands under a key. The ledger takes the transaction only while that is the newest (MVCC)."""
    data = await call.stub.get(key)
    return None if data is None else hashlib.sha256(data).hexdigest()


def _key_of(change: ProposedChange) -> str:
    """The record that it is about."""
    if change.policy is not None:
        return keys.composite(keys.POLICY, change.policy.pad_id, change.policy.action)
    assert change.reinstatement is not None
    return keys.composite(keys.UAV, change.reinstatement.uav_id)


def _signatory(call: Call) -> Signatory:
    return Signatory(
        name=access.name_of(call.who),
        msp_id=call.who.msp_id,
        certificate_sha256=call.who.certificate_sha256,
        key_sha256=hashlib.sha256(call.who.public_key).hexdigest(),
    )
