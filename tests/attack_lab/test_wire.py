"""A few of the lab's attacks the whole way: serial ports, agents' processes, transactions, blocks."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from types import SimpleNamespace

import pytest

from wonderland_research.attack_lab import ATTACKS, wire
from wonderland_research.attack_lab.wire import LEDGER_ATTACKS, WireResult, markdown, run_wire, specs
from wonderland_research.attack_lab.wire_sites import (
    LEVEL,
    SITES,
    TIMED,
    TIMED_LEVEL,
    WITNESSED,
    WITNESSED_LEVEL,
    commissioning,
    documented,
    drones,
    parsed,
    sites_for,
)
from wonderland_simulator.attackers.ranging import RANGE_ATTACKS, Situation
from wonderland_simulator.scenario import PADS
from wonderland_simulator.stage import ProcessError

HERE, CLAIMED = (9.0, 3.0, 5.0), (6.0, -2.0, 5.0)
ANCHORS = [(site.east_m, site.north_m, site.up_m) for site in PADS[0].anchors]


@pytest.mark.timeout(900)
async def test_attackers_on_the_air_and_on_the_ledger_win_nothing(tmp_path, capfd):
    names = ["honest", "per-anchor-stamp-lie", "random-reduction", "anchors-turned", "borrowed-identity"]
    names += ["dropped-rounds", *LEDGER_ATTACKS]
    names.remove("session-replay")  # minutes of patience for a drone that never answers rightly; its evidence is below
    report = tmp_path / "report"
    assert await run_wire(names, seed=1, as_json=True, directory=tmp_path / "run", report=report) == 0
    said = {each["attack"]: each for each in map(json.loads, capfd.readouterr().out.splitlines())}
    assert json.loads((report / "wire.json").read_text()) == list(said.values())
    assert said["honest"]["permission"] == "granted"
    # A busy machine ranges few rounds, and then the lie stays open; on an idle one it is refuted.
    assert said["random-reduction"]["outcome"] != "verified", said["random-reduction"]
    assert said["random-reduction"]["permission"] == "refused"
    assert said["dropped-rounds"]["permission"] == "refused"
    assert said["borrowed-identity"]["permission"] == "granted"  # at any level: a holder of the keys is there
    assert said["borrowed-identity@3"]["permission"] == "granted"
    assert said["per-anchor-stamp-lie"]["permission"] == "granted"  # at level 2, as documented
    assert said["per-anchor-stamp-lie@3"]["permission"] == "refused"
    assert (said["honest@3"]["permission"], said["honest@3"]["assurance"]) == ("granted", 3)
    assert (said["honest@4"]["permission"], said["honest@4"]["assurance"]) == ("granted", 4)
    assert "witness_prove" in said["honest@4"]["reasons"]
    assert said["per-anchor-stamp-lie@4"]["permission"] == "refused"
    assert said["anchors-turned@4"]["permission"] == "refused"
    assert "witness_contradicts" in said["anchors-turned@4"]["reasons"]  # its own pad is taken in
    assert said["prekey-reuse"]["reasons"] == ["PREKEY_USED"]
    # Rounds, claims and countersignature are in order: what refuses it is that nothing binds the ranges.
    assert (said["keyless-board"]["permission"], said["keyless-board"]["outcome"]) == ("refused", "inconclusive")
    assert said["keyless-board"]["reasons"] == ["ranges_unbound", "assurance_too_low"]
    assert said["wrong-role"]["reasons"] == ["ROLE_NOT_ALLOWED"]
    assert "countersignature_invalid" in said["evidence-replay"]["reasons"]
    assert "not_countersigned" in said["pad-alone"]["reasons"]


def said_by(uav_id, *codes, outcome="inconclusive", permission="refused"):
    """A committed verdict as far as `fly` looks at it."""
    verdict = SimpleNamespace(
        uav_id=uav_id,
        pad_id="pad",
        outcome=outcome,
        permission=permission,
        rounds=10,
        assurance=2,
        reasons=[SimpleNamespace(code=code) for code in codes],
    )
    return SimpleNamespace(verdict=verdict, tx_id="0" * 64)


@pytest.fixture
def flown(monkeypatch):
    """Runs `fly` over such verdicts; the results."""

    async def run(flying, *items, gap_s=0.0):
        passed = {"s": 0.0}

        async def committed(connection, channel):
            for item in items:
                passed["s"] += gap_s
                yield item

        async def close():
            return None

        monkeypatch.setattr(wire, "committed", committed)
        monkeypatch.setattr(wire.time, "monotonic", lambda: passed["s"])
        channel = SimpleNamespace(close=close)
        stage = SimpleNamespace(
            connection=SimpleNamespace(open_channel=lambda: channel), processes=SimpleNamespace(ended=lambda: None)
        )
        drones = {name: SimpleNamespace(uav_id=uav_id) for name, uav_id in flying.items()}
        return [result async for result, _ in wire.fly(stage, drones)]

    return run


async def test_a_witness_that_contradicts_has_told_something(flown):
    contradicted = said_by("U1", "no_time_stamps", "witness_contradicts", "assurance_too_low")
    (result,) = await flown({"anchors-turned@4": "U1"}, contradicted, said_by("U1", "never looked at"))
    assert (result.sessions, "witness_contradicts" in result.reasons) == (1, True)


async def test_a_session_in_which_nothing_was_heard_is_flown_again(flown):
    (result,) = await flown(
        {"honest@4": "U1"},
        said_by("U1", "no_witness"),
        said_by("U1", "within_buffer", outcome="verified", permission="granted"),
    )
    assert (result.sessions, result.permission) == (2, "granted")


async def test_an_honest_drone_that_is_left_open_asks_again_and_a_liar_has_its_answer(flown):
    again = said_by("U1", "within_buffer", outcome="verified", permission="granted")
    honest, liar = await flown(
        {"honest@3": "U1", "mixed-claims": "U2"},
        said_by("U1", "anchor_silent", "unchecked"),
        said_by("U2", "claims_contradicted"),
        again,
    )
    assert {(each.attack, each.sessions) for each in (honest, liar)} == {("honest@3", 2), ("mixed-claims", 1)}
    (open_to_the_end,) = await flown({"honest@3": "U1"}, *[said_by("U1", "anchor_silent", "unchecked")] * 9)
    assert (open_to_the_end.sessions, open_to_the_end.as_documented) == (wire.MOST_SESSIONS, False)


async def test_who_has_its_result_does_not_keep_the_run_waiting_for_one_that_never_comes(flown):
    others = [said_by("U1", "within_buffer", outcome="verified", permission="granted")] * 20
    with pytest.raises(ProcessError, match=r"no verdict for 120 s; still without one: anchors-turned@4$"):
        await flown({"honest": "U1", "anchors-turned@4": "U2"}, *others, gap_s=30.0)


def test_each_sample_on_the_wire_is_a_documented_class():
    assert set(specs()) | set(LEDGER_ATTACKS) == {each.wire for each in ATTACKS.values() if each.wire}
    assert all(LEVEL in attack.levels for attack in ATTACKS.values() if attack.wire)
    assert all(TIMED_LEVEL in ATTACKS[name].levels for name in TIMED)
    assert all(WITNESSED_LEVEL in ATTACKS[name].levels for name in WITNESSED)


def test_what_flies_where():
    levels = (LEVEL, TIMED_LEVEL, WITNESSED_LEVEL)
    flying = drones(list(specs()), specs(), levels)
    assert len({drone.uav_id for drone in flying.values()}) == len(flying)
    assert len(flying) == len(specs()) + len(TIMED) + len(WITNESSED)
    pads = {pad.pad_id: pad for pad in SITES}
    for key, drone in flying.items():
        name, level = parsed(key)
        demanded = pads[drone.pad_id].dock_assurance if drone.action == "dock" else LEVEL
        assert (demanded, drone.attack is None or drone.attack.name == name) == (level, True)
    assert {name.partition("@")[0] for name in drones(["honest", "relay"], specs(), (TIMED_LEVEL,))} == {"honest"}
    assert sites_for(["honest"], levels) == SITES
    assert sites_for(["relay"], levels) == sites_for(["honest"], (LEVEL, TIMED_LEVEL)) == PADS


def test_the_turned_pad_sees_the_drone_where_it_claims_to_be():
    pad = next(site for site in SITES if site.pad_id == "lab-turned")
    drone = drones(["anchors-turned"], specs(), (WITNESSED_LEVEL,))["anchors-turned@4"]
    claimed = [here + lie for here, lie in zip(drone.hover_m, drone.attack.lie_m, strict=True)]
    assert 3.0 < math.dist(claimed, drone.hover_m) < 5.0
    for site, surveyed in zip(pad.anchors, commissioning(pad, 1_800_000_000_000).anchors, strict=True):
        measured = math.dist(drone.hover_m, (site.east_m, site.north_m, site.up_m))
        expected = math.dist(claimed, [mm / 1000 for mm in (surveyed.east_mm, surveyed.north_mm, surveyed.up_mm)])
        assert measured == pytest.approx(expected, abs=0.002)


def test_what_is_documented_and_how_it_is_told():
    assert documented("honest", WITNESSED_LEVEL, granted=True)
    assert not documented("honest", LEVEL, granted=False)
    assert documented("anchors-turned", TIMED_LEVEL, granted=True)
    assert not documented("anchors-turned", WITNESSED_LEVEL, granted=True)
    flown = WireResult("relay", "p", "refuted", "refused", 10, 2, ("outside_buffer",), "tx", as_documented=True)
    on_ledger = WireResult("wrong-role", "p", "not taken", "none", 0, 0, ("ROLE_NOT_ALLOWED",), "", as_documented=True)
    rows = markdown([flown, replace(flown, attack="relay@4"), on_ledger]).splitlines()[2:]
    assert [row.split(" | ")[1] for row in rows] == ["2", "4", "–"]
    assert rows[0] == "| `relay` | 2 | refuted | refused | 2 | 10 | `outside_buffer` |"


@pytest.mark.parametrize("name", sorted(RANGE_ATTACKS))
def test_what_an_attacker_does_to_a_range(name):
    rng = random.Random(1)
    rounds = [
        [RANGE_ATTACKS[name](Situation(HERE, CLAIMED, ANCHORS, index, 0.05 * number), rng) for index in range(4)]
        for number in range(400)
    ]
    fitting = Situation(HERE, CLAIMED, ANCHORS, 0, 0.0).fitting_m
    first, second = rounds[0], rounds[1]
    match name:
        case "per-anchor":
            assert first == pytest.approx(fitting)
        case "uniform":
            assert len(set(first)) == 1
            assert first[0] == pytest.approx(sum(fitting) / 4)
        case "delay":
            assert first == [0.0] * 4  # the claim is nearer: time cannot be won
        case "mixed":
            assert sorted((first[0], second[0])) == pytest.approx(sorted((0.0, 2 * fitting[0])))
        case "random-reduction":
            short = [value for values in rounds for value in values if value]
            assert all(-12.0 <= value < 0.0 for value in short)
            assert 0.02 < len(short) / 1600 < 0.06
        case "dropped":
            kept = [values for values in rounds if None not in values]
            assert len(kept) / 400 == pytest.approx(1 / 3, abs=0.02)
            assert all(values == [0.0] * 4 for values in kept)
            assert all(values == [None] * 4 for values in rounds if values not in kept)  # whole rounds, no anchor
        case "silent-anchors":
            whole = [values for values in rounds if None not in values]
            assert len(whole) / 400 == pytest.approx(1 / 3, abs=0.02)
            left_out = {tuple(index for index, value in enumerate(values) if value is None) for values in rounds}
            assert {len(silent) for silent in left_out} == {0, 2}
            assert len(left_out) > 2  # now these, now those
        case "relay":
            assert min(first) > 30.0
        case _:
            assert [index for index, value in enumerate(first) if value] == [1]
