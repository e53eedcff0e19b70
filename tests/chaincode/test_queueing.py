"""Who goes first, and who has left: what the contract lets whom say of a session."""

from __future__ import annotations

import pytest


def landed(scene):
    session = scene.request()
    scene.submit(session)
    return scene.call(scene.uav, "CompleteInteraction", session_id=session["session_id"], result="done")


def test_what_a_drone_signs_stands_in_its_session(scene):
    session = scene.request(priority="low_battery", battery_percent=12)
    assert (session["priority"], session["battery_percent"]) == ("low_battery", 12)
    assert "priority" not in scene.request("k2")


def test_a_low_battery_has_a_figure(scene):
    argument = scene.request_argument(priority="low_battery")
    assert "battery_percent" in str(scene.refuse(400, "BAD_ARGUMENT", scene.uav, "RequestProof", argument))
    scene.refuse(400, "BAD_ARGUMENT", scene.uav, "RequestProof", scene.request_argument(priority="first_please"))


@pytest.mark.parametrize(("who", "by"), [("operator", "operator"), ("admin", "authority")])
def test_an_operator_and_the_authority_put_first_and_say_why(scene, who, by):
    session = scene.request()
    person = getattr(scene, who)
    put = scene.call(person, "GivePrecedence", session_id=session["session_id"], reason="a patient on board")
    given = {"by": by, "name": person.common_name, "reason": "a patient on board", "t_ms": scene.now_ms}
    assert put == session | {"precedence": given}
    assert scene.events[-1][0] == "PrecedenceGiven"
    again = {"session_id": session["session_id"], "reason": "again"}
    scene.refuse(409, "PRECEDENCE_GIVEN", person, "GivePrecedence", again)


def test_a_pad_puts_first_only_an_emergency(scene):
    calm = scene.request()
    scene.refuse(403, "NO_EMERGENCY", scene.pad, "GivePrecedence", session_id=calm["session_id"], reason="friend")
    urgent = scene.request("k2", priority="emergency")
    put = scene.call(scene.pad, "GivePrecedence", session_id=urgent["session_id"], reason="emergency")
    assert put["precedence"]["by"] == "pad"


def test_who_does_not_wait_is_not_put_first(scene):
    session = scene.request()
    scene.now_ms = session["expires_ms"]
    argument = {"session_id": session["session_id"], "reason": "late"}
    scene.refuse(422, "NOT_WAITING", scene.admin, "GivePrecedence", argument)
    for who in (scene.uav, scene.fleet, scene.mirror):
        scene.refuse(403, "ROLE_NOT_ALLOWED", who, "GivePrecedence", argument)


@pytest.mark.parametrize(("who", "by"), [("pad", "pad"), ("operator", "operator"), ("admin", "authority")])
def test_a_departure_is_recorded_once(scene, who, by):
    session = landed(scene)
    person = getattr(scene, who)
    left = scene.call(person, "RecordDeparture", session_id=session["session_id"], note="carried away")
    assert (left["departure"]["by"], left["departure"]["note"]) == (by, "carried away")
    assert (left["state"], left["end"]) == ("completed", "done")
    scene.refuse(409, "DEPARTED", person, "RecordDeparture", session_id=session["session_id"])


def test_a_drone_does_not_say_itself_that_it_has_left(scene):
    session = landed(scene)
    scene.refuse(403, "ROLE_NOT_ALLOWED", scene.uav, "RecordDeparture", session_id=session["session_id"])


def test_only_who_landed_departs(scene):
    session = scene.request()
    sid = session["session_id"]
    scene.refuse(422, "NOT_LANDED", scene.pad, "RecordDeparture", session_id=sid)
    scene.submit(session)
    scene.refuse(422, "NOT_LANDED", scene.pad, "RecordDeparture", session_id=sid)
    scene.call(scene.uav, "CompleteInteraction", session_id=sid, result="aborted")
    scene.refuse(422, "NOT_LANDED", scene.pad, "RecordDeparture", session_id=sid)


def test_an_operator_turns_a_drone_away_and_says_why(scene):
    session = scene.request()
    argument = {"session_id": session["session_id"], "reason": "turned_away"}
    scene.refuse(400, "REASON_MISSING", scene.operator, "CancelProof", argument)
    ended = scene.call(scene.operator, "CancelProof", argument | {"note": "the pad is being cleaned"})
    assert (ended["state"], ended["end"], ended["note"]) == ("cancelled", "turned_away", "the pad is being cleaned")
    assert ended["ended_by"] == "operator"
