"""A second pad as witness: its prekey, its own transaction, its word in the verdict; and the gap between requests."""

from __future__ import annotations

import pytest
from kit.contract import HERE
from kit.witnesses import PAD_ANCHORS, WITNESS_ANCHORS, anchors, stamps

from wonderland.proofs.records import keys


@pytest.fixture
def witnessed(scene):
    """Two pads with clocks; landing at the first needs the second's word."""
    scene.call(
        scene.operator,
        "CommissionPad",
        pad_id="pad-1",
        commissioning=scene.commissioning(timestamp_sigma_mm=30, anchors=anchors(PAD_ANCHORS)),
    )
    scene.call(scene.operator, "RegisterPad", scene.pad_argument("pad-2"))
    scene.call(
        scene.operator,
        "CommissionPad",
        pad_id="pad-2",
        commissioning=scene.commissioning(timestamp_sigma_mm=30, anchors=anchors(WITNESS_ANCHORS)),
    )
    scene.call(
        scene.other_pad,
        "PublishPrekeys",
        pad_id="pad-2",
        prekeys=[{"prekey_id": f"w{i}", "public_key": scene.point(2000 + i)} for i in range(3)],
    )
    policy(scene)
    return scene


def policy(scene, **more):
    scene.set_policy({"min_assurance": 4, "witness_pad_id": "pad-2"} | more, "pad-1")


def bear_witness(scene, session, **more):
    return scene.call(
        scene.other_pad,
        "WitnessProof",
        session_id=session["session_id"],
        **{
            "radio": {"measured_by": "pad", "sts": "provisioned"},
            "time_stamps": stamps(scene, WITNESS_ANCHORS, bound_by="key"),
        }
        | more,
    )


def prove(scene, session, truth=HERE, **more):
    own = stamps(scene, PAD_ANCHORS, truth)
    return scene.submit(session, scene.evidence(session, time_stamps=own, **more))


def test_pad_and_witness_agree_and_the_verdict_has_assurance_4(witnessed):
    session = witnessed.request("k1", witness_prekey_id="w0")
    assert session["witness"]["pad_id"] == "pad-2"
    assert session["witness"]["pad_key"] == witnessed.point(2000)
    witnessed.refuse(404, "TESTIMONY_UNKNOWN", witnessed.mirror, "ReadTestimony", session_id=session["session_id"])
    testimony = bear_witness(witnessed, session)
    assert witnessed.events[-1][0] == "ProofWitnessed"
    assert witnessed.events[-1][1]["record"] == testimony
    read = witnessed.call(witnessed.mirror, "ReadTestimony", session_id=session["session_id"])
    assert read == testimony
    verdict = prove(witnessed, session)
    assert (verdict["outcome"], verdict["permission"], verdict["assurance"]) == ("verified", "granted", 4)
    assert verdict["witness"]["pad_id"] == "pad-2"
    assert verdict["witness"]["finding"] == verdict["time_differences"]["finding"] == "inside"


def test_both_prekeys_are_used_up(witnessed):
    witnessed.request("k1", witness_prekey_id="w0")
    witnessed.refuse(
        409,
        "PREKEY_USED",
        witnessed.uav,
        "RequestProof",
        witnessed.request_argument("k2", witness_prekey_id="w0"),
    )
    left = witnessed.call(witnessed.uav, "ListPrekeys", pad_id="pad-2")["prekeys"]
    assert [prekey["prekey_id"] for prekey in left] == ["w1", "w2"]
    witnessed.refuse(
        404,
        "PREKEY_UNKNOWN",
        witnessed.uav,
        "RequestProof",
        witnessed.request_argument("k2", witness_prekey_id="none"),
    )
    left = witnessed.call(witnessed.uav, "ListPrekeys", pad_id="pad-1")["prekeys"]
    assert [prekey["prekey_id"] for prekey in left] == ["k2", "k3"]


def test_the_witness_belongs_to_the_transcript(witnessed):
    with_witness = witnessed.request("k1", witness_prekey_id="w0")
    policy(witnessed, min_assurance=3)
    without = witnessed.request("k2")
    assert "witness" not in without
    assert with_witness["transcript_sha256"] != without["transcript_sha256"]


def test_without_the_witness_nothing_is_verified(witnessed):
    verdict = prove(witnessed, witnessed.request("k1", witness_prekey_id="w0"))
    assert (verdict["outcome"], verdict["assurance"]) == ("inconclusive", 3)
    assert {"no_witness", "assurance_too_low"} <= {reason["code"] for reason in verdict["reasons"]}


def test_a_witness_that_saw_the_drone_elsewhere_keeps_it_from_being_verified(witnessed):
    session = witnessed.request("k1", witness_prekey_id="w0")
    elsewhere = stamps(witnessed, WITNESS_ANCHORS, (2_000, 4_500, 1_500), bound_by="key")
    bear_witness(witnessed, session, time_stamps=elsewhere)
    verdict = prove(witnessed, session)
    assert (verdict["outcome"], verdict["permission"]) == ("inconclusive", "refused")
    assert "witness_contradicts" in {reason["code"] for reason in verdict["reasons"]}
    assert verdict["witness"]["finding"] == "outside"


@pytest.mark.parametrize(
    "more",
    [
        {"radio": {"measured_by": "uav", "sts": "provisioned"}},
        {"radio": {"measured_by": "pad", "sts": "static"}},
        {"bound_by": "none"},
        {"frames": 5},
    ],
)
def test_a_testimony_that_proves_nothing_gives_no_assurance(witnessed, more):
    session = witnessed.request("k1", witness_prekey_id="w0")
    radio = more.pop("radio", None)
    brought = stamps(witnessed, WITNESS_ANCHORS, **({"bound_by": "key"} | more))
    bear_witness(witnessed, session, time_stamps=brought, **({"radio": radio} if radio else {}))
    verdict = prove(witnessed, session)
    assert (verdict["outcome"], verdict["assurance"]) == ("inconclusive", 3)


