"""Conformance: what a proof says about a later broadcast, by physics alone."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from kit.description import document
from pyproj import Geod
from sqlalchemy import insert

from wonderland.messages import keys_of, text
from wonderland_backend.conformance.rules import Broadcast, Measured, Question, distance_mm, judge
from wonderland_backend.db.tables.reported import LatestTrackRow

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()
PLACE = (604_518_900, 222_666_000)
QUESTION = Question(within_mm=300_000, max_speed_mm_s=50_000, min_assurance=1)
PROOF = Measured(START_MS, "verified", 2, None, PLACE, 10_000, 0, 10_000)
METRE_E7 = 90


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


def north(metres, t_ms, **more):
    return Broadcast(PLACE[0] + round(metres * METRE_E7), PLACE[1], t_ms, **more)


@pytest.mark.parametrize(
    ("metres", "after_s", "status", "limits"),
    [
        (0, 0, "supported", ()),
        (0, 5, "supported", ()),
        (40, 4, "supported", ()),
        (0, 10, "unproven", ("too_far_or_too_long_ago",)),
        # A proof at noon at a pad says little about a position 5 km away twenty minutes later.
        (5_000, 1_200, "unproven", ("too_far_or_too_long_ago",)),
        (5_000, 60, "contradicted", ("speed_impossible",)),
        (5_000, 99, "contradicted", ("speed_impossible",)),
        (5_000, 101, "unproven", ("too_far_or_too_long_ago",)),
        (200, 0, "contradicted", ("speed_impossible",)),
        (200, -2, "contradicted", ("speed_impossible",)),
        (0, -5, "supported", ()),
    ],
)
def test_a_proof_reaches_as_far_as_a_drone_can_fly(metres, after_s, status, limits):
    t_ms = START_MS + after_s * 1000
    found = judge(north(metres, t_ms), PROOF, QUESTION, t_ms)
    assert (found.status, found.limits) == (status, limits)
    assert found.age_ms == after_s * 1000
    assert math.isclose(found.distance_mm, metres * 1000, rel_tol=0.01, abs_tol=10)


def test_whoever_knows_the_type_learns_more():
    t_ms = START_MS + 20_000
    assert judge(north(0, t_ms), PROOF, QUESTION, t_ms).status == "unproven"
    slow = Question(300_000, 12_000, 1)
    found = judge(north(0, t_ms), PROOF, slow, t_ms)
    assert found.status == "supported"
    until = found.supported_until_ms
    assert judge(north(0, until), PROOF, slow, until).status == "supported"
    assert judge(north(0, until + 50), PROOF, slow, until + 50).status == "unproven"


def test_what_a_broadcast_says_of_its_own_accuracy_counts_for_it():
    assert judge(north(200, START_MS), PROOF, QUESTION, START_MS).status == "contradicted"
    vague = north(200, START_MS, accuracy_mm=250_000)
    assert judge(vague, PROOF, QUESTION, START_MS).status == "supported"


@pytest.mark.parametrize(
    ("proof", "status", "limit"),
    [
        (None, "unproven", "no_proof"),
        (Measured(START_MS, "inconclusive", 2, None, PLACE, 1, 0, 1), "unproven", "last_proof_inconclusive"),
        (Measured(START_MS, "refuted", 2, None, PLACE, 1, 0, 1), "unproven", "last_proof_refuted"),
        (Measured(START_MS, "verified", 0, None, PLACE, 1, 0, 1), "unproven", "assurance_too_low"),
        (Measured(START_MS, "refuted", 2, None, None), "unproven", "no_measured_place"),
        (Measured(START_MS, "refuted", 2, "own_contradicted", PLACE, 1, 0, 1), "contradicted", "broadcast_refuted"),
        (Measured(START_MS, "verified", 2, "contradicted", PLACE, 1, 0, 1), "supported", "broadcast_unattributed"),
        (Measured(START_MS - 200_000, "refuted", 2, "refuted", PLACE, 1, 0, 1), "unproven", "last_proof_refuted"),
    ],
)
def test_proofs_that_support_nothing(proof, status, limit):
    found = judge(north(0, START_MS), proof, QUESTION, START_MS)
    assert found.status == status
    assert limit in found.limits


def test_an_old_broadcast_is_no_present_one():
    found = judge(north(0, START_MS), PROOF, QUESTION, START_MS + 61_000)
    assert (found.status, found.limits) == ("unproven", ("broadcast_stale",))
    assert judge(None, PROOF, QUESTION, START_MS).limits == ("never_heard",)


@settings(max_examples=200, deadline=None)
@given(speed=st.floats(0, 50.0), course=st.floats(0, 2 * math.pi), seconds=st.floats(-600, 600))
def test_an_honest_drone_is_never_contradicted(speed, course, seconds):
    """It was where it was measured, flew at most at its highest speed, and says where it is."""
    t_ms = START_MS + round(seconds * 1000)
    metres = speed * abs(t_ms - START_MS) / 1000
    geod = Geod(ellps="WGS84")
    lon, lat, _ = geod.fwd(PLACE[1] / 1e7, PLACE[0] / 1e7, math.degrees(course), metres)
    broadcast = Broadcast(round(lat * 1e7), round(lon * 1e7), t_ms)
    found = judge(broadcast, PROOF, QUESTION, t_ms)
    assert found.status != "contradicted"
    assert found.beyond_mm == 0
    assert found.within_mm >= 0


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(st.integers(-890_000_000, 890_000_000), st.integers(-1_800_000_000, 1_800_000_000)),
    st.tuples(st.integers(-890_000_000, 890_000_000), st.integers(-1_800_000_000, 1_800_000_000)),
)
@example((0, 0), (88, 0))
def test_distances_are_those_of_the_ellipsoid_but_for_a_share(one, other):
    _, _, metres = Geod(ellps="WGS84").inv(one[1] / 1e7, one[0] / 1e7, other[1] / 1e7, other[0] / 1e7)
    # Along the equator's meridians a mean sphere is 0.56 % too long; the answer is in whole millimetres.
    assert abs(distance_mm(one, other) - metres * 1000) <= 0.006 * metres * 1000 + 1


def test_every_state_and_limit_has_its_words():
    schema = DOCUMENT["components"]["schemas"]
    named = {f"status.{each}" for each in schema["Conformance"]["properties"]["status"]["enum"]}
    named |= {f"limit.{each}" for each in schema["ConformanceLimit"]["properties"]["code"]["enum"]}
    assert keys_of("conformance") == keys_of("conformance", "fi") == named
    for name in named:
        english, finnish = text("conformance", name, {}), text("conformance", name, {}, "fi")
        assert english.endswith(".")
        assert finnish.endswith(".")
        assert finnish != english


async def hear(running, uav_id, t_ms, lat_e7=PLACE[0], lon_e7=PLACE[1], **more):
    body = {"uav_id": uav_id, "lat_e7": lat_e7, "lon_e7": lon_e7, "t_ms": t_ms, "pad_id": "pad-1", "verified": False}
    row = {"uav_id": uav_id, "pad_id": "pad-1", "t_ms": t_ms, "body": json.dumps(body | more)}
    async with running.context.database.write() as connection:
        await connection.execute(insert(LatestTrackRow), [row])


@both
async def test_the_whole_way(running, machine, clock):
    async with machine("rid.display_provider") as http:

        async def ask(**query):
            answer = await http.get("/api/v1/conformance", params=query)
            assert answer.status_code == 200, answer.text
            conforms("Conformance", answer.json())
            return answer.json()

        assert (await ask(serial="nobody"))["status"] == "unknown"
        unheard = await ask(serial="uav-1")
        assert (unheard["status"], [each["code"] for each in unheard["limits"]]) == ("unproven", ["never_heard"])
        clock.now_ms = START_MS + 4_000
        await hear(running, "uav-1", clock.now_ms)
        found = await ask(serial="uav-1")
        assert (found["status"], found["assurance"], found["distance_mm"]) == ("supported", 2, 0)
        # The last round of ranging counts, not the moment of the decision.
        assert (found["measured_ms"], found["age_ms"]) == (START_MS + 100, 3_900)
        assert found["proof"]["outcome"] == "verified"
        assert found["proven_within_mm"] <= 300_000
        assert found["broadcast"]["source"] == "heard"
        clock.now_ms = START_MS + 30_000
        later = await ask(serial="uav-1")
        assert later["status"] == "supported", "the same broadcast, still the newest one"
        far = await ask(serial="uav-1", lat_e7=PLACE[0] + 450_000, lon_e7=PLACE[1], accuracy_mm=3_000)
        assert (far["status"], far["broadcast"]["source"]) == ("contradicted", "asked")
        await hear(running, "stranger", clock.now_ms)
        stranger = await ask(serial="stranger")
        assert (stranger["status"], [each["code"] for each in stranger["limits"]]) == (
            "unproven", ["not_registered", "no_proof"],
        )  # fmt: skip
        answer = await http.get("/api/v1/conformance", params={"serial": "uav-2"}, headers={"Accept-Language": "fi"})
        assert answer.headers["content-language"] == "fi"
        assert answer.json()["limits"][-1]["text"] == text("conformance", "limit.last_proof_refuted", {}, "fi")


@pytest.mark.parametrize(
    "query",
    [{}, {"serial": ""}, {"serial": "a b"}, {"serial": "x", "lat_e7": 1}, {"serial": "x", "t_ms": 1},
     {"serial": "x", "within_mm": 0}, {"serial": "x", "max_speed_mm_s": 10**9}, {"serial": "x", "colour": "red"}],
)  # fmt: skip
async def test_questions_that_make_no_sense(running, query):
    answer = await running.get("/conformance", params=query)
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


@pytest.mark.parametrize(
    ("timed", "place"),
    [
        (None, PLACE),
        ({"agrees": True, "finding": "inside"}, PLACE),
        ({"agrees": True, "finding": "vague"}, PLACE),
        ({"agrees": False, "finding": "vague"}, None),
        ({"agrees": True, "finding": "outside"}, None),
        ({"agrees": True, "finding": "inconsistent"}, None),
    ],
)
async def test_a_place_that_time_stamps_contradict_is_nothing_to_build_on(running, facts, timed, place):
    from wonderland_backend.conformance.queries import measured
    from wonderland_backend.db.tables.ledger import VerdictRow

    record = facts.verdict("0" * 64).to_json()
    if timed is not None:
        record["time_differences"] = timed
    row = VerdictRow(session_id="0" * 64, outcome="refuted", decided_ms=START_MS, record=json.dumps(record))
    async with running.context.database.read() as database:
        found = await measured(database, row)
    assert found.place == place
    assert found.t_ms == START_MS
