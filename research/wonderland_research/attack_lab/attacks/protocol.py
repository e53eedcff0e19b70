"""Attacks on the protocol: on what was said before, on whose word counts, on the records.

The contract itself answers, on a ledger in memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.sessions import Evidence, Radio, RangeTable, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.link.cipher import LinkKeys
from wonderland.uwb.link.link import Link, MessageReceived
from wonderland.uwb.link.messages import MessageType
from wonderland.uwb.link.segments import MAX_FRAME_OCTETS
from wonderland_chaincode.contract.errors import ContractError
from wonderland_research.attack_lab.attacks.common import ALL
from wonderland_research.attack_lab.judge import Tally
from wonderland_research.attack_lab.memory_ledger import (
    ADMIN,
    FLEET_OPERATOR,
    INSPECTOR,
    OTHER_PAD,
    OTHER_UAV,
    PAD,
    PAD_ID,
    PAD_OPERATOR,
    PEOPLE,
    PLACE_MM,
    UAV,
    UAV_ID,
    MemoryLedger,
    Person,
    Place,
)
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import POLICY

Try = Callable[[MemoryLedger, str], bool | Verdict]
"""One try with a name of its own: whether it won, or the verdict that it led to."""
SESSIONS_AT_ONCE: Final = 5
FRAMES: Final = 6


def played(one: Try, rng: np.random.Generator, count: int) -> Tally:
    """So many tries under the default policy."""
    return played_at(one, POLICY.min_assurance, rng, count)


def played_at(one: Try, level: int, rng: np.random.Generator, count: int) -> Tally:
    """So many tries on one ledger; a refusal of the contract is an answer as good as a verdict."""
    tally = Tally(tries=count)
    ledger = MemoryLedger(rng, policy=replace(POLICY, min_assurance=level))
    for number in range(count):
        try:
            answer = one(ledger, f"t{number}")
        except ContractError as refusal:
            tally.refused += 1
            tally.reasons[refusal.code] = tally.reasons.get(refusal.code, 0) + 1
            continue
        finally:
            ledger.now_ms += 1_000
        if isinstance(answer, bool):
            tally.won += answer
            tally.granted += answer
            tally.open += not answer
            continue
        tally.decisions += 1
        won = answer.permission == "granted"
        tally.won += won
        tally.granted += won
        tally.refuted += answer.outcome == "refuted"
        tally.open += answer.outcome == "inconclusive"
        tally.refused += answer.outcome == "verified" and not won
        for reason in answer.reasons:
            tally.reasons[reason.code] = tally.reasons.get(reason.code, 0) + 1
    return tally


def _elsewhere(ledger: MemoryLedger) -> Place:
    """3 to 9 m from the claim."""
    angle, size = ledger.rng.uniform(0.0, 2.0 * np.pi), ledger.rng.uniform(3_000.0, 9_000.0)
    return round(PLACE_MM[0] + size * np.cos(angle)), round(PLACE_MM[1] + size * np.sin(angle)), PLACE_MM[2]


def _requested(ledger: MemoryLedger, name: str, *, who: Person = UAV) -> Session:
    ledger.publish(name)
    return ledger.request(name, who=who)


def old_evidence(ledger: MemoryLedger, name: str) -> Verdict:
    """Evidence of an honest session, brought again for a new one: as it was, or with its times made fresh."""
    first = _requested(ledger, f"{name}a")
    good = ledger.evidence(first)
    if ledger.submit(first.session_id, good).permission != "granted":
        raise AssertionError("the honest session that is to be replayed was not granted")
    second = _requested(ledger, f"{name}b")
    if ledger.rng.random() < 0.5:
        good = _moved_in_time(good, second.requested_ms - first.requested_ms)
    ledger.now_ms += 1_000
    return ledger.submit(second.session_id, good)


def _moved_in_time(evidence: Evidence, by_ms: int) -> Evidence:
    table = RangeTable(t_ms=tuple(t_ms + by_ms for t_ms in evidence.ranges.t_ms), anchors=evidence.ranges.anchors)
    claims = tuple(replace(claim, t_ms=claim.t_ms + by_ms) for claim in evidence.claims)
    return replace(evidence, ranges=table, claims=claims)


def used_prekey(ledger: MemoryLedger, name: str) -> bool:
    """A prekey that a session consumed: asked for again, published again, or another pad's."""
    _requested(ledger, name)
    way = int(ledger.rng.integers(0, 3))
    if way == 0:
        ledger.request(name)
    elif way == 1:
        ledger.publish(name)
    else:
        ledger.publish(f"{name}o", who=OTHER_PAD)
        ledger.request(f"{name}o")
    return True


