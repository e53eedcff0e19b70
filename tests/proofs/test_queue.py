"""The order of a pad's queue, by what is on the ledger alone: fair, and not to be had by a lie."""

from __future__ import annotations

import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from kit.proof_world import World

from wonderland.proofs.queue import CLAIMS_PER_HOUR, COMPLETION_MS, HOUR_MS, queue_of
from wonderland.proofs.queue_book import QueueBook
from wonderland.proofs.records.reservations import Reservation, Reservations
from wonderland.proofs.records.sessions import Departure, Party, Precedence

NOW = World().start_ms + 5_000
_BASE = World().session(World().claim((0, 0, 3_000), NOW))


def asks(number, msp="FleetMSP", uav_id="", **more):
    policy = replace(_BASE.policy, occupied_ms=more.pop("occupied_ms", 600_000))
    party = Party(msp_id=msp, certificate_sha256="0" * 64)
    fields = {"requested_ms": NOW - 1_000, "expires_ms": NOW + 50_000} | more
    return replace(
        _BASE, session_id=f"{number:064x}", uav_id=uav_id or f"uav-{number}", uav=party, policy=policy, **fields
    )


def lands(number, **more):
    return asks(number, **({"state": "completed", "end": "done", "ended_ms": NOW - 500, "ended_by": "uav"} | more))


def kept(uav_id="uav-9", from_ms=NOW, until_ms=NOW + 600_000, msp="FleetMSP"):
    who = {"uav_id": uav_id, "msp_id": msp, "reserved_by": "Ada", "reserved_ms": NOW}
    return Reservation(reservation_id="a" * 64, from_ms=from_ms, until_ms=until_ms, **who)


def order(sessions, now_ms=NOW, permitted=(), reservations=()):
    queue = queue_of(sessions, permitted, now_ms, reservations)
    return [int(place.session.session_id, 16) for place in queue.places]


def test_as_they_came_whatever_their_clocks_say():
    assert order([asks(1), asks(2, requested_ms=NOW - 3_600_000), asks(3)]) == [1, 2, 3]


def test_precedence_then_emergencies_then_low_batteries():
    first = Precedence(by="operator", name="Ada", reason="a patient", t_ms=NOW)
    waiting = [
        asks(1),
        asks(2, priority="low_battery", battery_percent=9),
        asks(3, priority="emergency"),
        asks(4, precedence=first),
    ]
    queue = queue_of(waiting, (), NOW)
    assert [place.rank for place in queue.places] == ["precedence", "emergency", "low_battery", "normal"]
    assert [queue.passed_over(f"{number:064x}") for number in (1, 2, 3, 4)] == [0, 1, 2, 3]
    assert next(place.at_most_ms for place in queue.places) == 0


def test_thirty_drones_of_one_organisation_keep_nobody_waiting():
    flood = [asks(number, msp="GreedyMSP") for number in range(1, 31)]
    assert order([*flood, asks(31)])[1] == 31


def test_a_liar_is_first_six_times_an_hour_and_then_like_all_others():
    lies = [
        asks(number, msp="GreedyMSP", priority="emergency", state="cancelled", end="no_reply", ended_ms=NOW - 900)
        for number in range(1, CLAIMS_PER_HOUR + 1)
    ]
    waiting = [*lies, asks(20), asks(21, msp="GreedyMSP", priority="emergency")]
    queue = queue_of(waiting, (), NOW)
    assert order(waiting) == [20, 21]
    assert [place.claim_ignored for place in queue.places] == [False, True]
    # Somebody else's emergency still counts, and the liar's next one an hour later.
    assert order([*waiting, asks(22, msp="OtherMSP", priority="emergency")])[0] == 22
    later = [replace(each, requested_ms=NOW - HOUR_MS - 1) for each in lies]
    assert order([*later, *waiting[-2:]]) == [21, 20]


def test_who_waited_too_long_and_asks_again_keeps_its_place():
    told = {"state": "cancelled", "end": "queue_timeout", "ended_by": "pad", "ended_ms": NOW - 1_500}
    assert order([asks(1, uav_id="a", **told), asks(2), asks(3, uav_id="a")]) == [3, 2]
    # Not by its own word, not much later, not as another drone, not after a refusal.
    assert order([asks(1, uav_id="a", **(told | {"ended_by": "uav"})), asks(2), asks(3, uav_id="a")]) == [2, 3]
    late = told | {"ended_ms": NOW - 60_000}
    assert order([asks(1, uav_id="a", **late), asks(2), asks(3, uav_id="a")]) == [2, 3]
    assert order([asks(1, uav_id="a", **told), asks(2), asks(3, uav_id="b")]) == [2, 3]
    assert order([asks(1, uav_id="a", **(told | {"end": "no_reply"})), asks(2), asks(3, uav_id="a")]) == [2, 3]


