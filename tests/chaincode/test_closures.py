from __future__ import annotations

import pytest

from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.closures import MAX_CLOSURES

HOUR = 3_600_000


def closure(scene, zone_id="FIN:P1", start=-HOUR, end=HOUR, actions=("land",)):
    return {
        "zone_id": zone_id, "actions": list(actions), "from_ms": scene.now_ms + start, "until_ms": scene.now_ms + end,
    }  # fmt: skip


def close(scene, *closures, valid_ms=HOUR, who=None):
    argument = {"pad_id": "pad-1", "closures": list(closures), "valid_until_ms": scene.now_ms + valid_ms}
    return scene.call(who or scene.admin, "SetClosures", argument)


def papers(verdict):
    codes = [each["code"] for each in verdict["reasons"]]
    return [code for code in codes if code.startswith(("zone_", "closures_", "not_auth"))]


def test_an_active_zone_refuses_the_landing_and_leaves_the_proof_alone(scene):
    set_ = close(scene, closure(scene), closure(scene, "FIN:P2"), closure(scene, "FIN:P3", start=HOUR // 2))
    assert scene.events[-1] == ("ClosuresSet", scene.events[-1][1])
    assert scene.events[-1][1]["record"] == set_
    assert set_["set_by"] == "ada"
    verdict = scene.submit(scene.request())
    assert (verdict["outcome"], verdict["authorised"], verdict["permission"]) == ("verified", False, "refused")
    named = [each["facts"]["zone_id"] for each in verdict["reasons"] if each["code"] == "zone_active"]
    assert named == ["FIN:P1", "FIN:P2"]


@pytest.mark.parametrize(
    ("more", "granted"),
    [
        ({"actions": ("takeoff", "dock")}, True),
        ({"start": -2 * HOUR, "end": -1}, True),
        ({"start": 5 * 60_000, "end": HOUR}, True),
        ({"start": 30_000, "end": HOUR}, False),  # it begins before the permission would expire
        ({"start": -HOUR, "end": 1 + 5_000}, False),
        ({"actions": ("land", "dock")}, False),
    ],
)
def test_when_and_for_what_a_closure_counts(scene, more, granted):
    close(scene, closure(scene, **more))
    verdict = scene.submit(scene.request())
    assert verdict["permission"] == ("granted" if granted else "refused")
    assert papers(verdict) == ([] if granted else ["zone_active"])


def test_closures_that_are_out_of_date_permit_nothing(scene):
    close(scene, valid_ms=30_000)
    verdict = scene.submit(scene.request())
    assert verdict["permission"] == "refused"
    assert papers(verdict) == ["closures_outdated"]
    close(scene, valid_ms=HOUR)
    assert scene.submit(scene.request("k2"))["permission"] == "granted"


def test_a_pad_that_never_had_closures_is_unaffected(scene):
    scene.refuse(404, "CLOSURES_UNKNOWN", scene.mirror, "ReadClosures", pad_id="pad-1")
    assert papers(scene.submit(scene.request())) == []


def test_who_may_set_them_and_what_is_refused(scene):
    for who in (scene.inspector, scene.operator, scene.pad, scene.mirror, scene.fleet):
        scene.refuse(403, "ROLE_NOT_ALLOWED", who, "SetClosures", pad_id="pad-1", closures=[], valid_until_ms=1)
    later = scene.now_ms + HOUR
    for code, status, more in (
        ("PAD_UNKNOWN", 404, {"pad_id": "nowhere"}),
        ("CLOSURES_OUTDATED", 422, {"valid_until_ms": scene.now_ms}),
        ("BAD_ARGUMENT", 400, {"closures": [closure(scene, end=-HOUR)]}),
        ("BAD_ARGUMENT", 400, {"closures": [closure(scene, "FI:1")]}),
        ("BAD_ARGUMENT", 400, {"closures": [closure(scene, actions=())]}),
        ("BAD_ARGUMENT", 400, {"closures": [closure(scene)] * (MAX_CLOSURES + 1)}),
    ):
        argument = {"pad_id": "pad-1", "closures": [], "valid_until_ms": later} | more
        scene.refuse(status, code, scene.admin, "SetClosures", argument)
    assert close(scene) == scene.call(scene.mirror, "ReadClosures", pad_id="pad-1")


def test_a_verdict_names_no_more_zones_than_it_has_room_for(scene):
    close(scene, *(closure(scene, f"FIN:P{number:03}") for number in range(MAX_CLOSURES)))
    stored = scene.state[keys.composite(keys.CLOSURES, "pad-1")]
    assert len(stored) < 64_000
    verdict = scene.submit(scene.request())
    assert papers(verdict) == ["zone_active"] * 8
    assert len(encoding.encode(verdict)) < 16_000
