from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.drift import widened
from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.drift import Baseline, BaselineError, DriftWatch
from wonderland_edge_agent.drift.baseline import summary
from wonderland_edge_agent.drift.keeper import DriftKeeper
from wonderland_edge_agent.drift.watch import SLACK, Cusum, threshold
from wonderland_edge_agent.self_survey import Priors, self_survey

PLACES = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}
LOOK_S = 600


def ranges(places, rng, rounds=20, common_m=0.0, sigma_m=0.025, units=None):
    """Ranges by (leader, follower), as nodes report them: whole centimetres."""
    units = units or {}
    return {
        (a, b): [
            round((math.dist(places[a], places[b]) + 0.05 + units.get(a, 0) + units.get(b, 0) + common_m + rng.gauss(0, sigma_m)) * 100) * 10
            for _ in range(rounds)
        ]
        for a in places
        for b in places
        if a != b
    }  # fmt: skip


def moved(name, east_m, north_m):
    x, y, z = PLACES[name]
    return {**PLACES, name: (x + east_m, y + north_m, z)}


def watch(rng) -> DriftWatch:
    return DriftWatch(Baseline.of(ranges(PLACES, rng, 30), t_ms=0, source="test"), PLACES, LOOK_S)


@pytest.mark.parametrize("angle", range(0, 360, 45))
@pytest.mark.parametrize("name", PLACES)
def test_an_anchor_that_moved_by_ten_centimetres_is_named_within_three_looks(name, angle):
    rng = random.Random(f"{name}{angle}")
    over = watch(rng)
    for look in range(5):
        assert over.judge_pairs(look, summary(ranges(PLACES, rng))).state == "ok"
    there = moved(name, 0.1 * math.cos(math.radians(angle)), 0.1 * math.sin(math.radians(angle)))
    for _ in range(3):
        state = over.judge_pairs(10, summary(ranges(there, rng)))
        if state.state != "ok":
            break
    assert (state.state, state.anchor_id) == ("moved", name)
    assert state.off_mm == pytest.approx(100, abs=60)
    assert state.extra_sigma_mm >= state.off_mm
    assert state.health().anchor_id == name


def test_seasons_and_noise_raise_no_alarm_and_a_lasting_common_change_does():
    rng = random.Random(5)
    over = watch(rng)
    for look in range(1_500):  # ten days with ±15 °C between night and noon
        warm = 0.03 * math.sin(2 * math.pi * look / 144)
        assert over.judge_pairs(look, summary(ranges(PLACES, rng, 10, common_m=warm))).state == "ok"
    for _ in range(10):
        state = over.judge_pairs(2_000, summary(ranges(PLACES, rng, common_m=0.20)))
    assert state.state == "drifting"
    assert state.common_mm == pytest.approx(200, abs=20)
    assert state.extra_sigma_mm >= 180


def test_the_alarm_ends_when_the_anchor_is_put_back():
    rng = random.Random(6)
    over = watch(rng)
    while over.state.state == "ok":
        over.judge_pairs(1, summary(ranges(moved("A2", 0.3, 0.0), rng)))
    for _ in range(12):
        over.judge_pairs(2, summary(ranges(PLACES, rng)))
    assert over.state.state == "ok"


def test_pairs_that_are_missing_change_nothing():
    rng = random.Random(7)
    over = watch(rng)
    assert over.judge_pairs(1, {}).looks == 0
    some = {pair: value for pair, value in summary(ranges(PLACES, rng)).items() if "A4" not in pair}
    assert over.judge_pairs(2, some).state == "ok"
    assert over.judge_pairs(3, {("B1", "B2"): next(iter(some.values()))}).looks == 1


def test_the_stated_rate_of_false_alarms_holds():
    """A limit for one alarm in 400 values, and how often it really comes."""
    limit = threshold(1, 1.0, years=400 / (365.25 * 86_400))
    rng = random.Random(8)
    lengths = []
    for _ in range(400):
        both = Cusum(limit)
        length = 1
        while not both.add(rng.gauss(0, 1)):
            length += 1
        lengths.append(length)
    assert sum(lengths) / len(lengths) == pytest.approx(400, rel=0.2)
    assert SLACK == 1.0
    assert threshold(121, 60) > threshold(7, 600) > 5


