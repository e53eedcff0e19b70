from __future__ import annotations

import pytest

from wonderland_chaincode.contract.uavs import MAX_AUTHORISATIONS


def test_a_drone_is_registered_maintained_and_authorised(empty):
    uav = empty.call(empty.fleet, "RegisterUav", empty.uav_argument())
    assert (uav["msp_id"], uav["status"]) == ("FleetMSP", "active")
    assert "maintenance" not in uav
    uav = empty.call(empty.fleet, "RecordMaintenance", empty.maintenance())
    assert uav["maintenance"]["recorded_by"] == "fred"
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    granted = empty.call(empty.inspector, "GrantAuthorisation", empty.authorisation())
    assert (granted["granted_by"], granted["revoked"]) == ("ines", False)
    revoked = empty.call(
        empty.inspector, "RevokeAuthorisation", uav_id="1AB0000001", authorisation_id="a1", reason="noise"
    )
    assert (revoked["revoked"], revoked["revoked_reason"], revoked["revoked_ms"]) == (True, "noise", empty.now_ms)
    assert empty.call(empty.pad, "ReadUav", uav_id="1AB0000001") == uav
    assert [name for name, _ in empty.events] == [
        "UavRegistered",
        "MaintenanceRecorded",
        "PadRegistered",
        "AuthorisationGranted",
        "AuthorisationRevoked",
    ]
    assert empty.events[-1][1]["record"] == revoked


def test_drones_are_unique_and_known(empty):
    empty.call(empty.fleet, "RegisterUav", empty.uav_argument())
    empty.refuse(409, "UAV_EXISTS", empty.other_fleet, "RegisterUav", empty.uav_argument())
    empty.refuse(404, "UAV_UNKNOWN", empty.mirror, "ReadUav", uav_id="nobody")
    empty.refuse(404, "UAV_UNKNOWN", empty.admin, "SetUavStatus", uav_id="nobody", status="suspended", reason="x")


def test_a_number_in_clear_is_refused_and_not_repeated(empty):
    argument = empty.uav_argument(registration="FIN87astrdge12k8")
    error = empty.refuse(400, "BAD_ARGUMENT", empty.fleet, "RegisterUav", argument)
    assert "registration_commitment" in str(error)
    assert "FIN87" not in str(error)


@pytest.mark.parametrize("commitment", ["", "5a" * 31, "5A" * 32, "FIN87astrdge12k8", 7])
def test_of_the_commitment_the_contract_knows_the_form_alone(empty, commitment):
    argument = empty.uav_argument(registration_commitment=commitment)
    empty.refuse(400, "BAD_ARGUMENT", empty.fleet, "RegisterUav", argument)
    stored = empty.call(empty.fleet, "RegisterUav", empty.uav_argument())
    assert stored["registration_commitment"] == "5a" * 32
    without = {name: value for name, value in empty.uav_argument("uav-w").items() if name != "registration_commitment"}
    assert "registration_commitment" not in empty.call(empty.fleet, "RegisterUav", without)


def test_the_authority_suspends_and_two_of_it_reactivate_and_the_operator_only_retires(scene):
    def status(who, status):
        return scene.call(who, "SetUavStatus", uav_id="1AB0000001", status=status, reason="because")

    assert status(scene.inspector, "suspended")["status_reason"] == "because"
    for wish in ("active", "suspended"):
        scene.refuse(
            403,
            "OPERATOR_MAY_ONLY_RETIRE",
            scene.fleet,
            "SetUavStatus",
            uav_id="1AB0000001",
            status=wish,
            reason="please",
        )
    scene.refuse(
        403, "TWO_PEOPLE_NEEDED", scene.admin, "SetUavStatus", uav_id="1AB0000001", status="active", reason="alone"
    )
    assert scene.reinstate()["state"] == "approved"
    assert scene.call(scene.mirror, "ReadUav", uav_id="1AB0000001")["status"] == "active"
    assert status(scene.fleet, "retired")["status"] == "retired"
    for who, function, argument in (
        (scene.admin, "SetUavStatus", {"uav_id": "1AB0000001", "status": "active", "reason": "x"}),
        (scene.fleet, "RecordMaintenance", scene.maintenance()),
        (scene.admin, "GrantAuthorisation", scene.authorisation(authorisation_id="a2")),
        (scene.uav, "RequestProof", scene.request_argument()),
    ):
        scene.refuse(422, "UAV_RETIRED", who, function, argument)


