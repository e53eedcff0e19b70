"""What is broadcast under a drone's serial number: no outsider convicts it, and a drone that lies to the public is told."""

from __future__ import annotations

import dataclasses

import pytest

from wonderland.proofs.attestation import digest_of
from wonderland.proofs.broadcast import NEXT_MESSAGE_ROUNDS
from wonderland.proofs.records.sessions import MAX_CLAIMS, BroadcastClaim, ClockReading
from wonderland.proofs.records.verdicts import BroadcastFinding, Verdict
from wonderland.proofs.verdict import decide, preview

START_MS = 1_800_000_000_000
HERE = (3000.0, 6000.0, 4000.0)
SECONDS = (700, 1_700, 2_700)
"""When the drones of these tests broadcast, ms since the request."""


def here(t):
    return HERE


def flying(t):
    return (3000 + 4 * t, 6000, 4000)


def codes(verdict):
    return [reason.code for reason in verdict.reasons]


class Air:
    """What a receiver hears beside one drone's session."""

    def __init__(self, world, truth=here, rounds=60, **policy):
        self.world = world
        self.truth = truth
        self.evidence = world.evidence(truth, truth, rounds=rounds)
        self.session = world.session(world.claim(truth(0), START_MS), **policy)
        self.own = []
        self.attested = []

    def say(self, t, east_mm=0, *, heard=None, attest=False, accuracy_mm=None, at=None, timed=True):
        """Somebody broadcasts the place of time ``t``, ``east_mm`` beside it; heard half a tenth later, or then."""
        east, north, up = self.truth(t) if at is None else at
        place = self.world.claim((east + east_mm, north, up), START_MS)
        message = BroadcastClaim(
            lat_e7=place.lat_e7,
            lon_e7=place.lon_e7,
            height_mm=place.height_mm,
            accuracy_mm=accuracy_mm,
            t_ms=START_MS + (t + 50 if heard is None else heard),
            said_ms=START_MS + t if timed else None,
        )
        self.own.append(message)
        if attest:
            self.attested.append(digest_of(message))
        return message

    def verdict(self, *, signature_valid=True, **more):
        heard = tuple(sorted(self.own, key=lambda each: each.t_ms))[:MAX_CLAIMS]
        evidence = dataclasses.replace(
            self.evidence, broadcast=heard, attested=tuple(dict.fromkeys(self.attested)), **more
        )
        return decide(
            self.session,
            self.world.commissioning,
            evidence,
            confirmed=True,
            signature_valid=signature_valid,
            authorisation=(),
            now_ms=START_MS + 20_000,
            evidence_sha256="0" * 64,
        )


@pytest.fixture
def air(world):
    return Air(world)


def found(verdict):
    return verdict.outcome, verdict.broadcast.outcome, verdict.broadcast.supported


# --- what a message can mean -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stated_mm", "away_mm", "outcome", "finding"),
    [
        (None, 0, "verified", "supported"),
        (None, 1_500, "refuted", "own_contradicted"),
        (1_000, 1_000, "verified", "supported"),
        (1_000, 2_000, "inconclusive", "undecided"),
        (1_000, 3_000, "refuted", "own_contradicted"),
        (10_000, 9_000, "verified", "supported"),
        (10_000, 25_000, "refuted", "own_contradicted"),
        (10_000_000, 35_000, "verified", "supported"),
        (10_000_000, 50_000, "refuted", "own_contradicted"),
    ],
)
@pytest.mark.parametrize("attest", [True, False])
def test_a_broadcast_means_what_its_stated_accuracy_says(world, stated_mm, away_mm, outcome, finding, attest):
    air = Air(world, rounds=20)
    air.say(700, away_mm, accuracy_mm=stated_mm, attest=attest)
    verdict = air.verdict()
    if not attest and finding == "own_contradicted":
        outcome, finding = "inconclusive", "contradicted"
    assert verdict.signed.outcome == "verified"
    assert (verdict.outcome, verdict.broadcast.outcome) == (outcome, finding)
    assert verdict.permission == ("granted" if outcome == "verified" else "refused")
    assert ("broadcast_undecided" in codes(verdict)) == (finding == "undecided")


