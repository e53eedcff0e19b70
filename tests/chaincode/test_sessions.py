from __future__ import annotations

import hashlib

import pytest

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.transcript import transcript_of

ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551


def codes(verdict):
    return {reason["code"] for reason in verdict["reasons"]}


def test_an_honest_drone_lands(scene):
    prekey = scene.call(scene.uav, "ListPrekeys", pad_id="pad-1")["prekeys"][0]
    session = scene.request()
    assert session["session_id"] == scene.tx_id
    assert (session["state"], session["uav_id"], session["pad_key"]) == (
        "requested",
        "1AB0000001",
        prekey["public_key"],
    )
    assert session["expires_ms"] == session["requested_ms"] + 60_000
    assert session["pad"] == {"msp_id": "PadMSP", "certificate_sha256": scene.pad.certificate_sha256}
    assert session["uav"]["public_key"] == encoding.to_base64url(scene.uav.public_key)
    parsed = Session.parse(session)
    assert session["transcript_sha256"] == transcript_of(parsed, "pol").digest().hex()
    assert scene.events[-1] == (
        "ProofRequested",
        {"kind": "ProofRequested", "tx_id": scene.tx_id, "t_ms": scene.now_ms, "record": session},
    )

    evidence = scene.evidence(session)
    verdict = scene.submit(session, evidence)
    assert (verdict["outcome"], verdict["permission"], verdict["authorised"]) == ("verified", "granted", True)
    assert verdict["assurance"] == 2
    assert verdict["signed"]["error_mm"] < 100
    assert verdict["evidence_sha256"] == hashlib.sha256(Evidence.parse(evidence).encode()).hexdigest()
    assert scene.events[-1][0] == "ProofDecided"
    assert scene.events[-1][1]["record"] == verdict
    decided = scene.call(scene.mirror, "ReadSession", session_id=session["session_id"])
    assert decided == session | {"state": "decided", "decided_ms": scene.now_ms}
    assert scene.call(scene.mirror, "ReadVerdict", session_id=session["session_id"]) == verdict

    scene.now_ms += 1_000_000  # landing takes its time
    ended = scene.call(scene.uav, "CompleteInteraction", session_id=session["session_id"], result="done", note="gently")
    assert ended == decided | {
        "state": "completed",
        "end": "done",
        "ended_by": "uav",
        "ended_ms": scene.now_ms,
        "note": "gently",
    }
    assert scene.events[-1][0] == "InteractionCompleted"


def test_a_lie_is_refuted_and_turned_away(scene):
    session = scene.request()
    verdict = scene.submit(session, scene.evidence(session, truth=(9_000, 1_000, 1_500)))
    assert (verdict["outcome"], verdict["permission"]) == ("refuted", "refused")
    sid = session["session_id"]
    scene.refuse(422, "NO_PERMISSION", scene.uav, "CompleteInteraction", session_id=sid, result="done")
    ended = scene.call(scene.pad, "CancelProof", session_id=sid, reason="refuted")
    assert (ended["state"], ended["end"], ended["ended_by"]) == ("cancelled", "refuted", "pad")
    assert scene.events[-1][0] == "ProofCancelled"


# the request


@pytest.mark.parametrize(
    ("more", "status", "code"),
    [
        ({"uav_key": encoding.to_base64url(b"\x04" + bytes(64))}, 400, "KEY_NOT_ON_CURVE"),
        ({"prekey_id": "k9"}, 404, "PREKEY_UNKNOWN"),
        ({"pad_id": "pad-9"}, 404, "PAD_UNKNOWN"),
    ],
)
def test_what_a_request_must_name(scene, more, status, code):
    scene.refuse(status, code, scene.uav, "RequestProof", scene.request_argument(**more))