class TestSelfSurvey:
    def test_a_survey_that_is_right_agrees_in_spite_of_uncalibrated_units(self):
        for seed in range(20):
            rng = random.Random(seed)
            units = {name: rng.gauss(0, 0.02) for name in PLACES}
            measured = {p: v.range_mm / 1000 for p, v in summary(ranges(PLACES, rng, units=units)).items()}
            found = self_survey(PLACES, measured)
            assert found.agrees
            assert found.common_m == pytest.approx(0.05, abs=0.05)

    @pytest.mark.parametrize("name", PLACES)
    def test_the_anchor_that_is_off_is_named_with_how_far_and_how_certain(self, name):
        measured = {p: v.range_mm / 1000 for p, v in summary(ranges(moved(name, 0.25, 0.1), random.Random(1))).items()}
        found = self_survey(PLACES, measured)
        assert found.suspect.anchor_id == name
        assert found.suspect.off_m == pytest.approx(0.27, abs=3 * found.suspect.sigma_m + 0.03)
        assert found.suspect.sigma_m < 0.15

    def test_exchanged_anchors_are_recognised(self):
        places = {**PLACES, "A1": PLACES["A2"], "A2": PLACES["A1"]}
        measured = {p: v.range_mm / 1000 for p, v in summary(ranges(places, random.Random(2))).items()}
        assert self_survey(PLACES, measured).exchanged == ("A1", "A2")

    @given(
        st.dictionaries(
            st.tuples(st.sampled_from(["A1", "A2", "A3", "A4", "X"]), st.sampled_from(["A1", "A2", "A3", "A4"])),
            st.floats(0.01, 1e4),
        )
    )
    @settings(max_examples=60, deadline=None)
    def test_any_ranges_give_an_answer(self, measured):
        found = self_survey(PLACES, {pair: value for pair, value in measured.items() if pair[0] != pair[1]})
        assert all(math.isfinite(item.off_m) and math.isfinite(item.sigma_m) for item in found.anchors)

    def test_sixteen_anchors(self):
        places = {f"N{i}": (3 * math.cos(i), 3 * math.sin(1.3 * i), 0.1 * i) for i in range(16)}
        measured = {p: v.range_mm / 1000 for p, v in summary(ranges(places, random.Random(3), 8)).items()}
        assert self_survey(places, measured, priors=Priors(unit_m=0.02)).agrees


class TestBaselineFile:
    def test_it_comes_back_for_its_own_commissioning_only(self, tmp_path):
        made = Baseline.of(ranges(PLACES, random.Random(1)), t_ms=7, source="x")
        path = tmp_path / "spool" / "anchors.json"
        made.save(path, "a" * 64)
        found = Baseline.load(path, "a" * 64)
        assert (found.t_ms, found.source, set(found.pairs)) == (7, "x", set(made.pairs))
        assert Baseline.load(path, "b" * 64) is None
        assert Baseline.load(tmp_path / "none.json", "a" * 64) is None

    @pytest.mark.parametrize("text", ["", "[]", "{", '{"commissioning_sha256": "k"}'])
    def test_a_broken_file_is_said_or_ignored(self, tmp_path, text):
        path = tmp_path / "anchors.json"
        path.write_text(text)
        if text in {"", "{"}:
            with pytest.raises(BaselineError, match=r"anchors\.json"):
                Baseline.load(path, "z")
        else:
            assert Baseline.load(path, "z") is None

    @given(
        st.recursive(
            st.none() | st.integers() | st.text() | st.floats(),
            lambda c: st.lists(c) | st.dictionaries(st.sampled_from(["pairs", "t_ms", "source"]), c),
            max_leaves=12,
        )
    )
    @settings(max_examples=100, deadline=None)
    def test_nothing_leaks_from_inside(self, value):
        with contextlib.suppress(BaselineError):
            Baseline.parse(value)


class Radios:
    """Nodes whose ranges follow where the anchors stand."""

    def __init__(self) -> None:
        self.stand = dict(PLACES)
        self.rng = random.Random(11)
        self.away = False
        self.hidden = set()
        self.bad_looks = []

    async def measure_between(self, macs, rounds, channel):
        assert macs["A1"] == 0xA001
        if self.away:
            return {}
        stand = self.bad_looks.pop(0) if self.bad_looks else self.stand
        return {pair: v for pair, v in ranges(stand, self.rng, rounds).items() if set(pair) != self.hidden}


@pytest.fixture
def commissioning(fitted):
    from wonderland_edge_agent.commissioning.survey_files import NOWHERE

    return fitted.commissioning(
        NOWHERE.frame, valid_from_ms=0, valid_until_ms=1, macs={f"A{i}": 0xA000 + i for i in range(1, 5)}
    )