@pytest.mark.parametrize("attest", [True, False])
def test_an_undecided_broadcast_asks_for_the_rounds_that_settle_it(make_world, attest):
    def said(rounds):
        air = Air(make_world(sigma_mm=60), rounds=rounds)
        for t in range(700, 500 + 50 * rounds, 1_000):
            air.say(t, 2_150, accuracy_mm=1_000, attest=attest)
        return air.verdict()

    assert found(said(20)) == ("inconclusive", "undecided", False)
    assert said(20).more_rounds > 0
    settled = said(160)
    assert settled.broadcast.outcome == ("own_contradicted" if attest else "contradicted")


def test_a_fast_drone_is_not_held_to_a_position_that_was_old_when_it_was_heard(world):
    air = Air(world, flying)
    air.say(1_000, heard=1_400)
    verdict = air.verdict()
    assert verdict.outcome == "verified"
    assert verdict.broadcast.tolerance_mm == pytest.approx(4_800, abs=20)
    late = Air(world, flying)
    late.say(-1_000, heard=2_000)
    assert found(late.verdict()) == ("inconclusive", "contradicted", False)


@pytest.mark.parametrize(
    ("away_mm", "early_ms", "finding"),
    [(6_000, 1_500, "supported"), (6_000, 100, "contradicted"), (80_000, 1_500, "contradicted")],
)
def test_a_broadcast_from_before_the_claims_is_judged_with_what_the_drone_may_have_flown(
    world, away_mm, early_ms, finding
):
    air = Air(world)
    air.say(0, away_mm, heard=-early_ms)
    assert air.verdict().broadcast.outcome == finding


@pytest.mark.parametrize(("policy", "outcome"), [("if_contradicted", "verified"), ("always", "inconclusive")])
@pytest.mark.parametrize("attest", [True, False])
def test_what_was_heard_before_the_claims_is_no_support(world, policy, outcome, attest):
    """A drone may have flown 60 m in the meantime: nearly any lie would support it."""
    air = Air(world, broadcast_required=policy)
    air.say(-1_500, 6_000, attest=attest)
    verdict = air.verdict()
    assert found(verdict) == (outcome, "supported", False)
    assert (verdict.more_rounds > 0) == (outcome == "inconclusive")
    air.say(700, 36_000)
    assert found(air.verdict()) == ("inconclusive", "contradicted", False)
    air.say(1_700, attest=attest)
    assert air.verdict().outcome == "verified"


def test_what_the_drone_signed_for_has_to_hold_even_where_no_broadcast_is_required(world):
    air = Air(world, broadcast_required="never")
    air.say(700, 2_000, accuracy_mm=1_000, attest=True)
    air.say(1_700, 36_000)
    assert found(air.verdict()) == ("inconclusive", "contradicted", False)


def test_what_was_heard_long_before_the_claims_is_not_judged(world):
    air = Air(world)
    air.say(0, 60_000, heard=-5_000)
    verdict = air.verdict()
    assert found(verdict) == ("verified", "not_heard", False)
    assert (verdict.broadcast.messages, verdict.broadcast.claim) == (0, None)


def test_a_broadcast_from_the_other_side_of_the_planet_is_contradicted_too(air):
    air.own.append(dataclasses.replace(air.say(700), lat_e7=0))
    verdict = air.verdict()
    assert found(verdict) == ("verified", "contradicted", True)
    assert verdict.broadcast.error_mm == 50_000_000 or verdict.broadcast.error_mm > 10_000_000


# --- attribution -------------------------------------------------------------------------------------------------