def test_another_organisations_drone_is_out_of_reach(scene):
    who = scene.other_fleet
    code = "UAV_OF_OTHER_ORGANISATION"
    scene.refuse(403, code, who, "SetUavStatus", uav_id="1AB0000001", status="retired", reason="x")
    scene.refuse(403, code, who, "RecordMaintenance", scene.maintenance())
    scene.refuse(403, code, scene.person(scene.uav, msp_id="OtherFleetMSP"), "RequestProof", scene.request_argument())


def test_maintenance_has_sensible_times(scene):
    scene.refuse(
        400,
        "MAINTENANCE_NEVER_VALID",
        scene.fleet,
        "RecordMaintenance",
        scene.maintenance(valid_until_ms=scene.start_ms - 1000),
    )
    scene.refuse(
        422,
        "MAINTENANCE_IN_FUTURE",
        scene.fleet,
        "RecordMaintenance",
        scene.maintenance(performed_ms=scene.now_ms + 5001),
    )
    scene.call(scene.fleet, "RecordMaintenance", scene.maintenance(performed_ms=scene.now_ms + 5000))


def test_authorisations_name_what_exists(scene):
    refuse = scene.refuse
    refuse(400, "ACTION_TWICE", scene.admin, "GrantAuthorisation", scene.authorisation(actions=["land", "land"]))
    refuse(404, "UAV_UNKNOWN", scene.admin, "GrantAuthorisation", scene.authorisation(uav_id="nobody"))
    refuse(404, "PAD_UNKNOWN", scene.admin, "GrantAuthorisation", scene.authorisation(pad_id="nowhere"))
    refuse(409, "AUTHORISATION_EXISTS", scene.admin, "GrantAuthorisation", scene.authorisation())
    over = scene.authorisation(authorisation_id="a2", valid_from_ms=1, valid_until_ms=scene.now_ms)
    refuse(422, "AUTHORISATION_OVER", scene.admin, "GrantAuthorisation", over)
    revoke = {"uav_id": "1AB0000001", "authorisation_id": "a1", "reason": "x"}
    refuse(404, "AUTHORISATION_UNKNOWN", scene.admin, "RevokeAuthorisation", revoke | {"authorisation_id": "a9"})
    scene.call(scene.admin, "RevokeAuthorisation", revoke)
    refuse(422, "AUTHORISATION_REVOKED", scene.admin, "RevokeAuthorisation", revoke)


def test_the_number_of_authorisations_is_bounded_and_ended_ones_make_room(scene):
    for index in range(MAX_AUTHORISATIONS - 1):
        scene.call(
            scene.admin, "GrantAuthorisation", scene.authorisation(authorisation_id=f"b{index}", actions=["dock"])
        )
    new = scene.authorisation(authorisation_id="c")
    scene.refuse(422, "TOO_MANY_AUTHORISATIONS", scene.admin, "GrantAuthorisation", new)
    scene.call(scene.admin, "RevokeAuthorisation", uav_id="1AB0000001", authorisation_id="b7", reason="x")
    scene.call(scene.admin, "GrantAuthorisation", new)
    assert scene.last is not None
    removed = [key for key, value in scene.last.writes.items() if value is None]
    assert [key for key in removed if "b7" in key] == removed
    assert len(removed) == 1
    scene.refuse(404, "AUTHORISATION_UNKNOWN", scene.admin, "RevokeAuthorisation", uav_id="1AB0000001", authorisation_id="b7", reason="x")  # fmt: skip


