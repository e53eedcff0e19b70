"""Sessions: requested → decided → completed, or cancelled; forward only, each step once.

- RequestProof opens a session (``requested``) and consumes a prekey, and one of the witness's where there is one.
- WitnessProof (``witnesses``) brings what the witness saw; the state stays.
- SubmitProof brings the evidence; the verdict makes it ``decided``.
- CompleteInteraction ends a permitted one (``completed``).
- CancelProof ends one that is not decided, gave no permission, or whose permission expired (``cancelled``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Prekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim, Evidence, LastRequest, Party, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.statement import statement
from wonderland.proofs.transcript import transcript_of
from wonderland.proofs.verdict import decide
from wonderland_chaincode.contract import access, calibrations, closures, pads, policies, uavs, witnesses
from wonderland_chaincode.contract.call import Answer, Call
from wonderland_chaincode.contract.errors import ContractError, bad_input, conflict, not_there, refused
from wonderland_chaincode.contract.signatures import is_point, signature_holds

GRANTED: Final = "granted"


async def require(call: Call, session_id: str) -> Session:
    """The session, or ContractError (404)."""
    session = await call.find_record(keys.composite(keys.SESSION, session_id), Session)
    if session is None:
        raise not_there("SESSION_UNKNOWN", f"there is no session {session_id}; its id is the id of its RequestProof")
    return session


async def request(call: Call, argument: tx.RequestProof) -> Answer:
    """RequestProof: opens a session and consumes a prekey.

    An unauthorised drone may ask: its attempt, and the refusal, shall be on the record.
    """
    who, now_ms = call.who, call.now_ms
    if not is_point(encoding.from_base64url(argument.uav_key)):
        raise bad_input("KEY_NOT_ON_CURVE", "uav_key: no point of P-256")
    uav_id = access.uav_id_of(who)
    await call.read_ahead(
        [
            keys.composite(keys.UAV, uav_id),
            keys.composite(keys.PAD, argument.pad_id),
            *policies.keys_for(argument.pad_id, argument.action),
            keys.composite(keys.PREKEY, argument.pad_id, argument.prekey_id),
        ]
    )
    uav = await uavs.require(call, uav_id)
    access.require_uav_owner(who, uav)
    uavs.require_not_retired(uav)
    pad = await pads.require_in_service(call, argument.pad_id)
    _, digest = pads.commissioned(pad, now_ms)
    policy = await policies.in_force(call, pad.pad_id, argument.action)
    _require_fresh(argument.claim, policy, now_ms)
    await _require_patience(call, pad.pad_id, uav_id, policy)
    prekey = await _consumed_prekey(call, pad.pad_id, argument.prekey_id, policy)
    witness = await witnesses.chosen(call, argument, policy, pads.commissioned, _consumed_prekey)

    session = Session(
        session_id=call.stub.tx_id,
        state="requested",
        pad_id=pad.pad_id,
        uav_id=uav_id,
        action=argument.action,
        claim=argument.claim,
        prekey_id=prekey.prekey_id,
        pad_key=prekey.public_key,
        uav_key=argument.uav_key,
        pad=Party(msp_id=prekey.msp_id, certificate_sha256=prekey.certificate_sha256),
        uav=Party(
            msp_id=who.msp_id,
            certificate_sha256=who.certificate_sha256,
            public_key=encoding.to_base64url(who.public_key),
        ),
        commissioning_sha256=digest,
        contract_version=call.version,
        transcript_sha256="",
        policy=policy,
        requested_ms=now_ms,
        expires_ms=now_ms + policy.session_ttl_ms,
        witness=witness,
        site_plan_sha256=pad.site_plan_sha256,
        node=argument.node,
        calibration=calibrations.in_force(uav, pad, now_ms),
        priority=argument.priority,
        battery_percent=argument.battery_percent,
    )
    transcript = transcript_of(session, call.stub.channel)
    session = replace(session, transcript_sha256=transcript.digest().hex())
    await call.store_new(keys.composite(keys.SESSION, session.session_id), session, session.pad.msp_id)
    return Answer.of(session)


async def submit(call: Call, argument: tx.SubmitProof) -> Answer:
    """SubmitProof: the verdict."""
    # Only a session's own pad may submit: its record is that of the sender.
    await call.read_ahead(
        [
            keys.composite(keys.SESSION, argument.session_id),
            keys.composite(keys.PAD, call.who.pol_id),
            closures.key_of(call.who.pol_id),
        ]
    )
    session = await require(call, argument.session_id)
    access.require_pad_itself(call.who, session.pad_id, session.pad.msp_id)
    _require_state(session, "requested")
    now_ms, skew_ms = call.now_ms, session.policy.max_clock_skew_ms
    if now_ms >= session.expires_ms:
        raise refused("SESSION_EXPIRED", f"session {_short(session)} expired at {session.expires_ms} ms; request anew")
    if now_ms < session.requested_ms - skew_ms:
        # Otherwise a drone with a fast clock, or a dishonest one, could keep its session alive for longer.
        raise refused("CLOCKS_DISAGREE", f"session {_short(session)} was requested in the pad's future; set the clocks")
    pad = await pads.require_in_service(call, session.pad_id)
    commissioning, digest = pads.commissioned(pad, now_ms)
    if digest != session.commissioning_sha256:
        raise conflict(
            "COMMISSIONING_CHANGED", f"pad {pad.pad_id} was commissioned anew since the request; request anew"
        )

    evidence = argument.evidence
    verdict = decide(
        session,
        commissioning,
        evidence,
        confirmed=evidence.matched == "both",
        signature_valid=_countersigned(session, evidence),
        authorisation=(
            *(await uavs.reasons_against(call, session)),
            *(await closures.reasons_against(call, session)),
        ),
        now_ms=now_ms,
        evidence_sha256=encoding.digest(evidence.to_json()).hex(),
        witness=await witnesses.brought(call, session),
    )
    await call.store_new(keys.composite(keys.VERDICT, session.session_id), verdict, session.pad.msp_id)
    await _store(call, replace(session, state="decided", decided_ms=now_ms))
    return Answer.of(verdict)


async def complete(call: Call, argument: tx.CompleteInteraction) -> Answer:
    """CompleteInteraction: how what was permitted ended. It may take longer than the permission to begin it."""
    session = await require(call, argument.session_id)
    part = access.part_in(call.who, session)
    _require_state(session, "decided")
    if not await _permitted(call, session):
        raise refused("NO_PERMISSION", f"session {_short(session)} gave no permission; CancelProof ends it")
    end = replace(session, state="completed", end=argument.result, note=argument.note)
    return await _ended(call, end, part)


async def cancel(call: Call, argument: tx.CancelProof) -> Answer:
    """CancelProof: a timeout, a loss or a refusal ends in a recorded state. A live permission cannot be cancelled."""
    session = await require(call, argument.session_id)
    part = access.part_in(call.who, session)
    if part == "operator" and argument.note is None:
        raise bad_input("REASON_MISSING", "note: a pad's operator who turns a drone away says why")
    if session.state == "decided":
        if call.now_ms < session.expires_ms and await _permitted(call, session):
            raise refused(
                "PERMISSION_STANDS", f"session {_short(session)} gave a permission; CompleteInteraction ends it"
            )
    else:
        _require_state(session, "requested")
    end = replace(session, state="cancelled", end=argument.reason, note=argument.note)
    return await _ended(call, end, part)


async def read(call: Call, argument: tx.SessionById) -> Answer:
    """ReadSession."""
    return Answer((await require(call, argument.session_id)).to_json())


async def read_verdict(call: Call, argument: tx.SessionById) -> Answer:
    """ReadVerdict."""
    session = await call.find_record(keys.composite(keys.SESSION, argument.session_id), Session)
    decided = session is not None and session.decided_ms is not None
    # Only the session is sure to bear the signature of the pad's organisation (decision 0005).
    verdict = await _verdict(call, argument.session_id) if decided else None
    if verdict is None:
        raise not_there("VERDICT_UNKNOWN", f"session {argument.session_id} has no verdict (yet)")
    return Answer(verdict.to_json())


def _require_fresh(claim: Claim, policy: Policy, now_ms: int) -> None:
    if claim.t_ms < now_ms - policy.max_claim_age_ms:
        raise refused(
            "CLAIM_TOO_OLD",
            f"claim.t_ms: {now_ms - claim.t_ms} ms old, allowed are {policy.max_claim_age_ms}; claim a fresh position",
        )
    if claim.t_ms > now_ms + policy.max_clock_skew_ms:
        raise refused("CLAIM_FROM_FUTURE", f"claim.t_ms: {claim.t_ms - now_ms} ms in the future; set the drone's clock")


async def _require_patience(call: Call, pad_id: str, uav_id: str, policy: Policy) -> None:
    """A drone that asks again and again would use up a pad's prekeys; the key makes its parallel requests conflict."""
    if policy.min_request_gap_ms == 0:
        return
    key = keys.composite(keys.LAST_REQUEST, uav_id, pad_id)
    last = await call.find_record(key, LastRequest)
    if last is not None and call.now_ms < last.requested_ms + policy.min_request_gap_ms:
        raise refused(
            "ASKED_TOO_SOON",
            f"drone {uav_id} asked pad {pad_id} {call.now_ms - last.requested_ms} ms ago; this policy wants "
            f"{policy.min_request_gap_ms} ms between two requests",
        )
    await call.store(key, LastRequest(session_id=call.stub.tx_id, requested_ms=call.now_ms))