def test_who_attests_a_lie_is_refuted(air):
    air.say(1_700, 31_000, attest=True)
    verdict = air.verdict()
    assert found(verdict) == ("refuted", "own_contradicted", False)
    assert verdict.signed.outcome == "verified"
    assert "broadcast_own_contradicts" in codes(verdict)
    assert verdict.broadcast.error_mm == pytest.approx(31_000, abs=300)
    assert (verdict.broadcast.messages, verdict.broadcast.attributed) == (1, 1)
    assert Verdict.parse(verdict.to_json()) == verdict


@pytest.mark.parametrize("policy", ["never", "if_contradicted", "always"])
def test_one_attested_lie_among_attested_truths_is_refuted_whatever_the_policy(world, policy):
    air = Air(world, broadcast_required=policy)
    for t, off in zip(SECONDS, (0, 8_000, 0), strict=True):
        air.say(t, off, attest=True)
    assert found(air.verdict()) == ("refuted", "own_contradicted", False)


def test_two_attested_lies_do_not_cancel(air):
    air.say(700, 8_000, attest=True)
    air.say(1_700, -8_000, attest=True)
    verdict = air.verdict()
    assert verdict.outcome == "refuted"
    assert verdict.broadcast.error_mm == pytest.approx(8_000, abs=200)


@pytest.mark.parametrize("signature_valid", [None, False])
def test_a_list_that_the_drone_did_not_sign_attributes_nothing(air, signature_valid):
    """A pad may write whatever list it likes."""
    air.say(700, 31_000, attest=True)
    verdict = air.verdict(signature_valid=signature_valid)
    assert found(verdict) == ("inconclusive", "contradicted", False)
    assert verdict.broadcast.attributed == 0


@pytest.mark.parametrize(
    "change",
    [{"accuracy_mm": 1_000}, {"accuracy_mm": None}, {"lat_e7": 1}, {"lon_e7": 1}, {"said_ms": 100}],
    ids=lambda change: next(iter(change)),
)
def test_a_message_that_was_changed_is_not_the_drones(air, change):
    """An honest message of 3 m, repeated as if it were better: the tolerance would be what convicts the drone."""
    honest = air.say(700, 5_000, accuracy_mm=3_000, attest=True)
    assert found(air.verdict()) == ("verified", "supported", True)
    name, value = next(iter(change.items()))
    if name in {"lat_e7", "lon_e7", "said_ms"}:
        value += getattr(honest, name)
    air.own.append(dataclasses.replace(honest, **{name: value}))
    verdict = air.verdict()
    assert verdict.outcome == "verified"
    assert verdict.broadcast.attributed == 1


def test_another_height_changes_nothing_about_an_attested_message(air):
    honest = air.say(700, attest=True)
    air.own.append(dataclasses.replace(honest, height_mm=50_000_000, t_ms=honest.t_ms + 10))
    verdict = air.verdict()
    assert found(verdict) == ("verified", "supported", True)
    assert verdict.broadcast.attributed == 2


def test_a_message_without_a_time_of_its_own_cannot_be_attested(air):
    assert digest_of(air.say(700, 31_000, timed=False)) is None
    assert found(air.verdict()) == ("inconclusive", "contradicted", False)


def test_attesting_what_is_dated_away_from_the_session_wins_nothing(air):
    """Else a drone could sign for a lie, date it to last week, and have it judged by nothing."""
    air.say(-60_000, 31_000, heard=1_700, attest=True)
    verdict = air.verdict()
    assert found(verdict) == ("inconclusive", "contradicted", False)
    assert verdict.broadcast.attributed == 0


# --- the drone that lies to the public ---------------------------------------------------------------------------


def test_who_tells_the_public_only_lies_gets_no_permission(air):
    for t in SECONDS:
        air.say(t, 31_000)
    verdict = air.verdict()
    assert found(verdict) == ("inconclusive", "contradicted", False)
    assert (verdict.permission, verdict.signed.outcome) == ("refused", "verified")
    assert {"broadcast_contradicts", "broadcast_unsupported"} <= set(codes(verdict))
    assert verdict.more_rounds == NEXT_MESSAGE_ROUNDS


