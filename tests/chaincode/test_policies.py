from __future__ import annotations

from wonderland.proofs.records.policies import Policy


def test_the_most_specific_policy_holds(scene):
    def asked(pad_id="pad-1", action="land"):
        return scene.call(scene.mirror, "ReadPolicy", pad_id=pad_id, action=action)["buffer_mm"]

    assert scene.call(scene.mirror, "ReadPolicy", pad_id="pad-1", action="land") == Policy().to_json()
    for scope, buffer_mm in (
        (("*", "*"), 2_000),
        (("*", "land"), 3_000),
        (("pad-1", "*"), 4_000),
        (("pad-1", "land"), 5_000),
    ):
        policy = Policy(buffer_mm=buffer_mm).to_json()
        before = asked()
        wanted = {"pad_id": scope[0], "action": scope[1], "policy": policy}
        proposed = scene.call(scene.admin, "ProposePolicy", wanted)
        assert (proposed["policy"], asked()) == (wanted, before)
        scene.approve(proposed)
        assert asked() == buffer_mm
        name, payload = scene.events[-1]
        assert (name, payload["record"]["policy"]) == ("ChangeApproved", wanted)
    assert asked(action="dock") == 4_000
    assert asked(pad_id="elsewhere") == 3_000
    assert asked(pad_id="elsewhere", action="dock") == 2_000


def test_a_session_keeps_the_policy_of_its_request(scene):
    session = scene.request()
    scene.set_policy(Policy(min_assurance=3).to_json())
    assert session["policy"] == Policy().to_json()
    assert scene.submit(session)["permission"] == "granted"


def test_a_policy_names_a_pad_that_exists(scene):
    scene.refuse(404, "PAD_UNKNOWN", scene.admin, "ProposePolicy", pad_id="nowhere", action="*", policy={})


def test_a_policy_that_no_session_could_fulfil_is_refused(scene):
    ask = {"pad_id": "*", "action": "*", "policy": Policy(min_assurance=4).to_json()}
    scene.refuse(422, "WITNESS_MISSING", scene.admin, "ProposePolicy", **ask)
    ask = {"pad_id": "pad-1", "action": "*", "policy": Policy(witness_pad_id="pad-1").to_json()}
    scene.refuse(422, "WITNESS_IS_PAD", scene.admin, "ProposePolicy", **ask)
