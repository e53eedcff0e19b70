"""Four eyes: whatever one person tries alone, nothing changes."""

from __future__ import annotations

import pytest

from wonderland.proofs.records.changes import LIFE_MS
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.transactions import ROLES

WIDE = Policy(buffer_mm=90_000).to_json()
DRONE = "1AB0000001"


@pytest.fixture
def proposed(scene):
    return scene.call(scene.admin, "ProposePolicy", pad_id="*", action="*", policy=WIDE, note="for the air show")


def buffer_mm(scene):
    return scene.call(scene.mirror, "ReadPolicy", pad_id="pad-1", action="land")["buffer_mm"]


def held(scene, before=1_000):
    """Nothing has changed."""
    assert buffer_mm(scene) == before


def test_the_very_first_policy_takes_two_people_too(scene, proposed):
    held(scene)
    assert proposed["state"] == "open"
    assert "replaces_sha256" not in proposed
    approved = scene.approve(proposed)
    assert buffer_mm(scene) == 90_000
    assert (approved["proposed_by"]["name"], approved["decided_by"]["name"]) == ("ada", "ines")
    assert scene.call(scene.mirror, "ReadChange", change_id=proposed["change_id"]) == approved
    assert scene.events[-1][1]["record"] == approved


def test_nobody_approves_what_they_proposed(scene, proposed):
    scene.refuse(403, "SAME_PERSON", scene.admin, "ApproveChange", scene.approval(proposed))
    # Enrolled anew, with another key and another role: the name is the person's.
    anew = scene.person(scene.admin, number=77, role="inspector")
    scene.refuse(403, "SAME_PERSON", anew, "ApproveChange", scene.approval(proposed))
    # Under another name, with the same key.
    alias = scene.person(scene.admin, common_name="another ada")
    scene.refuse(403, "SAME_KEY", alias, "ApproveChange", scene.approval(proposed))
    held(scene)


@pytest.mark.parametrize("role", sorted(set(ROLES) - {"admin", "inspector"}))
def test_only_the_authority_proposes_approves_and_withdraws(scene, proposed, role):
    who = scene.person(scene.inspector, common_name="x", role=role, number=5)
    for function, argument in (
        ("ProposePolicy", {"pad_id": "*", "action": "*", "policy": WIDE}),
        ("ProposeReinstatement", {"uav_id": DRONE, "reason": "x"}),
        ("ApproveChange", scene.approval(proposed)),
        ("WithdrawChange", {"change_id": proposed["change_id"], "reason": "x"}),
    ):
        scene.refuse(403, "ROLE_NOT_ALLOWED", who, function, argument)
    foreign = scene.person(scene.inspector, msp_id="PadMSP")
    scene.refuse(403, "ROLE_OF_OTHER_ORGANISATION", foreign, "ApproveChange", scene.approval(proposed))
    held(scene)


def test_an_inspector_approves_a_policy_and_proposes_none(scene):
    ask = {"pad_id": "*", "action": "*", "policy": WIDE}
    scene.refuse(403, "ROLE_NOT_ALLOWED", scene.inspector, "ProposePolicy", ask)


def test_what_is_approved_is_what_was_proposed(scene, proposed):
    """The second person signs the content itself: a server cannot show one thing and have another one approved."""
    approval = scene.approval(proposed)
    other = approval | {"policy": approval["policy"] | {"policy": Policy(buffer_mm=2_000).to_json()}}
    scene.refuse(409, "CHANGE_NOT_AS_PROPOSED", scene.inspector, "ApproveChange", other)
    elsewhere = approval | {"policy": approval["policy"] | {"pad_id": "pad-1"}}
    scene.refuse(409, "CHANGE_NOT_AS_PROPOSED", scene.inspector, "ApproveChange", elsewhere)
    lifted = {"change_id": proposed["change_id"], "reinstatement": {"uav_id": DRONE, "reason": "x"}}
    scene.refuse(409, "CHANGE_NOT_AS_PROPOSED", scene.inspector, "ApproveChange", lifted)
    scene.refuse(400, "BAD_ARGUMENT", scene.inspector, "ApproveChange", approval | lifted)
    scene.refuse(400, "BAD_ARGUMENT", scene.inspector, "ApproveChange", change_id=proposed["change_id"])
    held(scene)


def test_what_was_changed_meanwhile_is_not_overwritten(scene, proposed):
    other = scene.call(scene.admin, "ProposePolicy", pad_id="*", action="*", policy=Policy(buffer_mm=2_000).to_json())
    scene.approve(other)
    scene.refuse(409, "CHANGE_OVERTAKEN", scene.inspector, "ApproveChange", scene.approval(proposed))
    held(scene, 2_000)


