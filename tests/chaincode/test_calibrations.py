"""What a drone's node adds to ranges is registered by the pad's side, and helps an honest drone alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from wonderland.proofs.records import keys
from wonderland.proofs.records.calibrations import MAX_CALIBRATIONS
from wonderland.proofs.records.uavs import Uav
from wonderland_chaincode.contract.calibrations import MAX_AGE_MS, MAX_VALID_MS

DELAY_MM = 300
BETWEEN = (200, -300, 1_800)
"""Between the anchors, where one delay of all ranges fits no place."""


def ranged(scene, prekey_id="k1", **more):
    """A session in which the drone stood between the anchors; its id."""
    session = scene.request(prekey_id, claim=scene.claim(BETWEEN))
    scene.submit(session, scene.evidence(session, BETWEEN, BETWEEN, delay_mm=DELAY_MM, **more))
    return session["session_id"]


@pytest.fixture
def calibrated(scene):
    scene.call(scene.operator, "CalibrateUav", scene.calibration(ranged(scene)))
    return scene


def codes(verdict):
    return {reason["code"] for reason in verdict["reasons"]}


def test_a_calibrated_drone_is_verified_where_it_was_not(scene):
    session = scene.request("k1", claim=scene.claim(BETWEEN))
    verdict = scene.submit(session, scene.evidence(session, BETWEEN, BETWEEN, delay_mm=DELAY_MM))
    assert (verdict["outcome"], "calibration" in session) == ("inconclusive", False)
    assert "ranges_inconsistent" in codes(verdict)
    uav = scene.call(scene.operator, "CalibrateUav", scene.calibration(session["session_id"], node="DWM3001CDK 7"))
    (kept,) = uav["calibrations"]
    assert kept == {
        "pad_id": "pad-1",
        "commissioning_sha256": session["commissioning_sha256"],
        "offset_mm": 300,
        "sigma_mm": 20,
        "sessions": 1,
        "rounds": 40,
        "measured_ms": verdict["decided_ms"],
        "valid_until_ms": scene.start_ms + 10**9,
        "registered_ms": scene.now_ms,
        "registered_by": "olga",
        "msp_id": "PadMSP",
        "node": "DWM3001CDK 7",
    }
    assert scene.events[-1][0] == "UavCalibrated"
    session = scene.request("k2", claim=scene.claim(BETWEEN))
    assert session["calibration"] == {"offset_mm": 300, "sigma_mm": 20, "measured_ms": verdict["decided_ms"]}
    verdict = scene.submit(session, scene.evidence(session, BETWEEN, BETWEEN, delay_mm=DELAY_MM))
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "granted"), verdict["reasons"]
    assert {"calibrated", "within_buffer"} <= codes(verdict)


def test_who_flies_a_drone_does_not_calibrate_it(scene):
    session_id = ranged(scene)
    argument = scene.calibration(session_id)

    def refuse(code, who):
        scene.refuse(403, code, who, "CalibrateUav", argument)

    refuse("ROLE_NOT_ALLOWED", scene.fleet)
    refuse("ROLE_NOT_ALLOWED", scene.uav)
    refuse("ROLE_NOT_ALLOWED", scene.pad)  # its key lies beside the radios
    refuse("PAD_OF_OTHER_ORGANISATION", scene.other_operator)
    # A pad operator of the drone's own organisation; then one whose operator flies the drone under another roof.
    refuse("PAD_OF_OTHER_ORGANISATION", scene.person(scene.operator, msp_id="FleetMSP"))
    scene.call(scene.operator, "UpdatePad", pad_id="pad-1", operator_id="fleet")
    refuse("CALIBRATED_BY_OWNER", scene.operator)
    scene.call(scene.inspector, "CalibrateUav", argument)


def test_an_authority_that_flies_drones_does_not_calibrate_its_own(empty):
    scene = empty.with_pad().with_prekeys("k1")
    scene.call(scene.admin, "RegisterUav", scene.uav_argument())
    uav = scene.person(scene.uav, msp_id="AuthorityMSP")
    session = scene.call(uav, "RequestProof", scene.request_argument())
    scene.submit(session, scene.evidence(session, signer=uav))
    argument = scene.calibration(session["session_id"])
    for who in (scene.admin, scene.inspector):
        scene.refuse(403, "CALIBRATED_BY_OWNER", who, "CalibrateUav", argument)
    scene.call(scene.operator, "CalibrateUav", argument)


@pytest.mark.parametrize(
    "wrong",
    [{"offset_mm": 501}, {"offset_mm": -501}, {"sigma_mm": 19}, {"sigma_mm": 201}, {"sessions": []}],
)
def test_beyond_what_nodes_add_is_no_calibration(scene, wrong):
    argument = scene.calibration(ranged(scene)) | wrong
    scene.refuse(400, "BAD_ARGUMENT", scene.operator, "CalibrateUav", argument)


def test_it_rests_on_sessions_of_this_drone_at_this_pad(scene):
    def refuse(status, code, *session_ids, **more):
        scene.refuse(status, code, scene.inspector, "CalibrateUav", scene.calibration(*session_ids, **more))

    waiting = scene.request("k1")["session_id"]
    refuse(422, "CALIBRATION_UNMEASURED", waiting)
    refuse(404, "SESSION_UNKNOWN", "0" * 64)
    refuse(404, "UAV_UNKNOWN", waiting, uav_id="nobody")
    refuse(404, "PAD_UNKNOWN", waiting, pad_id="nowhere")
    good = ranged(scene, "k2")
    refuse(400, "SESSION_TWICE", good, good)
    scene.call(scene.fleet, "RegisterUav", scene.uav_argument("1AB0000002"))
    refuse(422, "CALIBRATION_OF_ANOTHER", good, uav_id="1AB0000002")
    scene.call(scene.operator, "RegisterPad", scene.pad_argument("pad-2"))
    refuse(422, "PAD_NOT_COMMISSIONED", good, pad_id="pad-2")
    scene.call(scene.operator, "CommissionPad", pad_id="pad-2", commissioning=scene.commissioning())
    refuse(422, "CALIBRATION_OF_ANOTHER", good, pad_id="pad-2")
    short = ranged(scene, "k3", rounds=20)
    refuse(422, "CALIBRATION_TOO_SHORT", short)
    scene.call(scene.inspector, "CalibrateUav", scene.calibration(short, good))


def test_what_the_drone_measured_itself_calibrates_nothing(scene):
    session_id = ranged(scene, radio={"measured_by": "uav", "sts": "static"})
    scene.refuse(422, "CALIBRATION_UNMEASURED", scene.operator, "CalibrateUav", scene.calibration(session_id))


def test_an_old_one_cannot_be_played_again(scene):
    first = ranged(scene, "k1")
    second = ranged(scene, "k2")
    scene.call(scene.operator, "CalibrateUav", scene.calibration(second))
    for old in (first, second):
        scene.refuse(409, "CALIBRATION_NOT_NEWER", scene.operator, "CalibrateUav", scene.calibration(old))
    scene.call(scene.fleet, "WithdrawCalibration", uav_id="1AB0000001", pad_id="pad-1", reason="another antenna")
    scene.refuse(409, "CALIBRATION_NOT_NEWER", scene.operator, "CalibrateUav", scene.calibration(second))
    third = ranged(scene, "k3")
    scene.now_ms += MAX_AGE_MS
    late = scene.calibration(third, valid_until_ms=scene.now_ms + 1)
    scene.now_ms += 1
    scene.refuse(422, "CALIBRATION_TOO_OLD", scene.operator, "CalibrateUav", late)


def test_it_holds_for_a_time(scene):
    session_id = ranged(scene)
    for until_ms in (scene.now_ms, scene.now_ms + MAX_VALID_MS + 1):
        argument = scene.calibration(session_id, valid_until_ms=until_ms)
        scene.refuse(422, "CALIBRATION_NOT_VALID", scene.operator, "CalibrateUav", argument)
    scene.call(scene.operator, "CalibrateUav", scene.calibration(session_id, valid_until_ms=scene.now_ms + 5_000))
    assert "calibration" in scene.request("k2")
    scene.now_ms += 5_000
    assert "calibration" not in scene.request("k3")


def test_it_holds_under_the_commissioning_at_which_it_was_made(calibrated):
    scene = calibrated
    assert "calibration" in scene.request("k2")
    old = ranged(scene, "k3")
    new = scene.commissioning(method="another tag")
    scene.call(scene.operator, "CommissionPad", pad_id="pad-1", commissioning=new)
    scene.with_prekeys("k4")
    assert "calibration" not in scene.request("k4")
    scene.refuse(422, "CALIBRATION_OUTDATED", scene.operator, "CalibrateUav", scene.calibration(old))


def test_whoever_knows_that_it_holds_no_longer_withdraws_it(calibrated):
    scene = calibrated
    argument = {"uav_id": "1AB0000001", "pad_id": "pad-1", "reason": "another node"}
    for who in (scene.other_fleet, scene.other_operator):
        scene.refuse(403, "PAD_OF_OTHER_ORGANISATION", who, "WithdrawCalibration", argument)
    for who in (scene.fleet, scene.operator, scene.inspector):
        uav = scene.call(who, "WithdrawCalibration", argument)
        assert uav["calibrations"][0]["withdrawn"] == "another node"
        scene.refuse(404, "CALIBRATION_UNKNOWN", who, "WithdrawCalibration", argument)
        scene.with_prekeys(f"k{scene.count}")
        assert "calibration" not in scene.request(f"k{scene.count - 1}", claim=scene.claim(BETWEEN))
        scene.with_prekeys(f"k{scene.count}")
        scene.call(scene.operator, "CalibrateUav", scene.calibration(ranged(scene, f"k{scene.count - 1}")))


def test_a_retired_drone_is_not_calibrated(scene):
    session_id = ranged(scene)
    scene.call(scene.fleet, "SetUavStatus", uav_id="1AB0000001", status="retired", reason="sold")
    scene.refuse(422, "UAV_RETIRED", scene.operator, "CalibrateUav", scene.calibration(session_id))


def test_those_that_are_over_make_room(calibrated):
    scene = calibrated
    key = keys.composite(keys.UAV, "1AB0000001")
    uav = Uav.decode(scene.state[key])
    (one,) = uav.calibrations
    others = tuple(replace(one, pad_id=f"pad-x{number:02}") for number in range(MAX_CALIBRATIONS))
    argument = scene.calibration(ranged(scene, "k2"))
    scene.state[key] = replace(uav, calibrations=others).encode()
    scene.refuse(422, "TOO_MANY_CALIBRATIONS", scene.operator, "CalibrateUav", argument)
    over = replace(others[0], withdrawn="elsewhere"), replace(others[1], valid_until_ms=scene.now_ms)
    scene.state[key] = replace(uav, calibrations=(*over, *others[2:])).encode()
    kept = scene.call(scene.operator, "CalibrateUav", argument)["calibrations"]
    assert [each["pad_id"] for each in kept] == ["pad-1", *(each.pad_id for each in others[2:])]


@pytest.mark.parametrize("offset_mm", [-500, 500])
def test_a_false_offset_moves_no_drone_into_its_buffer(scene, offset_mm):
    """Twelve metres out all ranges longer or shorter by half a metre are a place half a metre off."""
    far = (8_500, 8_500, 4_000)
    lie = 1_250 / 12_020
    towards = 1.0 + lie if offset_mm < 0 else 1.0 - lie
    claimed = (round(far[0] * towards), round(far[1] * towards), far[2])
    scene.call(scene.operator, "CalibrateUav", scene.calibration(ranged(scene), offset_mm=offset_mm))
    session = scene.request("k2", claim=scene.claim(claimed))
    verdict = scene.submit(session, scene.evidence(session, far, claimed, rounds=160))
    assert verdict["outcome"] != "verified"
    assert "calibration_alone" in codes(verdict)
    # Nor is an honest one convicted by it.
    session = scene.request("k3", claim=scene.claim(far))
    verdict = scene.submit(session, scene.evidence(session, far, far, rounds=160))
    assert verdict["outcome"] != "refuted"