def test_who_attests_truths_that_nobody_heard_and_broadcasts_lies_gets_none_either(air):
    air.say(700, attest=True)
    air.own.clear()
    air.say(1_700, 31_000)
    assert found(air.verdict()) == ("inconclusive", "contradicted", False)


@pytest.mark.parametrize(
    ("policy", "outcome"), [("never", "verified"), ("if_contradicted", "inconclusive"), ("always", "inconclusive")]
)
def test_the_policy_says_when_a_supported_broadcast_is_demanded(world, policy, outcome):
    lying = Air(world, broadcast_required=policy)
    lying.say(700, 31_000)
    assert lying.verdict().outcome == outcome
    silent = Air(world, broadcast_required=policy).verdict()
    assert silent.outcome == ("inconclusive" if policy == "always" else "verified")
    assert ("broadcast_not_heard" in codes(silent)) == (policy == "always")


def test_a_lie_that_is_signed_is_refuted_whatever_is_broadcast(world):
    claimed = lambda t: (HERE[0] + 5_000, HERE[1], HERE[2])  # noqa: E731
    air = Air(world)
    air.evidence = world.evidence(here, claimed, rounds=60)
    air.say(700)
    assert air.verdict().outcome == "refuted"


# --- the outsider ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("attest", [True, False])
@pytest.mark.parametrize("away_mm", [1_500, 2_000, 3_000, 36_000, 5_000_000])
@pytest.mark.parametrize("accuracy_mm", [None, 1_000, 10_000])
def test_an_honest_drone_beside_an_impostor_is_verified(world, attest, away_mm, accuracy_mm):
    air = Air(world)
    for t in SECONDS:
        air.say(t, attest=attest)
    for t in range(500, 3_500, 20):
        air.say(t, away_mm, accuracy_mm=accuracy_mm)
    verdict = air.verdict()
    assert (verdict.outcome, verdict.permission, verdict.broadcast.supported) == ("verified", "granted", True)
    assert verdict.broadcast.attributed == (3 if attest else 0)


@pytest.mark.parametrize("heard", [1_200, 2_900, 3_500, 5_900])
def test_an_attested_message_that_somebody_repeats_later_convicts_nobody(world, heard):
    air = Air(world, lambda t: (3 * t - 3000, 6000, 4000))
    message = air.say(700, attest=True)
    air.say(1_700, attest=True)
    air.own.append(dataclasses.replace(message, t_ms=START_MS + heard))
    verdict = air.verdict()
    assert found(verdict) == ("verified", "supported", True)
    assert verdict.broadcast.attributed == 3


def test_messages_that_are_repeated_an_hour_later_are_somebodys(world):
    air = Air(world, flying)
    message = air.say(700, attest=True)
    air.own.append(dataclasses.replace(message, t_ms=START_MS + 2_800, said_ms=message.said_ms - 3_600_000))
    assert air.verdict().outcome == "verified"


def test_before_its_own_message_is_heard_the_pad_is_told_to_go_on(air):
    """An impostor that is heard first, with something that no number of rounds settles."""
    air.say(700, 2_000, accuracy_mm=1_000)
    verdict = air.verdict()
    assert found(verdict) == ("inconclusive", "undecided", False)
    assert verdict.more_rounds >= NEXT_MESSAGE_ROUNDS
    air.say(1_700)
    assert found(air.verdict()) == ("verified", "supported", True)