@pytest.mark.parametrize(
    ("offset_ms", "code"),
    [(-10_001, "CLAIM_TOO_OLD"), (-10_000, None), (5_000, None), (5_001, "CLAIM_FROM_FUTURE")],
)
def test_a_claim_must_be_fresh(scene, offset_ms, code):
    argument = scene.request_argument(claim=scene.claim(t_ms=scene.now_ms + offset_ms))
    if code is None:
        scene.call(scene.uav, "RequestProof", argument)
    else:
        scene.refuse(422, code, scene.uav, "RequestProof", argument)


def test_a_request_from_before_its_prekey_has_a_wrong_clock(scene):
    scene.now_ms += 20_000
    scene.with_prekeys("late")
    scene.now_ms -= 5_001
    scene.refuse(422, "CLOCKS_DISAGREE", scene.uav, "RequestProof", scene.request_argument("late"))
    scene.now_ms += 1
    scene.request("late")


def test_a_prekey_opens_one_session(scene):
    scene.request("k1")
    scene.refuse(409, "PREKEY_USED", scene.uav, "RequestProof", scene.request_argument("k1"))
    assert [key["prekey_id"] for key in scene.call(scene.uav, "ListPrekeys", pad_id="pad-1")["prekeys"]] == ["k2", "k3"]


def test_an_unregistered_drone_and_one_without_a_name_are_refused(scene):
    scene.refuse(404, "UAV_UNKNOWN", scene.other_uav, "RequestProof", scene.request_argument())
    for pol_id in ("", "1AB\x00", "-", "x" * 41, "1AB0000001\n"):
        nobody = scene.person(scene.uav, pol_id=pol_id)
        scene.refuse(403, "IDENTITY_WITHOUT_ID", nobody, "RequestProof", scene.request_argument())


def test_a_suspended_drone_may_ask_so_that_its_attempt_is_on_record(scene):
    scene.call(scene.admin, "SetUavStatus", uav_id="1AB0000001", status="suspended", reason="x")
    assert scene.request()["state"] == "requested"


def test_a_pad_must_be_commissioned_now(empty):
    empty.with_uav()
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    empty.with_prekeys("k1")
    empty.refuse(422, "PAD_NOT_COMMISSIONED", empty.uav, "RequestProof", empty.request_argument())
    later = empty.commissioning(valid_from_ms=empty.now_ms + 1)
    empty.call(empty.operator, "CommissionPad", pad_id="pad-1", commissioning=later)
    empty.refuse(422, "COMMISSIONING_NOT_VALID", empty.uav, "RequestProof", empty.request_argument())
    empty.now_ms += 1
    empty.request()


# the proof


def _submit(scene, session, status, code, who=None, **more):
    evidence = more.pop("evidence", None) or scene.evidence(session)
    return scene.refuse(
        status, code, who or scene.pad, "SubmitProof", session_id=session["session_id"], evidence=evidence
    )


def test_only_the_sessions_pad_submits(scene):
    session = scene.request()
    _submit(scene, session, 403, "NOT_THIS_PAD", who=scene.other_pad)
    _submit(scene, session, 403, "NOT_THIS_PAD", who=scene.person(scene.pad, msp_id="OtherPadMSP"))
    _submit(scene, session, 403, "ROLE_NOT_ALLOWED", who=scene.uav)
    _submit(scene, {**session, "session_id": "0" * 64}, 404, "SESSION_UNKNOWN")


def test_a_session_is_decided_once_and_in_time(scene):
    session = scene.request("k1")
    scene.submit(session)
    _submit(scene, session, 422, "SESSION_DECIDED")
    scene.call(scene.pad, "CompleteInteraction", session_id=session["session_id"], result="aborted")
    _submit(scene, session, 422, "SESSION_COMPLETED")
    session = scene.request("k2")
    evidence = scene.evidence(session)
    scene.now_ms = session["expires_ms"]
    _submit(scene, session, 422, "SESSION_EXPIRED", evidence=evidence)
    scene.call(scene.pad, "CancelProof", session_id=session["session_id"], reason="timeout")
    _submit(scene, session, 422, "SESSION_CANCELLED", evidence=evidence)


