from __future__ import annotations

import hashlib

import pytest

from wonderland.proofs import encoding


def test_a_pad_from_registration_to_retirement(empty):
    pad = empty.call(empty.operator, "RegisterPad", empty.pad_argument(note="north side"))
    assert (pad["msp_id"], pad["status"], pad["note"]) == ("PadMSP", "registered", "north side")
    assert pad["registered_ms"] == pad["updated_ms"] == empty.now_ms
    assert empty.events[-1] == (
        "PadRegistered",
        {"kind": "PadRegistered", "tx_id": empty.tx_id, "t_ms": empty.now_ms, "record": pad},
    )
    empty.now_ms += 5
    found = empty.commissioning()
    pad = empty.call(empty.operator, "CommissionPad", pad_id="pad-1", commissioning=found)
    assert pad["status"] == "commissioned"
    assert pad["commissioning_sha256"] == hashlib.sha256(encoding.encode(found)).hexdigest()
    assert (pad["lat_e7"], pad["lon_e7"], pad["height_mm"]) == (604_518_000, 222_666_000, 30_000)
    assert (pad["registered_ms"], pad["updated_ms"]) == (empty.now_ms - 5, empty.now_ms)
    assert empty.events[-1][0] == "PadCommissioned"
    pad = empty.call(empty.operator, "UpdatePad", pad_id="pad-1", name="Harbour roof")
    assert (pad["name"], pad["note"], pad["status"]) == ("Harbour roof", "north side", "commissioned")
    assert empty.call(empty.mirror, "ReadPad", pad_id="pad-1") == pad
    pad = empty.call(empty.admin, "RetirePad", pad_id="pad-1", reason="demolished")
    assert (pad["status"], pad["note"]) == ("retired", "demolished")
    assert [name for name, _ in empty.events] == ["PadRegistered", "PadCommissioned", "PadUpdated", "PadRetired"]


def test_a_session_names_the_site_plan_that_held_at_its_request(scene):
    one, two = "1" * 64, "2" * 64
    assert "site_plan_sha256" not in scene.request("k1")
    pad = scene.call(scene.operator, "SetSitePlan", pad_id="pad-1", site_plan_sha256=one)
    assert (pad["site_plan_sha256"], scene.events[-1][0]) == (one, "SitePlanSet")
    session = scene.request("k2")
    assert session["site_plan_sha256"] == one
    scene.call(scene.admin, "SetSitePlan", pad_id="pad-1", site_plan_sha256=two)
    assert scene.submit(session)["permission"] == "granted", "a new plan is no new survey"
    assert scene.call(scene.mirror, "ReadSession", session_id=session["session_id"])["site_plan_sha256"] == one
    assert "site_plan_sha256" not in scene.call(scene.operator, "SetSitePlan", pad_id="pad-1")


def test_who_may_set_which_site_plan(scene):
    plan = {"pad_id": "pad-1", "site_plan_sha256": "1" * 64}
    scene.refuse(403, "PAD_OF_OTHER_ORGANISATION", scene.other_operator, "SetSitePlan", plan)
    scene.refuse(403, "ROLE_NOT_ALLOWED", scene.uav, "SetSitePlan", plan)
    scene.refuse(400, "BAD_ARGUMENT", scene.operator, "SetSitePlan", {**plan, "site_plan_sha256": "A" * 64})
    scene.refuse(404, "PAD_UNKNOWN", scene.operator, "SetSitePlan", {**plan, "pad_id": "pad-9"})
    scene.refuse(409, "SITE_PLAN_UNCHANGED", scene.operator, "SetSitePlan", pad_id="pad-1")
    scene.call(scene.operator, "SetSitePlan", plan)
    scene.refuse(409, "SITE_PLAN_UNCHANGED", scene.operator, "SetSitePlan", plan)


def test_a_retired_pad_stays_retired(scene):
    scene.call(scene.operator, "RetirePad", pad_id="pad-1", reason="gone")
    for who, function, argument in (
        (scene.operator, "UpdatePad", {"pad_id": "pad-1", "name": "x"}),
        (scene.operator, "RetirePad", {"pad_id": "pad-1", "reason": "again"}),
        (scene.operator, "CommissionPad", {"pad_id": "pad-1", "commissioning": scene.commissioning()}),
        (scene.operator, "SetSitePlan", {"pad_id": "pad-1", "site_plan_sha256": "1" * 64}),
        (
            scene.pad,
            "PublishPrekeys",
            {"pad_id": "pad-1", "prekeys": [{"prekey_id": "n", "public_key": scene.point(5)}]},
        ),
        (scene.uav, "RequestProof", scene.request_argument()),
        (scene.admin, "GrantAuthorisation", scene.authorisation(authorisation_id="a2")),
        (scene.admin, "ProposePolicy", {"pad_id": "pad-1", "action": "*", "policy": {}}),
    ):
        scene.refuse(422, "PAD_RETIRED", who, function, argument)
    scene.refuse(409, "PAD_EXISTS", scene.operator, "RegisterPad", scene.pad_argument())