def test_a_witness_alone_brings_about_nothing(witnessed):
    """The pad's own time stamps are missing: a dishonest witness cannot stand in for them."""
    session = witnessed.request("k1", witness_prekey_id="w0")
    bear_witness(witnessed, session)
    verdict = witnessed.submit(session)
    assert (verdict["outcome"], verdict["assurance"]) == ("inconclusive", 2)


def test_a_witness_testifies_once_in_time_and_by_itself(witnessed):
    session = witnessed.request("k1", witness_prekey_id="w0")
    argument = {
        "session_id": session["session_id"],
        "radio": {"measured_by": "pad", "sts": "provisioned"},
        "time_stamps": stamps(witnessed, WITNESS_ANCHORS),
    }
    witnessed.refuse(403, "NOT_THIS_PAD", witnessed.pad, "WitnessProof", argument)
    witnessed.refuse(403, "ROLE_NOT_ALLOWED", witnessed.uav, "WitnessProof", argument)
    witnessed.refuse(404, "SESSION_UNKNOWN", witnessed.other_pad, "WitnessProof", argument | {"session_id": "0" * 64})
    bear_witness(witnessed, session)
    witnessed.refuse(409, "TESTIMONY_EXISTS", witnessed.other_pad, "WitnessProof", argument)
    prove(witnessed, session)
    witnessed.refuse(422, "SESSION_DECIDED", witnessed.other_pad, "WitnessProof", argument)
    late = witnessed.request("k2", witness_prekey_id="w1")
    witnessed.now_ms = late["expires_ms"]
    witnessed.refuse(
        422, "SESSION_EXPIRED", witnessed.other_pad, "WitnessProof", argument | {"session_id": late["session_id"]}
    )


def test_a_witness_surveyed_again_meanwhile_does_not_count(witnessed):
    session = witnessed.request("k1", witness_prekey_id="w0")
    other = witnessed.request("k2", witness_prekey_id="w1")
    bear_witness(witnessed, session)
    witnessed.call(
        witnessed.operator,
        "CommissionPad",
        pad_id="pad-2",
        commissioning=witnessed.commissioning(
            timestamp_sigma_mm=31, anchors=anchors(WITNESS_ANCHORS), method="theodolite"
        ),
    )
    witnessed.refuse(
        409,
        "COMMISSIONING_CHANGED",
        witnessed.other_pad,
        "WitnessProof",
        session_id=other["session_id"],
        radio={"measured_by": "pad", "sts": "provisioned"},
        time_stamps=stamps(witnessed, WITNESS_ANCHORS),
    )
    verdict = prove(witnessed, session)
    assert "no_witness" in {reason["code"] for reason in verdict["reasons"]}


def test_who_can_be_a_witness(witnessed):
    argument = witnessed.request_argument("k1")
    witnessed.refuse(422, "WITNESS_PREKEY_MISSING", witnessed.uav, "RequestProof", argument)
    unknown = {"min_assurance": 4, "witness_pad_id": "pad-9"}
    witnessed.refuse(404, "PAD_UNKNOWN", witnessed.admin, "ProposePolicy", pad_id="pad-1", action="*", policy=unknown)
    witnessed.call(
        witnessed.operator,
        "CommissionPad",
        pad_id="pad-2",
        commissioning=witnessed.commissioning(anchors=anchors(WITNESS_ANCHORS)),
    )
    witnessed.refuse(422, "WITNESS_WITHOUT_CLOCK", witnessed.uav, "RequestProof", argument, witness_prekey_id="w0")
    witnessed.set_policy({}, "pad-1")
    witnessed.refuse(400, "NO_WITNESS_NAMED", witnessed.uav, "RequestProof", argument, witness_prekey_id="w0")
    session = witnessed.call(witnessed.uav, "RequestProof", argument)
    witnessed.refuse(
        422,
        "NO_WITNESS_NAMED",
        witnessed.other_pad,
        "WitnessProof",
        session_id=session["session_id"],
        radio={"measured_by": "pad", "sts": "provisioned"},
        time_stamps=stamps(witnessed, WITNESS_ANCHORS),
    )


def test_a_testimony_changes_only_with_its_organisations_signature(witnessed):
    session = witnessed.request("k1", witness_prekey_id="w0")
    bear_witness(witnessed, session)
    assert witnessed.endorsers[keys.composite(keys.TESTIMONY, session["session_id"])] == ("AuthorityMSP", "PadMSP")


def test_a_drone_cannot_drain_a_pads_prekeys(scene):
    scene.set_policy({"min_request_gap_ms": 5_000}, "pad-1")
    first = scene.request("k1")
    scene.refuse(422, "ASKED_TOO_SOON", scene.uav, "RequestProof", scene.request_argument("k2"))
    assert len(scene.call(scene.uav, "ListPrekeys", pad_id="pad-1")["prekeys"]) == 2
    scene.now_ms += 5_000
    again = scene.request("k2")
    assert again["session_id"] != first["session_id"]
    key = keys.composite(keys.LAST_REQUEST, "1AB0000001", "pad-1")
    assert key in scene.last.writes, "two at the same time conflict"
    scene.set_policy({}, "pad-1")
    scene.request("k3")
    assert key not in scene.last.writes, "without the gap nothing is shared between sessions"