def many_sessions(ledger: MemoryLedger, name: str) -> Verdict:
    """Several sessions at once; what was measured for the first one is brought for another."""
    sessions = [_requested(ledger, f"{name}{number}") for number in range(SESSIONS_AT_ONCE)]
    measured = ledger.evidence(sessions[0])
    other = sessions[int(ledger.rng.integers(1, SESSIONS_AT_ONCE))]
    return ledger.submit(other.session_id, measured)


def invented_by_pad(ledger: MemoryLedger, name: str) -> Verdict:
    """The pad's organisation alone: ranges that fit, and a countersignature that it does not have."""
    session = _requested(ledger, name)
    way = int(ledger.rng.integers(0, 3))
    evidence = ledger.evidence(session, signer=(None, PAD, OTHER_UAV)[way])
    return ledger.submit(session.session_id, evidence)


def downgraded(ledger: MemoryLedger, name: str) -> Verdict:
    """The pad is talked into ranging with the public sequence, or into the drone's own ranges."""
    session = _requested(ledger, name)
    weak = (
        Radio(measured_by="uav", sts="static") if ledger.rng.random() < 0.5 else Radio(measured_by="pad", sts="static")
    )
    return ledger.submit(session.session_id, ledger.evidence(session, radio=weak))


def keyless_board(ledger: MemoryLedger, name: str) -> Verdict:
    """The pad's tags range a board that hovers there; the drone whose key answers over IP is elsewhere."""
    session = _requested(ledger, name)
    return ledger.submit(session.session_id, ledger.evidence(session, radio=Radio(measured_by="pad", sts="unbound")))


def other_codes(ledger: MemoryLedger, name: str) -> Verdict:
    """A drone answers that does not know the session's codes; the pad brings what it ranged all the same."""
    session = _requested(ledger, name)
    return ledger.submit(session.session_id, ledger.evidence(session, signer=OTHER_UAV, matched="none"))


def not_its_role(ledger: MemoryLedger, name: str) -> bool:
    """A certificate tries what is another's: to decide, to authorise, to commission, to set the policy."""
    session = _requested(ledger, name)
    attempts = (
        (
            "SubmitProof",
            tx.SubmitProof(session_id=session.session_id, evidence=ledger.evidence(session)),
            (ADMIN, PAD_OPERATOR, FLEET_OPERATOR, UAV, OTHER_PAD, OTHER_UAV),
        ),
        (
            "CompleteInteraction",
            tx.CompleteInteraction(session_id=session.session_id, result="done"),
            tuple(PEOPLE),
        ),
        (
            "SetUavStatus",
            tx.SetUavStatus(uav_id=UAV_ID, status="active", reason="so"),
            (FLEET_OPERATOR, PAD_OPERATOR, PAD, UAV, ADMIN, INSPECTOR),
        ),
        (
            "RevokeAuthorisation",
            tx.RevokeAuthorisation(uav_id=UAV_ID, authorisation_id="a1", reason="so"),
            (FLEET_OPERATOR, PAD_OPERATOR, PAD, UAV),
        ),
        ("RetirePad", tx.RetirePad(pad_id=PAD_ID, reason="so"), (FLEET_OPERATOR, PAD, OTHER_PAD, UAV)),
    )
    function, argument, who = attempts[int(ledger.rng.integers(0, len(attempts)))]
    ledger.call(who[int(ledger.rng.integers(0, len(who)))], function, argument)
    return True