def test_attested_messages_are_judged_on_the_pads_clock(world):
    """Its clock is 400 ms ahead, for claims and broadcasts alike."""
    air = Air(world, lambda t: (3000 + 10 * t, 6000, 4000))
    ahead = [dataclasses.replace(claim, t_ms=claim.t_ms + 400) for claim in air.evidence.claims]
    message = air.say(1_700)
    air.own[:] = [dataclasses.replace(message, said_ms=message.said_ms + 400)]
    air.attested.append(digest_of(air.own[0]))
    readings = tuple(
        ClockReading(uav_ms=START_MS + t + 400, heard_ms=START_MS + t + 5, asked_ms=START_MS + t - 5)
        for t in (1_000, 2_000)
    )
    verdict = air.verdict(claims=tuple(ahead), clock=readings)
    assert verdict.broadcast.outcome == "supported"
    assert verdict.broadcast.error_mm < 1_000


@pytest.mark.parametrize("attest", [True, False])
@pytest.mark.parametrize("off_mm", [4_000, 8_000])
@pytest.mark.parametrize("half_ms", [200, 800, 1_500])
def test_a_true_broadcast_is_not_blamed_for_a_claim_that_is_off_for_a_while(world, attest, off_mm, half_ms):
    air = Air(world, rounds=160)
    claims = [
        world.claim((HERE[0] + off_mm, HERE[1], HERE[2]), one.t_ms)
        if abs(one.t_ms - START_MS - 4_000) <= half_ms
        else one
        for one in air.evidence.claims
    ]
    air.say(4_000, attest=attest)
    finding = air.verdict(claims=tuple(claims)).broadcast
    assert finding is None or not finding.outcome.endswith("contradicted")


def test_a_lie_is_a_lie_beside_claims_that_are_off_for_a_while(world):
    air = Air(world, rounds=160)
    claims = [
        world.claim((HERE[0] + 8_000, HERE[1], HERE[2]), one.t_ms) if abs(one.t_ms - START_MS - 4_000) <= 800 else one
        for one in air.evidence.claims
    ]
    air.say(4_000, -9_000, attest=True)
    assert air.verdict(claims=tuple(claims)).broadcast.outcome == "own_contradicted"


def test_a_lie_is_found_behind_a_message_that_is_farther_off_and_excused(world):
    """The farthest one is not blamed, for the claims of its moment are off; the other is a lie all the same."""
    air = Air(world, rounds=160)
    claims = [
        world.claim((HERE[0] + 8_000, HERE[1], HERE[2]), one.t_ms) if abs(one.t_ms - START_MS - 4_000) <= 800 else one
        for one in air.evidence.claims
    ]
    air.say(4_000, attest=True)
    assert air.verdict(claims=tuple(claims)).broadcast.outcome == "undecided"
    air.say(1_000, 5_000, attest=True)
    verdict = air.verdict(claims=tuple(claims))
    assert found(verdict) == ("refuted", "own_contradicted", False)
    assert verdict.broadcast.error_mm == pytest.approx(5_000, abs=100)


def test_a_glitch_that_it_signed_and_broadcast_alike_convicts_nobody(world):
    air = Air(world, rounds=60)
    claims = [
        world.claim((HERE[0] + 4_000, HERE[1], HERE[2]), one.t_ms) if abs(one.t_ms - START_MS - 2_000) <= 200 else one
        for one in air.evidence.claims
    ]
    air.say(2_000, 4_000, attest=True)
    air.say(3_000, 0, attest=True)
    verdict = air.verdict(claims=tuple(claims))
    assert verdict.broadcast.outcome != "own_contradicted"
    assert verdict.outcome != "refuted"


def test_the_pads_look_counts_every_message_as_somebodys(air):
    """While it ranges the drone has signed nothing yet."""
    air.say(700, 31_000, attest=True)
    heard = dataclasses.replace(air.evidence, broadcast=tuple(air.own))
    verdict = preview(air.session, air.world.commissioning, heard, START_MS + 20_000)
    assert (verdict.outcome, verdict.broadcast.attributed) == ("inconclusive", 0)


def test_a_finding_reads_itself_back():
    finding = BroadcastFinding(outcome="not_heard", messages=0, attributed=0, supported=False)
    assert BroadcastFinding.parse(finding.to_json()) == finding