def test_a_request_dated_ahead_gains_no_time(scene):
    scene.now_ms += 30_000
    session = scene.request()
    evidence = scene.evidence(session)
    scene.now_ms = session["requested_ms"] - 5_001
    _submit(scene, session, 422, "CLOCKS_DISAGREE", evidence=evidence)


def test_a_survey_between_request_and_proof_voids_the_session(scene):
    session = scene.request()
    scene.call(scene.operator, "CommissionPad", pad_id="pad-1", commissioning=scene.commissioning(range_sigma_mm=26))
    _submit(scene, session, 409, "COMMISSIONING_CHANGED")
    scene.call(scene.operator, "CommissionPad", pad_id="pad-1", commissioning=scene.commissioning())
    scene.submit(session)  # the same survey again is the same ground


def test_a_pad_that_retires_or_whose_survey_ends_proves_nothing_more(scene):
    until = scene.now_ms + 10_000
    scene.call(scene.operator, "CommissionPad", pad_id="pad-1", commissioning=scene.commissioning(valid_until_ms=until))
    session = scene.request()
    evidence = scene.evidence(session)
    scene.now_ms = until
    _submit(scene, session, 422, "COMMISSIONING_NOT_VALID", evidence=evidence)
    scene.call(scene.operator, "RetirePad", pad_id="pad-1", reason="x")
    _submit(scene, session, 422, "PAD_RETIRED", evidence=evidence)
    scene.call(scene.pad, "CancelProof", session_id=session["session_id"], reason="retired")


def test_without_the_drones_countersignature_nothing_is_verified(scene):
    session = scene.request("k1")
    evidence = scene.evidence(session)
    del evidence["uav_signature"]
    verdict = scene.submit(session, evidence)
    assert (verdict["outcome"], verdict["permission"]) == ("inconclusive", "refused")
    assert "not_countersigned" in codes(verdict)


def _by_another(evidence, scene, session):
    return scene.evidence(session, signer=scene.other_uav)


def _high_s(evidence, scene, session):
    raw = encoding.from_base64url(evidence["uav_signature"])
    twin = (ORDER - int.from_bytes(raw[32:], "big")).to_bytes(32, "big")
    return evidence | {"uav_signature": encoding.to_base64url(raw[:32] + twin)}


def _zero(evidence, scene, session):
    return evidence | {"uav_signature": encoding.to_base64url(bytes(64))}


def _changed_range(evidence, scene, session):
    evidence["ranges"]["anchors"][0]["range_mm"][0] += 1
    return evidence


def _changed_claim(evidence, scene, session):
    evidence["claims"][0]["height_mm"] += 1
    return evidence


def _of_another_session(evidence, scene, session):
    return scene.evidence(session | {"session_id": "1" * 64})


@pytest.mark.parametrize("forge", [_by_another, _high_s, _zero, _changed_range, _changed_claim, _of_another_session])
def test_a_countersignature_for_something_else_does_not_count(scene, forge):
    session = scene.request()
    verdict = scene.submit(session, forge(scene.evidence(session), scene, session))
    assert verdict["outcome"] == "inconclusive"
    assert "countersignature_invalid" in codes(verdict)


def test_codes_that_did_not_match_verify_nothing(scene):
    session = scene.request()
    verdict = scene.submit(session, scene.evidence(session, matched="none"))
    assert verdict["permission"] == "refused"
    assert "codes_not_matched" in codes(verdict)


def test_a_session_without_any_range_ends_inconclusive(scene):
    session = scene.request()
    scene.now_ms += 10
    evidence = scene.evidence(session, rounds=0, failure="anchors_silent")
    verdict = scene.submit(session, evidence)
    assert (verdict["outcome"], verdict["rounds"]) == ("inconclusive", 0)