def test_a_proposal_has_its_time(scene, proposed):
    scene.now_ms += LIFE_MS - 1
    late = scene.call(scene.admin, "ProposePolicy", pad_id="*", action="land", policy=WIDE)
    assert late["expires_ms"] == scene.now_ms + LIFE_MS
    scene.now_ms += 1
    scene.refuse(422, "CHANGE_EXPIRED", scene.inspector, "ApproveChange", scene.approval(proposed))
    held(scene)


@pytest.mark.parametrize("by", ["admin", "inspector"])
def test_withdrawn_is_withdrawn(scene, proposed, by):
    done = scene.call(getattr(scene, by), "WithdrawChange", change_id=proposed["change_id"], reason="too wide")
    assert (done["state"], done["decided_by"]["name"], done["decided_note"]) == (
        "withdrawn",
        getattr(scene, by).common_name,
        "too wide",
    )
    scene.refuse(422, "CHANGE_DECIDED", scene.inspector, "ApproveChange", scene.approval(proposed))
    again = {"change_id": proposed["change_id"], "reason": "x"}
    scene.refuse(422, "CHANGE_DECIDED", scene.inspector, "WithdrawChange", again)
    held(scene)


def test_approved_once_is_not_approved_twice(scene, proposed):
    scene.approve(proposed)
    scene.set_policy(Policy(buffer_mm=2_000).to_json())
    scene.refuse(422, "CHANGE_DECIDED", scene.inspector, "ApproveChange", scene.approval(proposed))
    held(scene, 2_000)


def test_a_policy_that_became_impossible_is_not_approved(scene):
    proposed = scene.call(scene.admin, "ProposePolicy", pad_id="pad-1", action="land", policy=WIDE)
    scene.call(scene.operator, "RetirePad", pad_id="pad-1", reason="sold")
    scene.refuse(422, "PAD_RETIRED", scene.inspector, "ApproveChange", scene.approval(proposed))


def test_nobody_has_proposed_it(scene):
    scene.refuse(404, "CHANGE_UNKNOWN", scene.mirror, "ReadChange", change_id="0" * 64)
    reinstated = {"change_id": "0" * 64, "reinstatement": {"uav_id": DRONE, "reason": "x"}}
    scene.refuse(404, "CHANGE_UNKNOWN", scene.inspector, "ApproveChange", reinstated)


def test_a_suspension_is_lifted_by_two(scene):
    def status():
        return scene.call(scene.mirror, "ReadUav", uav_id=DRONE)["status"]

    ask = {"uav_id": DRONE, "reason": "inspected"}
    scene.refuse(422, "UAV_NOT_SUSPENDED", scene.admin, "ProposeReinstatement", ask)
    scene.call(scene.inspector, "SetUavStatus", uav_id=DRONE, status="suspended", reason="lied")
    for alone in (scene.admin, scene.inspector):
        scene.refuse(403, "TWO_PEOPLE_NEEDED", alone, "SetUavStatus", uav_id=DRONE, status="active", reason="x")
    proposed = scene.call(scene.inspector, "ProposeReinstatement", ask)
    scene.refuse(403, "SAME_PERSON", scene.inspector, "ApproveChange", scene.approval(proposed))
    assert status() == "suspended"
    # Suspended once more, for what the proposal did not know of.
    scene.call(scene.admin, "SetUavStatus", uav_id=DRONE, status="suspended", reason="lied again")
    scene.refuse(409, "CHANGE_OVERTAKEN", scene.admin, "ApproveChange", scene.approval(proposed))
    proposed = scene.call(scene.inspector, "ProposeReinstatement", ask)
    scene.approve(proposed, scene.admin)
    assert status() == "active"
    assert scene.call(scene.mirror, "ReadUav", uav_id=DRONE)["status_reason"] == "inspected"


def test_a_retired_drone_does_not_come_back(scene):
    scene.call(scene.inspector, "SetUavStatus", uav_id=DRONE, status="suspended", reason="lied")
    proposed = scene.call(scene.admin, "ProposeReinstatement", uav_id=DRONE, reason="x")
    scene.call(scene.fleet, "SetUavStatus", uav_id=DRONE, status="retired", reason="sold")
    scene.refuse(409, "CHANGE_OVERTAKEN", scene.inspector, "ApproveChange", scene.approval(proposed))