def _suspend(scene):
    scene.call(scene.admin, "SetUavStatus", uav_id="1AB0000001", status="suspended", reason="x")


def _retire(scene):
    scene.call(scene.fleet, "SetUavStatus", uav_id="1AB0000001", status="retired", reason="x")


def _lapse(scene):
    scene.call(scene.fleet, "RecordMaintenance", scene.maintenance(valid_until_ms=scene.now_ms + 100))


def _revoke(scene):
    scene.call(scene.admin, "RevokeAuthorisation", uav_id="1AB0000001", authorisation_id="a1", reason="x")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_suspend, "uav_suspended"),
        (_retire, "uav_retired"),
        (_lapse, "maintenance_lapsed"),
        (_revoke, "not_authorised"),
    ],
)
def test_a_drone_that_may_not_is_verified_and_refused(scene, change, code):
    """Also where it lost the right between request and verdict."""
    session = scene.request()
    change(scene)
    verdict = scene.submit(session)
    assert verdict["outcome"] == "verified"
    assert (verdict["authorised"], verdict["permission"]) == (False, "refused")
    assert code in {reason["code"] for reason in verdict["reasons"]}


@pytest.mark.parametrize(
    "more",
    [
        {"pad_id": "pad-2"},
        {"actions": ["takeoff", "dock"]},
        {"valid_from_ms": 1_800_000_000_000 + 10**8},
        {"valid_until_ms": 1_800_000_000_000 + 1_000},
    ],
    ids=["elsewhere", "something_else", "later", "until_just_now"],
)
def test_an_authorisation_for_something_else_is_none(empty, more):
    empty.with_pad().with_prekeys("k1").with_uav()
    empty.call(empty.operator, "RegisterPad", empty.pad_argument("pad-2"))
    empty.call(empty.admin, "GrantAuthorisation", empty.authorisation(**more))
    verdict = empty.submit(empty.request())
    assert verdict["outcome"] == "verified"
    assert verdict["permission"] == "refused"
    assert [reason["code"] for reason in verdict["reasons"] if "authoris" in reason["code"]] == ["not_authorised"]


def test_an_authorisation_for_every_pad_serves_here(empty):
    empty.with_pad().with_prekeys("k1").with_uav()
    empty.call(empty.admin, "GrantAuthorisation", empty.authorisation(pad_id="*", actions=["dock", "land"]))
    assert empty.submit(empty.request())["permission"] == "granted"


def test_another_drones_authorisation_is_no_help(empty):
    """Also where its name begins alike."""
    empty.with_pad().with_prekeys("k1").with_uav()
    empty.call(empty.fleet, "RegisterUav", empty.uav_argument("1AB00000011"))
    empty.call(empty.admin, "GrantAuthorisation", empty.authorisation(uav_id="1AB00000011"))
    assert empty.submit(empty.request())["permission"] == "refused"


def test_no_maintenance_on_record_is_a_reason_of_its_own(empty):
    empty.with_pad().with_prekeys("k1")
    empty.call(empty.fleet, "RegisterUav", empty.uav_argument())
    empty.call(empty.admin, "GrantAuthorisation", empty.authorisation())
    verdict = empty.submit(empty.request())
    assert "maintenance_missing" in {reason["code"] for reason in verdict["reasons"]}
    assert verdict["permission"] == "refused"


def test_a_policy_can_do_without_maintenance_and_authorisation(empty):
    empty.with_pad().with_prekeys("k1")
    empty.call(empty.fleet, "RegisterUav", empty.uav_argument())
    policy = {"require_maintenance": False, "require_authorisation": False}
    full = empty.call(empty.mirror, "ReadPolicy", pad_id="pad-1", action="land") | policy
    empty.set_policy(full, "pad-1", "land")
    assert empty.submit(empty.request())["permission"] == "granted"