class TestKeeper:
    async def test_it_learns_watches_remembers_and_begins_anew(self, tmp_path, commissioning):
        radios, path = Radios(), tmp_path / "anchors.json"
        keeper = DriftKeeper(radios, path, lambda: 1_000, 600)
        assert (await keeper.measure_and_judge("a" * 64, commissioning)).state == "ok"
        assert json.loads(path.read_text())["source"] == "first look"
        assert keeper.extra_sigma_mm("a" * 64) is None
        radios.stand = moved("A3", 0.15, 0.0)
        for _ in range(3):
            await keeper.measure_and_judge("a" * 64, commissioning)
        assert keeper.moved("a" * 64)
        assert not keeper.moved("b" * 64)
        assert keeper.state.anchor_id == "A3"
        # A restart forgets neither the baseline nor the alarm.
        again = DriftKeeper(radios, path, lambda: 2_000, 600)
        again.load("a" * 64, commissioning)
        assert again.moved("a" * 64)
        # Commissioned anew, it learns anew.
        assert (await again.measure_and_judge("b" * 64, commissioning)) is not None

    async def test_an_anchor_that_was_moved_before_the_first_look_is_noticed_by_the_survey(
        self, tmp_path, commissioning
    ):
        radios = Radios()
        radios.stand = moved("A4", 0.4, -0.2)
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        state = await keeper.measure_and_judge("a" * 64, commissioning)
        assert (state.state, state.anchor_id) == ("moved", "A4")

    # A2 and A4 mirror each other in the line through A1 and A3: no range between anchors shows their exchange.
    @pytest.mark.parametrize("pair", [each for each in itertools.combinations(PLACES, 2) if each != ("A2", "A4")])
    @pytest.mark.parametrize("known", [True, False])
    async def test_two_nodes_that_were_exchanged_are_both_named(self, tmp_path, commissioning, pair, known):
        one, other = pair
        radios = Radios()
        exchanged = {**PLACES, one: PLACES[other], other: PLACES[one]}
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        if known:
            assert (await keeper.measure_and_judge("a" * 64, commissioning)).state == "ok"
        radios.stand = exchanged
        state = await keeper.measure_and_judge("a" * 64, commissioning)
        assert (state.state, {state.anchor_id, state.exchanged_with}) == ("moved", {*pair})
        assert "exchange their ports" in keeper.why_moved("a" * 64)
        again = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 2_000, 600)
        assert again.why_moved("a" * 64) == ""
        again.load("a" * 64, commissioning)
        assert again.why_moved("a" * 64) == keeper.why_moved("a" * 64)

    async def test_one_bad_first_look_that_seems_an_exchange_closes_no_pad(self, tmp_path, commissioning):
        radios = Radios()
        radios.bad_looks = [{**PLACES, "A1": PLACES["A2"], "A2": PLACES["A1"]}]
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        assert (await keeper.measure_and_judge("a" * 64, commissioning)).state == "ok"

    @pytest.mark.parametrize("named", [("A1",), ("A1", "A2")])
    async def test_one_bad_first_look_closes_no_pad(self, tmp_path, commissioning, named):
        radios = Radios()
        radios.bad_looks = [moved(anchor, 1.0, 0.5) for anchor in named]
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        states = [await keeper.measure_and_judge("a" * 64, commissioning) for _ in range(2)]
        assert not keeper.moved("a" * 64)
        assert states[-1].state == "ok"
        assert states[0] == (states[1] if len(named) == 1 else None)

    async def test_a_pair_that_never_hears_each_other_is_waited_for_and_then_left_out(self, tmp_path, commissioning):
        radios = Radios()
        radios.hidden = {"A1", "A3"}
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        states = [await keeper.measure_and_judge("a" * 64, commissioning) for _ in range(4)]
        assert [state and state.state for state in states] == [None, None, "ok", "ok"]
        assert len(json.loads((tmp_path / "anchors.json").read_text())["pairs"]) == 5

    async def test_a_session_that_comes_between_costs_nothing(self, tmp_path, commissioning):
        radios = Radios()
        radios.away = True
        keeper = DriftKeeper(radios, tmp_path / "anchors.json", lambda: 1_000, 600)
        assert await keeper.measure_and_judge("a" * 64, commissioning) is None

    @pytest.mark.parametrize("text", ["", "[]", "{", '{"commissioning": "k", "state": 3}'])
    async def test_a_broken_note_is_no_obstacle(self, tmp_path, commissioning, text):
        (tmp_path / "drift.json").write_text(text)
        keeper = DriftKeeper(Radios(), tmp_path / "anchors.json", lambda: 1_000, 600)
        assert (await keeper.measure_and_judge("k", commissioning)).state == "ok"


def test_uncertainty_is_added_and_never_taken_away(commissioning):
    wider = widened(commissioning, 40)
    assert isinstance(wider, Commissioning)
    for before, after in zip(commissioning.anchors, wider.anchors, strict=True):
        assert after.survey_sigma_mm == math.isqrt(before.survey_sigma_mm**2 + 1600) >= before.survey_sigma_mm
        assert dataclasses.replace(after, survey_sigma_mm=before.survey_sigma_mm) == before
    assert widened(commissioning, 10_000).anchors[0].survey_sigma_mm == 10_000