async def _consumed_prekey(call: Call, pad_id: str, prekey_id: str, policy: Policy) -> Prekey:
    """A prekey that this transaction's session uses up."""
    key = keys.composite(keys.PREKEY, pad_id, prekey_id)
    prekey = await _waiting_prekey(call, key, pad_id, prekey_id)
    if prekey.published_ms > call.now_ms + policy.max_clock_skew_ms:
        raise refused("CLOCKS_DISAGREE", "the request is older than the prekey that it names; set the drone's clock")
    await call.stub.delete(key)
    await call.stub.put(
        keys.composite(keys.USED_PREKEY, pad_id, prekey_id), encoding.encode({"session_id": call.stub.tx_id})
    )
    return prekey


async def _waiting_prekey(call: Call, key: str, pad_id: str, prekey_id: str) -> Prekey:
    prekey = await call.find_record(key, Prekey)
    if prekey is not None:
        return prekey
    if await call.stub.get(keys.composite(keys.USED_PREKEY, pad_id, prekey_id)) is not None:
        raise conflict("PREKEY_USED", f"prekey {prekey_id} of pad {pad_id} was used; take another (ListPrekeys)")
    raise not_there("PREKEY_UNKNOWN", f"pad {pad_id} offers no prekey {prekey_id}; take another (ListPrekeys)")