def grounded(ledger: MemoryLedger, name: str) -> Verdict:
    """A drone that is where it says, without leave: suspended, or authorised for another action than this."""
    ledger.publish(name)
    if ledger.rng.random() < 0.5:
        session = ledger.request(name, action="dock")
        return ledger.submit(session.session_id, ledger.evidence(session))
    session = ledger.request(name)
    ledger.call(ADMIN, "SetUavStatus", tx.SetUavStatus(uav_id=UAV_ID, status="suspended", reason="lab"))
    try:
        return ledger.submit(session.session_id, ledger.evidence(session))
    finally:
        lifted = tx.ProposeReinstatement(uav_id=UAV_ID, reason="lab")
        ledger.approve(ledger.call(ADMIN, "ProposeReinstatement", lifted))


def framed(ledger: MemoryLedger, name: str) -> bool:
    """The pad's organisation alone against an honest drone: invented ranges that contradict its claim.

    Counted as won is a *refutation*, since that is what such a pad wants.
    """
    session = _requested(ledger, name)
    evidence = ledger.evidence(session, truth=_elsewhere(ledger), signer=None)
    return ledger.submit(session.session_id, evidence).outcome == "refuted"


def replayed_frames(rng: np.random.Generator, count: int) -> Tally:
    """Frames on the air: of another session, of this one once more, and of this one with a bit changed.

    Won is a message that the other side takes and nobody sent.
    """
    tally = Tally(tries=count)
    for _ in range(count):
        old, fresh = _keys(rng), _keys(rng)
        overheard = _sealed(Link("uav", _named(old, fresh), lambda: 0), rng)
        sender, pad = Link("uav", fresh, lambda: 0), Link("pad", fresh, lambda: 0)
        own = _sealed(sender, rng)
        for frame in overheard:
            pad.receive(frame)
        for frame in own:
            pad.receive(frame)
            pad.receive(frame)
            changed = bytearray(frame)
            changed[int(rng.integers(0, len(frame)))] ^= 1 << int(rng.integers(0, 8))
            pad.receive(bytes(changed))
        taken = [event for event in pad.events() if isinstance(event, MessageReceived)]
        tally.won += len(taken) != FRAMES
        tally.granted += len(taken) != FRAMES
        tally.refused += len(taken) == FRAMES
    return tally


def _keys(rng: np.random.Generator) -> LinkKeys:
    return LinkKeys(
        session_id=rng.bytes(4),
        key_pad_to_uav=rng.bytes(16),
        key_uav_to_pad=rng.bytes(16),
        iv_pad_to_uav=rng.bytes(13),
        iv_uav_to_pad=rng.bytes(13),
    )


def _named(keys: LinkKeys, like: LinkKeys) -> LinkKeys:
    """The old session's secrets under the new one's name, or its own name."""
    return replace(keys, session_id=like.session_id)


def _sealed(link: Link, rng: np.random.Generator) -> list[bytes]:
    for _ in range(FRAMES):
        link.send(MessageType.ECHO, rng.bytes(16))
    return link.frames_to_send(FRAMES * MAX_FRAME_OCTETS)


def _protocol(one: Try) -> tuple[Variant, ...]:
    return (Variant(ALL, play=partial(played, one)),)


