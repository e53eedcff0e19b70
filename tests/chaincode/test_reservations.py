"""Whom a pad is kept for: what the contract lets whom reserve, and that nobody's lie drops another's reservation."""

from __future__ import annotations

import pytest

from wonderland.proofs.records.reservations import EACH

MINUTE_MS = 60_000


@pytest.fixture
def scene(scene):
    scene.set_policy({"reservation_ms": 20 * MINUTE_MS})
    return scene


def span(scene, begin_min=10, minutes=15, uav_id="1AB0000001"):
    from_ms = scene.now_ms + begin_min * MINUTE_MS
    return {"pad_id": "pad-1", "uav_id": uav_id, "from_ms": from_ms, "until_ms": from_ms + minutes * MINUTE_MS}


@pytest.mark.parametrize("who", ["uav", "fleet", "admin"])
def test_a_drone_its_operator_and_the_authority_reserve_and_give_up(scene, who):
    person = getattr(scene, who)
    kept = scene.call(person, "ReservePad", span(scene))
    (made,) = kept["reservations"]
    assert (made["uav_id"], made["reserved_by"]) == ("1AB0000001", person.common_name)
    assert scene.events[-1][0] == "PadReserved"
    assert scene.call(scene.mirror, "ReadReservations", pad_id="pad-1") == kept
    gone = {"pad_id": "pad-1", "reservation_id": made["reservation_id"]}
    assert scene.call(person, "CancelReservation", gone) == {"pad_id": "pad-1", "reservations": []}
    scene.refuse(404, "RESERVATION_UNKNOWN", person, "CancelReservation", gone)


def test_the_pads_operator_takes_a_reservation_and_makes_none(scene):
    (made,) = scene.call(scene.fleet, "ReservePad", span(scene))["reservations"]
    scene.refuse(403, "ROLE_NOT_ALLOWED", scene.operator, "ReservePad", span(scene, 60))
    gone = {"pad_id": "pad-1", "reservation_id": made["reservation_id"], "note": "works on the pad"}
    assert scene.call(scene.operator, "CancelReservation", gone)["reservations"] == []


def test_nobody_reserves_or_cancels_for_anothers_drone(scene):
    (made,) = scene.call(scene.fleet, "ReservePad", span(scene))["reservations"]
    gone = {"pad_id": "pad-1", "reservation_id": made["reservation_id"]}
    for other in (scene.other_fleet, scene.other_uav):
        code = "NOT_THIS_UAV" if other.role == "uav" else "UAV_OF_OTHER_ORGANISATION"
        scene.refuse(403, code, other, "ReservePad", span(scene, 60))
        scene.refuse(403, code, other, "CancelReservation", gone)
    scene.refuse(403, "PAD_OF_OTHER_ORGANISATION", scene.other_operator, "CancelReservation", gone)


def test_two_are_not_kept_at_one_time_and_no_time_is_kept_for_long(scene):
    scene.call(scene.fleet, "ReservePad", span(scene))
    assert "1AB0000001" in str(scene.refuse(409, "PAD_RESERVED", scene.fleet, "ReservePad", span(scene, 24)))
    scene.call(scene.fleet, "ReservePad", span(scene, 25))  # right after it
    scene.refuse(422, "RESERVATION_TOO_LONG", scene.fleet, "ReservePad", span(scene, 60, 21))
    scene.refuse(422, "RESERVATION_NOT_SOON", scene.fleet, "ReservePad", span(scene, -15))
    scene.refuse(422, "RESERVATION_NOT_SOON", scene.fleet, "ReservePad", span(scene, 7 * 1440 + 1))
    scene.refuse(400, "BAD_ARGUMENT", scene.fleet, "ReservePad", span(scene, 60, 0))


def test_where_no_policy_allows_it_no_pad_is_kept(scene):
    scene.set_policy({})
    scene.refuse(422, "NO_RESERVATIONS", scene.fleet, "ReservePad", span(scene))


def test_no_pad_is_kept_for_a_suspended_drone(scene):
    scene.call(scene.admin, "SetUavStatus", uav_id="1AB0000001", status="suspended", reason="an inspection")
    scene.refuse(422, "UAV_NOT_ACTIVE", scene.fleet, "ReservePad", span(scene))


def test_an_organisation_has_three_and_a_lie_about_the_time_drops_only_its_own(scene):
    greedy = scene.other_fleet
    scene.call(greedy, "RegisterUav", scene.uav_argument("1AB0000002"))
    scene.call(scene.fleet, "ReservePad", span(scene))
    for number in range(EACH):
        scene.call(greedy, "ReservePad", span(scene, 60 + 20 * number, uav_id="1AB0000002"))
    scene.refuse(422, "TOO_MANY_RESERVATIONS", greedy, "ReservePad", span(scene, 300, uav_id="1AB0000002"))
    # It says that it is tomorrow, when all of these are over.
    scene.now_ms += 86_400_000
    kept = scene.call(greedy, "ReservePad", span(scene, 1, uav_id="1AB0000002"))["reservations"]
    assert [each["uav_id"] for each in kept].count("1AB0000001") == 1
    assert [each["uav_id"] for each in kept].count("1AB0000002") == EACH