def test_pads_are_unique_and_known(empty):
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    empty.refuse(409, "PAD_EXISTS", empty.other_operator, "RegisterPad", empty.pad_argument())
    empty.refuse(404, "PAD_UNKNOWN", empty.operator, "UpdatePad", pad_id="pad-9", name="x")
    empty.refuse(404, "PAD_UNKNOWN", empty.mirror, "ReadPad", pad_id="pad-9")
    empty.refuse(404, "PAD_UNKNOWN", empty.mirror, "ListPrekeys", pad_id="pad-9")
    empty.refuse(400, "NOTHING_TO_CHANGE", empty.operator, "UpdatePad", pad_id="pad-1")


def test_another_organisations_pad_is_out_of_reach(scene):
    for function, more in (
        ("UpdatePad", {"name": "mine"}),
        ("RetirePad", {"reason": "envy"}),
        ("CommissionPad", {"commissioning": scene.commissioning()}),
    ):
        scene.refuse(403, "PAD_OF_OTHER_ORGANISATION", scene.other_operator, function, pad_id="pad-1", **more)
        scene.call(scene.admin, function, pad_id="pad-1", **more) if function != "RetirePad" else None


def test_a_commissioning_that_is_over_is_refused(empty):
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    over = empty.commissioning(valid_from_ms=1, valid_until_ms=empty.now_ms)
    empty.refuse(422, "COMMISSIONING_NOT_VALID", empty.operator, "CommissionPad", pad_id="pad-1", commissioning=over)


def test_prekeys_are_published_and_listed(empty):
    empty.with_pad()
    offered = [{"prekey_id": f"k{index}", "public_key": empty.point(50 + index)} for index in range(20)]
    assert empty.call(empty.pad, "PublishPrekeys", pad_id="pad-1", prekeys=offered) == {
        "pad_id": "pad-1",
        "published": 20,
    }
    assert empty.events[-1][1]["record"] == {"pad_id": "pad-1", "published": 20}
    listed = empty.call(empty.uav, "ListPrekeys", pad_id="pad-1")["prekeys"]
    assert len(listed) == 10  # the default
    assert empty.last is not None
    assert empty.last.reads == 11  # and no more work than that
    everything = empty.call(empty.uav, "ListPrekeys", pad_id="pad-1", limit=100)["prekeys"]
    assert {key["prekey_id"]: key["public_key"] for key in everything} == {
        key["prekey_id"]: key["public_key"] for key in offered
    }
    assert everything[0]["certificate_sha256"] == empty.pad.certificate_sha256
    assert everything[0]["msp_id"] == "PadMSP"


def test_a_pad_whose_name_begins_like_another_has_its_own_prekeys(empty):
    empty.with_pad()
    empty.call(empty.operator, "RegisterPad", empty.pad_argument("pad-10"))
    other = empty.person(empty.pad, pol_id="pad-10")
    empty.call(other, "PublishPrekeys", pad_id="pad-10", prekeys=[{"prekey_id": "x", "public_key": empty.point(3)}])
    assert empty.call(empty.mirror, "ListPrekeys", pad_id="pad-1") == {"prekeys": []}


def test_only_the_pad_itself_publishes_its_prekeys(empty):
    empty.with_pad()
    offered = [{"prekey_id": "k1", "public_key": empty.point(3)}]
    for who in (
        empty.other_pad,
        empty.person(empty.pad, msp_id="FleetMSP"),
        empty.person(empty.pad, pol_id=""),
        empty.person(empty.pad, pol_id="pad-1 "),
    ):
        empty.refuse(403, "NOT_THIS_PAD", who, "PublishPrekeys", pad_id="pad-1", prekeys=offered)


def test_a_prekey_is_published_once(scene):
    def offer(*pairs):
        return {"pad_id": "pad-1", "prekeys": [{"prekey_id": name, "public_key": key} for name, key in pairs]}

    one, two = scene.point(3), scene.point(4)
    scene.refuse(400, "PREKEY_TWICE", scene.pad, "PublishPrekeys", offer(("n", one), ("n", two)))
    scene.refuse(400, "PREKEY_TWICE", scene.pad, "PublishPrekeys", offer(("n", one), ("m", one)))
    scene.refuse(409, "PREKEY_EXISTS", scene.pad, "PublishPrekeys", offer(("n", one), ("k1", two)))
    scene.request("k1")
    scene.refuse(409, "PREKEY_USED", scene.pad, "PublishPrekeys", offer(("k1", two)))


@pytest.mark.parametrize("key", [b"\x04" + bytes(64), b"\x04" + b"\xff" * 64, b"\x02" + bytes(64), b"\x04" * 65])
def test_a_prekey_must_be_a_point_of_the_curve(empty, key):
    empty.with_pad()
    offered = [{"prekey_id": "k1", "public_key": encoding.to_base64url(key)}]
    error = empty.refuse(400, "KEY_NOT_ON_CURVE", empty.pad, "PublishPrekeys", pad_id="pad-1", prekeys=offered)
    assert "prekeys[0].public_key" in str(error)