def _countersigned(session: Session, evidence: Evidence) -> bool | None:
    """Whether the drone's countersignature holds; None where it gave none."""
    if evidence.uav_signature is None or session.uav.public_key is None:
        return None
    message = statement(
        session.session_id, session.transcript_sha256, evidence.ranges, evidence.claims, evidence.attested
    )
    key = encoding.from_base64url(session.uav.public_key)
    return signature_holds(key, message, encoding.from_base64url(evidence.uav_signature))


def _require_state(session: Session, state: str) -> None:
    if session.state != state:
        raise ContractError(
            422,
            f"SESSION_{session.state.upper()}",
            f"session {_short(session)} is {session.state}; this needs one that is {state}",
        )


async def _verdict(call: Call, session_id: str) -> Verdict | None:
    return await call.find_record(keys.composite(keys.VERDICT, session_id), Verdict)


async def _permitted(call: Call, session: Session) -> bool:
    verdict = await _verdict(call, session.session_id)
    return verdict is not None and verdict.permission == GRANTED


async def _ended(call: Call, session: Session, part: str) -> Answer:
    session = replace(session, ended_by=part, ended_ms=call.now_ms)
    await _store(call, session)
    return Answer.of(session)


async def _store(call: Call, session: Session) -> None:
    await call.store(keys.composite(keys.SESSION, session.session_id), session)


def _short(session: Session) -> str:
    return f"{session.session_id[:12]}…"