def test_a_claim_on_the_other_side_of_the_planet_is_decided_too(scene):
    claim = scene.claim() | {"lat_e7": -604_518_000, "lon_e7": -1_577_334_000}
    session = scene.request(claim=claim)
    verdict = scene.submit(session)
    assert verdict["permission"] == "refused"


# the end


def test_who_ends_a_session(scene):
    session = scene.request()
    sid = session["session_id"]
    for who in (
        scene.other_pad,
        scene.other_uav,
        scene.person(scene.uav, msp_id="PadMSP"),
        scene.person(scene.pad, msp_id="FleetMSP"),
    ):
        scene.refuse(403, "NOT_YOUR_SESSION", who, "CancelProof", session_id=sid, reason="x")
        scene.refuse(403, "NOT_YOUR_SESSION", who, "CompleteInteraction", session_id=sid, result="done")
    scene.refuse(422, "SESSION_REQUESTED", scene.uav, "CompleteInteraction", session_id=sid, result="done")
    ended = scene.call(scene.admin, "CancelProof", session_id=sid, reason="closed_airspace", note="fire")
    assert (ended["state"], ended["ended_by"], ended["note"]) == ("cancelled", "authority", "fire")
    scene.refuse(422, "SESSION_CANCELLED", scene.admin, "CancelProof", session_id=sid, reason="again")
    scene.refuse(404, "VERDICT_UNKNOWN", scene.mirror, "ReadVerdict", session_id=sid)
    scene.refuse(404, "SESSION_UNKNOWN", scene.mirror, "ReadSession", session_id="f" * 64)


def test_a_permission_stands_until_it_expires(scene):
    session = scene.request()
    sid = session["session_id"]
    scene.submit(session)
    scene.refuse(422, "PERMISSION_STANDS", scene.uav, "CancelProof", session_id=sid, reason="x")
    scene.now_ms = session["expires_ms"]
    ended = scene.call(scene.pad, "CancelProof", session_id=sid, reason="not_used")
    assert ended["state"] == "cancelled"
    scene.refuse(422, "SESSION_CANCELLED", scene.uav, "CompleteInteraction", session_id=sid, result="done")


def test_a_policy_decides_how_long_a_session_lives(scene):
    scene.set_policy(Policy(session_ttl_ms=1_000).to_json(), "pad-1")
    session = scene.request()
    assert session["expires_ms"] == scene.now_ms + 1_000
    _submit(scene, session, 422, "SESSION_EXPIRED", evidence=scene.evidence(session))


def test_sessions_share_no_key_that_both_write(scene):
    """Otherwise two drones at one pad would invalidate each other's transactions."""
    scene.call(scene.fleet, "RegisterUav", scene.uav_argument("1AB0000002"))
    written = []
    for who, prekey_id in ((scene.uav, "k1"), (scene.other_uav, "k2")):
        scene.call(who, "RequestProof", scene.request_argument(prekey_id))
        assert scene.last is not None
        written.append(set(scene.last.writes))
    assert not written[0] & written[1]


def test_what_belongs_to_a_pad_needs_its_organisation_from_then_on(scene, make_scene):
    """Key-level endorsement: pad, prekeys, session and verdict; nothing else."""
    session = scene.request()
    scene.submit(session)
    scene.call(scene.uav, "CompleteInteraction", session_id=session["session_id"], result="done")
    pads = {keys.PAD, keys.PREKEY, keys.SESSION, keys.VERDICT}
    for key in scene.state:
        kind, _ = keys.split(key)
        assert scene.endorsers.get(key) == (("AuthorityMSP", "PadMSP") if kind in pads else None)
    assert {keys.split(key)[0] for key in scene.endorsers} == pads
    other = make_scene()
    other.call(other.other_operator, "RegisterPad", other.pad_argument("pad-9"))
    assert other.endorsers == {keys.composite(keys.PAD, "pad-9"): ("AuthorityMSP", "OtherPadMSP")}