def test_a_drone_on_the_pad_keeps_others_out_until_it_leaves():
    here = lands(1, uav_id="a")
    blocked = queue_of([here, asks(2)], (), NOW)
    assert blocked.occupant is not None
    assert blocked.occupant.session.uav_id == "a"
    (place,) = blocked.places
    assert (place.blocked_by, place.at_most_ms) == ("a", 600_000 - 500)
    # Its own take-off comes before everything, an emergency included: nothing else frees the pad.
    leaves = asks(3, uav_id="a", action="takeoff")
    assert order([here, asks(2, priority="emergency"), leaves]) == [3, 2]
    for free in (
        [here, lands(3, uav_id="a", action="takeoff", ended_ms=NOW - 100), asks(2)],
        [replace(here, departure=Departure(by="operator", name="Ada", t_ms=NOW)), asks(2)],
        [replace(here, ended_ms=NOW - 600_000), asks(2)],
        [lands(1, occupied_ms=None), asks(2)],
        [lands(1, end="aborted"), asks(2)],
    ):
        assert queue_of(free, (), NOW).places[0].blocked_by == ""
    # Somebody else's take-off does not free it.
    assert queue_of([here, lands(3, uav_id="b", action="takeoff"), asks(2)], (), NOW).places[0].blocked_by == "a"


def test_a_permission_has_the_pad_to_itself_until_it_lapses():
    granted = asks(1, state="decided", decided_ms=NOW - 500, occupied_ms=None)
    sid = granted.session_id
    assert queue_of([granted, asks(2), asks(3, action="takeoff")], {sid}, NOW).places[1].blocked_by == "uav-1"
    assert queue_of([granted, asks(2)], (), NOW).places[0].blocked_by == ""
    later = replace(asks(2), expires_ms=NOW + 100_000)
    assert queue_of([granted, later], {sid}, NOW + 61_500).places[0].blocked_by == ""


def test_a_reservation_goes_before_all_but_emergencies_and_keeps_landings_waiting():
    waiting = [
        asks(1),
        asks(2, priority="low_battery", battery_percent=9),
        asks(3, priority="emergency"),
        asks(4, action="takeoff"),
        asks(9),
    ]
    queue = queue_of(waiting, (), NOW, [kept()])
    assert [int(place.session.session_id, 16) for place in queue.places] == [3, 9, 2, 1, 4]
    assert [place.rank for place in queue.places] == ["emergency", "reserved", "low_battery", "normal", "normal"]
    assert [(place.blocked_by, place.kept) for place in queue.places] == [
        ("", False),
        ("", False),
        ("uav-9", True),
        ("uav-9", True),
        ("", False),
    ]
    assert queue.places[2].at_most_ms >= 600_000


def test_a_pad_is_kept_from_so_long_before_that_who_is_served_then_is_done():
    one = asks(1)
    before_ms = one.policy.session_ttl_ms + COMPLETION_MS

    def blocked(from_ms, **more):
        return queue_of([one], (), NOW, [kept(from_ms=from_ms, **more)]).places[0].blocked_by

    assert blocked(NOW + before_ms) == "uav-9"
    assert blocked(NOW + before_ms + 1) == ""
    assert blocked(NOW - 600_000, until_ms=NOW) == ""
    assert blocked(NOW, uav_id="uav-1") == "", "it is its own"
    assert queue_of([one], (), NOW, [kept(from_ms=NOW - 9, until_ms=NOW)]).reservations == ()


def test_a_reservation_is_used_up_by_its_drones_landing_and_by_nothing_else():
    def blocked(session):
        return queue_of([session, asks(2)], (), NOW, [kept(from_ms=NOW - 60_000)]).places[0].blocked_by

    free = {"uav_id": "uav-9", "occupied_ms": None}
    assert blocked(lands(1, **free)) == ""
    assert blocked(lands(1, **free, end="aborted")) == "uav-9"
    assert blocked(lands(1, **free, action="takeoff")) == "uav-9"
    assert blocked(lands(1, **free, ended_ms=NOW - 600_000)) == "uav-9", "long before"
    assert blocked(lands(1, uav_id="uav-8", occupied_ms=None)) == "uav-9"


def test_a_reservation_is_its_organisations_drones():
    assert queue_of([asks(9, msp="OtherMSP")], (), NOW, [kept()]).places[0].rank == "normal"


def test_a_book_knows_reservations_by_their_events():
    book = QueueBook("pad-1")
    book.take("ProofRequested", asks(1).to_json())
    for pad_id, reservations, blocked_by in (
        ("pad-2", (kept(),), ""),
        ("pad-1", (kept(),), "uav-9"),
        ("pad-1", (), ""),
    ):
        book.take("PadReserved", Reservations(pad_id=pad_id, reservations=reservations).to_json())
        assert book.queue(NOW).places[0].blocked_by == blocked_by


@given(st.integers(0, 2**32))
def test_every_order_of_events_and_every_repetition_ends_in_the_same_queue(seed):
    rng = random.Random(seed)
    sessions = [
        asks(
            number, msp=rng.choice(["AMSP", "BMSP"]), priority=rng.choice([None, "emergency"]), uav_id=f"d{number % 4}"
        )
        for number in range(8)
    ]
    ended = [lands(number, uav_id=f"d{number % 4}") for number in range(3)]
    events = [("ProofRequested", each.to_json()) for each in sessions]
    events += [("InteractionCompleted", each.to_json()) for each in ended]
    book, twice = QueueBook("pad-1"), QueueBook("pad-1")
    for name, record in events:
        book.take(name, record)
    cut = rng.randrange(len(events))
    for name, record in [*events[:cut], *events[: rng.randrange(cut + 1)], *events[cut:], *events]:
        twice.take(name, record)
    assert book.queue(NOW) == twice.queue(NOW)
    assert {place.session.session_id for place in book.queue(NOW).places} == {s.session_id for s in sessions[3:]}
