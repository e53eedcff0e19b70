"""A drone reports that it came down without a permission: its own word, of itself alone, and nothing changes by it."""

from __future__ import annotations

import pytest

DAY_MS = 86_400_000


def landed(scene, **more):
    return {"pad_id": "pad-1", "cause": "pilot", "claim": scene.claim()} | more


def test_it_is_in_the_event_and_changes_no_record(scene):
    before = dict(scene.state)
    told = scene.call(scene.uav, "ReportLanding", landed(scene, cause="failsafe"))
    name, event = scene.events[-1]
    assert (name, event["record"]) == ("LandingReported", told)
    assert (told["uav_id"], told["pad_id"], told["cause"]) == (scene.uav.pol_id, "pad-1", "failsafe")
    assert told["reported_ms"] == scene.now_ms
    assert scene.state == before


def test_who_may_not(scene):
    for who in (scene.pad, scene.admin, scene.fleet, scene.operator):
        scene.refuse(403, "ROLE_NOT_ALLOWED", who, "ReportLanding", landed(scene))
    scene.refuse(404, "PAD_UNKNOWN", scene.uav, "ReportLanding", landed(scene, pad_id="pad-9"))
    scene.refuse(400, "BAD_ARGUMENT", scene.uav, "ReportLanding", landed(scene, cause="crash"))
    scene.refuse(400, "BAD_ARGUMENT", scene.uav, "ReportLanding", landed(scene, uav_id="1AB0000009"))


@pytest.mark.parametrize("off_ms", [-DAY_MS - 1, 60_001])
def test_neither_long_ago_nor_in_the_future(scene, off_ms):
    claim = scene.claim() | {"t_ms": scene.now_ms + off_ms}
    scene.refuse(422, "LANDING_TIME", scene.uav, "ReportLanding", landed(scene, claim=claim))