ATTACKS: Final = (
    Attack(
        "session-replay",
        Family.PROTOCOL,
        "Evidence of an honest session brought again for a new one, with old or with fresh times",
        "All that was said and recorded of earlier sessions, and the pad's key.",
        "Reading the ledger.",
        "A permission.",
        "The countersignature covers the session and its transcript; times must lie within the session.",
        0,
        _protocol(old_evidence),
        wire="session-replay",
    ),
    Attack(
        "frame-replay",
        Family.PROTOCOL,
        "UWB frames of another session, of this one again, or with a bit changed",
        "The air: everything that was ever sent over it.",
        "A UWB receiver and transmitter.",
        "A message that is taken and was not sent.",
        "Keys of one session only, a sequence number in each nonce, a window that takes each number once.",
        0,
        (Variant(ALL, play=replayed_frames),),
    ),
    Attack(
        "stranger",
        Family.PROTOCOL,
        "A drone that does not know the session's codes answers in place of the right one",
        "A drone at the claimed place, with its own keys.",
        "A second drone.",
        "A permission.",
        "The codes follow from the keys of the ledger's transactions; without them nothing is verified.",
        0,
        _protocol(other_codes),
    ),
    Attack(
        "prekey-reuse",
        Family.PROTOCOL,
        "A pad's one-time key used again, published again, or taken from another pad",
        "A registered drone, or the pad's own key.",
        "Nothing.",
        "A session with it.",
        "The contract remembers every prekey that was used.",
        0,
        _protocol(used_prekey),
        wire="prekey-reuse",
    ),
    Attack(
        "many-sessions",
        Family.PROTOCOL,
        "Five sessions at once; what was measured in one is brought for another",
        "A registered drone, and a pad that mixes up its sessions.",
        "Nothing.",
        "A permission in a session that was not measured.",
        "Keys, codes and countersignature belong to one session.",
        0,
        _protocol(many_sessions),
        wire="many-sessions",
    ),
    Attack(
        "pad-alone",
        Family.PROTOCOL,
        "A compromised pad invents good evidence for a drone that is not there",
        "A pad's agent and its ledger key.",
        "Breaking into a pad.",
        "A permission.",
        "Without the drone's countersignature nothing is verified; a wrong one is named.",
        0,
        _protocol(invented_by_pad),
        wire="pad-alone",
    ),
    Attack(
        "pad-frames-drone",
        Family.PROTOCOL,
        "A compromised pad invents evidence against an honest drone",
        "A pad's agent and its ledger key.",
        "Breaking into a pad.",
        "A refutation of an honest drone (no permission is won).",
        "Nothing: a refutation needs no countersignature, or liars would withhold theirs. The record shows that it "
        "lacks one; the drone's own ranges contradict it. It lands elsewhere.",
        None,
        _protocol(framed),
    ),
    Attack(
        "downgrade",
        Family.PROTOCOL,
        "Ranging with the public sequence, or the drone's own ranges, where the policy demands level 2",
        "The choice of the way of ranging.",
        "A jammer, or old firmware.",
        "A permission.",
        "The verdict counts what the evidence says was done; the policy demands a level.",
        0,
        (Variant((2,), play=partial(played_at, downgraded, 2)),),
    ),
    Attack(
        "keyless-board",
        Family.PROTOCOL,
        "A board without any key, with the drone's address, is where the drone claims to be; the drone is elsewhere",
        "The drone's key, and one board of the kind that the pad's tags range (DWM1001).",
        "A board for some tens of euros.",
        "A permission.",
        "Nothing at level 0: where words go by IP, nothing on the air ties ranges to a session. The evidence says "
        "unbound, and any policy that demands level 1 refuses it.",
        1,
        tuple(Variant((level,), play=partial(played_at, keyless_board, level)) for level in (0, 1, 2)),
        wire="keyless-board",
    ),
    Attack(
        "wrong-role",
        Family.PROTOCOL,
        "A certificate tries what is another's: decide, complete, lift a suspension, withdraw, retire a pad",
        "Any one certificate of any organisation.",
        "Being a member.",
        "A transaction that is taken.",
        "Roles and ownership, checked by every endorser in the contract.",
        0,
        _protocol(not_its_role),
        wire="wrong-role",
    ),
    Attack(
        "no-papers",
        Family.PROTOCOL,
        "A drone that is where it says, but suspended, or not authorised for this action",
        "Nothing.",
        "–",
        "A permission.",
        "The permission needs both: the place and the papers.",
        0,
        _protocol(grounded),
    ),
)
