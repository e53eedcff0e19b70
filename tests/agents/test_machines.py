"""Both machines of a proof in virtual time: the eight steps, and every way in which they can be broken off."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import STEP_NAMES, Evidence
from wonderland_edge_agent.session import actions as pad_do
from wonderland_edge_agent.session import events as pad_on
from wonderland_edge_agent.session.machine import Phase as PadPhase
from wonderland_uav_agent.session import actions as uav_do
from wonderland_uav_agent.session import events as uav_on
from wonderland_uav_agent.session.machine import Phase as UavPhase


def test_eight_steps_in_order_each_with_its_time(make_duo):
    duo = make_duo()
    duo.run()
    assert duo.verdict.outcome == "verified"
    assert (duo.ledger_state, duo.ledger_end) == ("completed", "done")
    assert duo.failures() == []
    reached = [action.step for action in duo.of(duo.pad_actions, pad_do.ReportStep)]
    assert reached == list(STEP_NAMES)
    times = list(duo.pad.evidence.steps.values())
    assert times == sorted(times)
    assert [step.step for step in duo.evidence.steps] == list(STEP_NAMES[:6])
    assert list(duo.uav.steps) == ["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
    assert Evidence.parse(duo.evidence.to_json()) == duo.evidence


def test_an_honest_hovering_drone_is_settled_at_the_first_look(make_duo):
    duo = make_duo()
    duo.run()
    assert len(duo.evidence.ranges.t_ms) == 10
    assert duo.now_ms - duo.START_MS < 1_500


def test_permission_is_given_after_the_committed_verdict_and_not_before(make_duo):
    duo = make_duo()
    duo.ledger_away = True
    seen = []
    duo.on(lambda d: d.now_ms > d.START_MS + 20_000, lambda d: seen.append((list(d.pad_actions), list(d.uav_actions))))
    duo.on(lambda d: d.now_ms > d.START_MS + 20_005, lambda d: d._decide(d.evidence))
    duo.run()
    pad_before, uav_before = seen[0]
    assert duo.of(pad_before, pad_do.Submit)
    assert not duo.of(pad_before, pad_do.Permit)
    assert not duo.of(uav_before, uav_do.Act)
    assert duo.of(duo.pad_actions, pad_do.Permit)
    assert duo.of(duo.uav_actions, uav_do.Act)


def test_whole_certificates_travel_too(make_duo):
    duo = make_duo(whole_certificate=True, pad_certificate=b"pad certificate", uav_certificate=b"uav certificate")
    duo.run()
    assert duo.verdict.outcome == "verified"


@pytest.mark.parametrize("who", ["pad", "uav"])
def test_another_certificate_than_the_ledgers_ends_in_a_refusal(make_duo, who):
    duo = make_duo(**{f"{who}_certificate": b"somebody else's"})
    duo.run()
    assert duo.verdict.permission == "refused"
    assert "identity_mismatch" in duo.evidence.failure
    assert duo.ledger_state == "decided"


@pytest.mark.parametrize("liar", ["pad", "uav"])
def test_another_session_code_ends_in_a_refusal(make_duo, liar):
    duo = make_duo()
    name = f"code_{liar}"
    other = replace(duo.keys, **{name: b"\x00" * 16})
    duo = make_duo(**{f"{liar}_keys": other})
    duo.run()
    assert duo.verdict.permission == "refused"
    assert duo.evidence.matched == "none"
    assert duo.evidence.failure in {"code_mismatch", "drone_saw_code_mismatch"}
    assert not duo.evidence.ranges.t_ms


def test_a_drone_with_other_keys_is_not_understood_and_not_permitted(make_duo):
    stranger = replace(make_duo().keys, key_uav_to_pad=b"x" * 16, key_pad_to_uav=b"y" * 16)
    duo = make_duo(uav_keys=stranger)
    duo.run()
    assert duo.verdict.permission == "refused"
    assert duo.evidence.failure == "no_reply"
    assert duo.uav_end.state == "decided"


def test_a_drone_elsewhere_is_refuted(make_duo, make_flight):
    flight = make_flight(truth=(14_000.0, 3_000.0, 6_000.0))
    duo = make_duo(flight=flight)
    duo.run()
    assert duo.verdict.outcome == "refuted"
    assert duo.uav_end.end == "refused"
    assert not duo.of(duo.uav_actions, uav_do.Act)
    assert not duo.of(duo.pad_actions, pad_do.Permit)


def test_a_silent_anchor_leaves_three_and_a_verdict(make_duo, make_flight):
    duo = make_duo(flight=make_flight(silent={"A3"}))
    duo.run()
    assert duo.ledger_state in {"completed", "decided"}
    assert set(duo.evidence.ranges.anchors[2].range_mm) == {-1}
    assert any(reason.code == "anchor_silent" for reason in duo.verdict.reasons)


def test_two_silent_anchors_are_no_ranging(make_duo, make_flight):
    duo = make_duo(flight=make_flight(silent={"A3", "A4"}))
    duo.run()
    assert duo.evidence.failure == "too_few_anchors"
    assert len(duo.evidence.ranges.t_ms) == 1  # the first one, which says since when it was ranged
    assert duo.verdict.permission == "refused"


def test_a_hopeless_session_is_not_ranged_to_the_end(make_duo, make_flight):
    flight = make_flight(noise_mm=20.0)
    flight.truth = (flight.claimed[0] + 960.0, *flight.claimed[1:])  # at the very rim of the buffer
    duo = make_duo(flight=flight, policy=Policy(max_rounds=500))
    duo.run()
    assert duo.verdict.permission == "refused"
    assert len(duo.evidence.ranges.t_ms) <= 160


def test_ranging_stops_at_the_most_rounds_of_the_policy(make_duo, make_flight):
    flight = make_flight()
    flight.truth = (flight.claimed[0] + 900.0, *flight.claimed[1:])
    duo = make_duo(flight=flight, policy=Policy(max_rounds=20))
    duo.run()
    assert len(duo.evidence.ranges.t_ms) <= 20


# --- who dies when ------------------------------------------------------------------------------------------------


def phase_is(machine, phase):
    return lambda duo: getattr(duo, machine).phase is phase


STEPS = {
    "pad opens": phase_is("pad", PadPhase.OPENING),
    "pad polls": phase_is("pad", PadPhase.POLLING),
    "drone replied": phase_is("uav", UavPhase.RANGING),
    "pad ranges": phase_is("pad", PadPhase.RANGING),
    "half of the rounds": lambda duo: duo.pad.evidence.rounds >= 5,
    "pad confirms": phase_is("pad", PadPhase.CONFIRMING),
    "drone signed": lambda duo: "confirm" in duo.uav.steps,
    "submitted": lambda duo: duo.evidence is not None,
    "decided": lambda duo: duo.ledger_state == "decided",
}


@pytest.mark.parametrize("step", STEPS)
def test_a_drone_that_dies_leaves_a_recorded_end(make_duo, step):
    duo = make_duo()
    if step == "pad opens":
        duo.dead.add("uav")
    else:
        duo.on(STEPS[step], lambda d: d.dead.add("uav"))
    duo.run()
    assert duo.pad_end is not None
    assert duo.pad.phase is PadPhase.ENDED
    assert duo.ledger_state in {"decided", "cancelled"}
    if duo.verdict is not None and duo.verdict.permission == "granted":  # it had signed everything before it died
        assert (duo.ledger_state, duo.pad_end.end) == ("cancelled", "permission_expired")
        assert duo.of(duo.pad_actions, pad_do.Withdraw)
    else:
        assert duo.evidence.failure is not None
        assert not duo.of(duo.pad_actions, pad_do.Permit)


@pytest.mark.parametrize("step", [step for step in STEPS if step not in {"decided", "submitted"}])
def test_a_pad_that_dies_leaves_an_end_recorded_by_the_drone(make_duo, step):
    duo = make_duo()
    if step == "pad opens":
        duo.dead.add("pad")
    else:
        duo.on(STEPS[step], lambda d: d.dead.add("pad"))
    duo.run()
    assert duo.uav.phase is UavPhase.ENDED
    if duo.verdict is None:
        assert (duo.ledger_state, duo.uav_end.state) == ("cancelled", "cancelled")
        assert not duo.of(duo.uav_actions, uav_do.Act)


@pytest.mark.parametrize("step", STEPS)
def test_a_ledger_that_is_away_from_a_step_on_permits_nothing(make_duo, step):
    duo = make_duo()
    duo.ledger_away = step != "decided"
    duo.on(lambda d: d.evidence is not None, lambda d: d.tell_pad(pad_on.LedgerLost("away")))
    duo.run()
    if duo.verdict is None:
        assert not duo.of(duo.pad_actions, pad_do.Permit)
        assert not duo.of(duo.uav_actions, uav_do.Act)
        assert duo.pad_end.end == "ledger_lost"


@pytest.mark.parametrize("mute", ["pad", "uav"])
def test_a_radio_that_falls_silent_is_noticed(make_duo, mute):
    duo = make_duo()
    duo.on(lambda d: d.pad.evidence.rounds >= 5, lambda d: d.mute.add(mute))
    duo.run()
    assert duo.pad_end is not None
    assert duo.uav_end is not None
    assert duo.verdict.permission == "refused"
    assert duo.evidence.failure in {"drone_lost", "not_countersigned", "no_echo", "link_undelivered", "no_identity"}


def test_nodes_that_do_not_open_end_in_a_cancellation(make_duo):
    duo = make_duo()
    duo.dead.add("pad radios")
    duo.run()
    assert (duo.ledger_state, duo.ledger_end) == ("cancelled", "radios_unavailable")
    assert duo.uav_end.state == "cancelled"


def test_the_drones_own_node_failing_ends_in_a_cancellation(make_duo):
    duo = make_duo()
    duo.dead.add("uav radios")
    duo.run()
    assert duo.ledger_state in {"cancelled", "decided"}
    assert duo.uav_end is not None
    assert duo.pad_end is not None


def test_nodes_lost_while_ranging_are_judged_with_their_reason(make_duo):
    duo = make_duo()
    duo.on(lambda d: d.pad.evidence.rounds >= 3, lambda d: d.tell_pad(pad_on.RadiosFailed("unplugged")))
    duo.run()
    assert duo.evidence.failure == "radios_lost"
    assert duo.verdict.permission == "refused"


@pytest.mark.parametrize("step", [step for step in STEPS if step not in {"pad opens", "decided", "submitted"}])
def test_an_agent_told_to_stop_ends_the_session(make_duo, step):
    duo = make_duo()
    duo.on(STEPS[step], lambda d: d.tell_pad(pad_on.Interrupted("agent_stopped")))
    duo.run()
    assert duo.pad_end is not None
    assert duo.uav_end is not None
    assert not duo.of(duo.pad_actions, pad_do.Permit) or duo.ledger_state == "completed"


def test_a_cancelled_session_is_left_at_once(make_duo):
    duo = make_duo()
    duo.on(
        lambda d: d.pad.evidence.rounds >= 3,
        lambda d: (
            d.tell_pad(pad_on.SessionCancelled("authority", "stop")),
            d.tell_uav(uav_on.SessionCancelled("authority", "stop")),
        ),
    )
    duo.run()
    assert duo.pad_end.end == duo.uav_end.end == "stop"
    assert duo.of(duo.pad_actions, pad_do.CloseRadios)
    assert duo.evidence is None


# --- what the other side may not do -------------------------------------------------------------------------------


def test_a_pad_that_tells_other_ranges_gets_no_signature(make_duo):
    duo = make_duo()
    honest = duo.uav.handle

    def shifted(event, now_ms):
        if isinstance(event, uav_on.OwnRange):
            event = replace(event, range_mm=event.range_mm + 2_000)
        return honest(event, now_ms)

    duo.uav.handle = shifted
    duo.run()
    assert duo.evidence.uav_signature is None
    assert duo.evidence.failure == "ranges_refused"
    assert duo.verdict.permission == "refused"
    assert duo.uav.failure == "ranges_disagree"


def test_a_signature_that_does_not_fit_verifies_nothing(make_duo):
    duo = make_duo()
    honest = duo.uav.handle

    def forged(event, now_ms):
        return honest(uav_on.Signed(b"\x01" * 64) if isinstance(event, uav_on.Signed) else event, now_ms)

    duo.uav.handle = forged
    duo.run()
    assert duo.verdict.outcome != "verified"
    assert [step.ok for step in duo.of(duo.pad_actions, pad_do.ReportStep) if step.step == "confirm"] == [False]


def test_garbage_and_strangers_frames_change_nothing(make_duo):
    duo = make_duo()
    for after in range(0, 10, 2):
        duo.on(
            lambda d, after=after: d.pad.evidence.rounds >= after,
            lambda d: (
                d.tell_pad(pad_on.DataHeard(b"\xff" * 40)),
                d.tell_uav(uav_on.DataHeard(b"")),
                d.tell_pad(pad_on.AnchorRange("Z9", d.now_ms, 5_000)),
            ),
        )
    duo.run()
    assert duo.verdict.outcome == "verified"


def test_a_drone_without_a_position_claims_nothing_and_is_not_verified_elsewhere(make_duo, make_flight):
    flight = make_flight()
    duo = make_duo(flight=flight)
    duo.uav._claims_now = lambda now_ms: None
    duo.run()
    assert duo.evidence.claims == ()
    assert duo.pad_end is not None


def test_claims_keep_to_what_a_session_may_hold(make_duo, make_flight):
    flight = make_flight()
    flight.truth = (flight.claimed[0] + 700.0, *flight.claimed[1:])
    duo = make_duo(flight=flight, policy=Policy(verify_ppm=999_999, refute_ppm=1))
    duo.run()
    assert len(duo.evidence.claims) <= 200
    assert [claim.t_ms for claim in duo.evidence.claims] == sorted(claim.t_ms for claim in duo.evidence.claims)


# --- anything, in any order ---------------------------------------------------------------------------------------

anything = st.one_of(
    st.just(pad_on.RadiosOpened("UCI")),
    st.just(pad_on.RadiosFailed("x")),
    st.builds(
        pad_on.AnchorRange,
        st.sampled_from(["A1", "A2", "A3", "A4", "?"]),
        st.integers(1_800_000_000_000, 1_800_000_100_000),
        st.one_of(st.none(), st.integers(0, 99_999)),
        st.booleans(),
    ),
    st.builds(pad_on.DataHeard, st.binary(max_size=90)),
    st.just(pad_on.Tick()),
    st.just(pad_on.SubmitRefused("session_expired", "late")),
    st.just(pad_on.LedgerLost("gone")),
    st.just(pad_on.SessionCancelled("uav", "changed_its_mind")),
    st.just(pad_on.InteractionCompleted("done")),
    st.just(pad_on.Interrupted("agent_stopped")),
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(steps=st.lists(st.tuples(st.integers(0, 3_000), anything), max_size=40))
def test_no_order_of_events_permits_without_a_committed_verdict(make_duo, steps):
    duo = make_duo()
    machine, now_ms = duo.pad, duo.now_ms
    actions = machine.start(now_ms)
    for wait_ms, event in steps:
        now_ms += wait_ms
        actions += machine.handle(event, now_ms)
        machine.frames_to_send(now_ms)
    assert not duo.of(actions, pad_do.Permit)
    ends = duo.of(actions, pad_do.Finish)
    assert len(ends) == (machine.phase is PadPhase.ENDED)
    assert len(duo.of(actions, pad_do.Submit)) <= 1
    for submitted in duo.of(actions, pad_do.Submit):
        Evidence.parse(submitted.evidence.to_json())
    if machine.phase is not PadPhase.ENDED:
        assert machine.next_tick_ms() is not None
        assert machine.next_tick_ms() <= duo.session.expires_ms + 70_000


uav_anything = st.one_of(
    st.just(uav_on.RadiosOpened()),
    st.just(uav_on.RadiosFailed("x")),
    st.builds(
        uav_on.OwnRange,
        st.integers(0xA000, 0xA004),
        st.integers(1_800_000_000_000, 1_800_000_100_000),
        st.integers(0, 99_999),
    ),
    st.builds(uav_on.DataHeard, st.binary(max_size=90)),
    st.just(uav_on.Tick()),
    st.just(uav_on.Signed(b"s" * 64)),
    st.just(uav_on.SignFailed("no key")),
    st.just(uav_on.SessionCancelled("pad", "busy")),
    st.just(uav_on.Acted("done")),
    st.just(uav_on.Interrupted("agent_stopped")),
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(steps=st.lists(st.tuples(st.integers(0, 3_000), uav_anything), max_size=40))
def test_no_order_of_events_makes_a_drone_act_without_a_committed_verdict(make_duo, steps):
    duo = make_duo()
    machine, now_ms = duo.uav, duo.now_ms
    actions = machine.start(now_ms)
    for wait_ms, event in steps:
        now_ms += wait_ms
        actions += machine.handle(event, now_ms)
        machine.frames_to_send(now_ms)
    assert not duo.of(actions, uav_do.Act)
    assert not duo.of(actions, uav_do.Complete)
    assert not duo.of(actions, uav_do.Sign)
    assert len(duo.of(actions, uav_do.Finish)) == (machine.phase is UavPhase.ENDED)


@pytest.mark.parametrize("loss", [0.1, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_lost_frames_cost_time_and_no_verdict(make_duo, loss, seed):
    duo = make_duo()
    rng = random.Random(seed)
    for machine in (duo.pad, duo.uav):
        send = machine.frames_to_send
        machine.frames_to_send = lambda now_ms, send=send: [frame for frame in send(now_ms) if rng.random() >= loss]
    duo.run()
    assert duo.verdict.outcome == "verified"
    assert duo.ledger_state == "completed"


# --- time stamps of the drone's frames ------------------------------------------------------------------------------


def test_time_stamps_of_the_drones_frames_earn_assurance_3(make_duo):
    duo = make_duo(timed=True, policy=Policy(min_assurance=3))
    duo.run()
    stamps = duo.evidence.time_stamps
    assert stamps is not None
    assert stamps.bound_by == "challenge"
    assert [anchor.anchor_id for anchor in stamps.anchors] == ["A1", "A2", "A3", "A4"]
    assert all(0 <= tick < 1000 for anchor in stamps.anchors for tick in anchor.ticks)
    assert (duo.verdict.outcome, duo.verdict.permission, duo.verdict.assurance) == ("verified", "granted", 3)
    assert "upper_bound" not in {reason.code for reason in duo.verdict.reasons}


@pytest.mark.parametrize("level", [2, 3])
def test_a_drone_that_lies_about_its_time_stamps_to_each_anchor_is_refuted(make_duo, make_flight, level):
    """Its ranges fit the claim perfectly; all that gives it away is that it has one antenna."""
    flight = make_flight(truth=(4_000.0, 3_000.0, 6_000.0), claimed=(7_000.0, 3_000.0, 6_000.0))
    flight.ranged = flight.claimed
    duo = make_duo(flight=flight, timed=True, policy=Policy(min_assurance=level))
    duo.run()
    assert (duo.verdict.outcome, duo.verdict.permission) == ("refuted", "refused")
    assert "time_differences_contradict" in {reason.code for reason in duo.verdict.reasons}
    untimed = make_duo(flight=flight, policy=Policy(min_assurance=2))
    untimed.run()
    assert untimed.verdict.outcome == "verified", "two-way ranging alone falls for it"


def test_a_drone_without_time_stamps_is_not_verified_where_they_are_demanded(make_duo):
    duo = make_duo(policy=Policy(min_assurance=3))
    duo.run()
    assert (duo.verdict.outcome, duo.verdict.assurance) == ("inconclusive", 2)
    assert {"no_time_stamps", "assurance_too_low"} <= {reason.code for reason in duo.verdict.reasons}
    assert len(duo.evidence.ranges.t_ms) <= 10, "and nobody ranges for longer because of it"


def test_blinks_without_the_answer_to_the_challenge_do_not_count(make_duo):
    duo = make_duo(timed=True, policy=Policy(min_assurance=3, max_rounds=30))
    duo.pad._answer = b"another!"
    duo.run()
    assert duo.evidence.time_stamps is None
    assert duo.verdict.outcome == "inconclusive"
    assert duo.pad._frames.foreign > 0


# --- the drone's clock ----------------------------------------------------------------------------------------------


def test_the_echoes_tell_how_far_the_drones_clock_is_off(make_duo, make_flight):
    duo = make_duo(flight=make_flight(clock_ms=0))
    duo.run()
    clock = duo.verdict.clock
    assert clock is not None
    assert clock.readings >= 3, "the reply, the echo and a claim"
    assert -100 <= clock.offset_ms <= 100
    assert clock.sigma_ms <= 50


def test_the_match_is_dated_by_the_drone_and_the_reply_by_the_pad(make_duo):
    duo = make_duo()
    duo.run()
    steps = duo.pad.evidence.steps
    assert steps["match"] == duo.uav.steps["match"]
    assert steps["poll"] <= steps["match"] < steps["reply"]


def test_the_permission_is_dated_when_the_pad_has_opened(make_duo):
    duo = make_duo()
    duo.run()
    assert duo.of(duo.pad_actions, pad_do.Permit)
    assert duo.pad.evidence.steps["permission"] >= duo.pad.evidence.steps["verdict"]
    quiet = make_duo()
    quiet.tell_pad = lambda event: None if isinstance(event, pad_on.Permitted) else type(quiet).tell_pad(quiet, event)
    quiet.run()
    assert "permission" not in quiet.pad.evidence.steps


# --- what can never be settled --------------------------------------------------------------------------------------


def test_a_place_where_nothing_can_be_settled_is_ranged_for_ten_rounds_and_told_before(make_duo, make_flight):
    far = (4_000.0, 120_000.0, 6_000.0)
    duo = make_duo(flight=make_flight(truth=far, claimed=far))
    duo.run()
    first = duo.of(duo.pad_actions, pad_do.ReportStep)[0]
    assert (first.step, first.detail[:13]) == ("request", "cannot settle")
    assert len(duo.evidence.ranges.t_ms) <= 10
    assert (duo.verdict.outcome, duo.verdict.permission) == ("inconclusive", "refused")


def test_or_cancelled_at_once_where_the_policy_wants_that(make_duo, make_flight):
    far = (4_000.0, 120_000.0, 6_000.0)
    duo = make_duo(flight=make_flight(truth=far, claimed=far), policy=Policy(cancel_hopeless=True))
    duo.run()
    assert (duo.ledger_state, duo.ledger_end) == ("cancelled", "cannot_settle")
    assert not duo.of(duo.pad_actions, pad_do.OpenRadios)
    assert duo.evidence is None
