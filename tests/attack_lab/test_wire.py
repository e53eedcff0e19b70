"""A few of the lab's attacks the whole way: serial ports, agents' processes, transactions, blocks."""

from __future__ import annotations

import json
import random

import pytest

from simulator.attack_lab import ATTACKS
from simulator.attack_lab.wire import LEDGER_ATTACKS, LEVEL, TIMED, drones, run_wire, specs
from simulator.attackers.ranging import RANGE_ATTACKS, Situation
from simulator.scenario import PADS

HERE, CLAIMED = (9.0, 3.0, 5.0), (6.0, -2.0, 5.0)
ANCHORS = [(site.east_m, site.north_m, site.up_m) for site in PADS[0].anchors]


@pytest.mark.timeout(240)
async def test_attackers_on_the_air_and_on_the_ledger_win_nothing(tmp_path, capfd):
    names = ["honest", "per-anchor-stamp-lie", "random-reduction", *LEDGER_ATTACKS]
    names.remove("session-replay")  # minutes of patience for a drone that never answers rightly; its evidence is below
    assert await run_wire(names, seed=1, as_json=True, directory=tmp_path) == 0
    said = {each["attack"]: each for each in map(json.loads, capfd.readouterr().out.splitlines())}
    assert said["honest"]["permission"] == "granted"
    assert said["random-reduction"]["outcome"] == "refuted"
    assert said["per-anchor-stamp-lie"]["permission"] == "granted"  # at level 2, as documented
    assert said["per-anchor-stamp-lie@3"]["permission"] == "refused"
    assert (said["honest@3"]["permission"], said["honest@3"]["assurance"]) == ("granted", 3)
    assert said["prekey-reuse"]["reasons"] == ["PREKEY_USED"]
    assert said["wrong-role"]["reasons"] == ["ROLE_NOT_ALLOWED"]
    assert "countersignature_invalid" in said["evidence-replay"]["reasons"]
    assert "not_countersigned" in said["pad-alone"]["reasons"]


def test_each_sample_on_the_wire_is_a_documented_class():
    assert set(specs()) | set(LEDGER_ATTACKS) == {each.wire for each in ATTACKS.values() if each.wire}
    flying = drones(list(specs()))
    assert len({drone.uav_id for drone in flying.values()}) == len(flying) == len(specs()) + len(TIMED)
    assert all(LEVEL in attack.levels for attack in ATTACKS.values() if attack.wire)


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
        case "relay":
            assert min(first) > 30.0
        case _:
            assert [index for index, value in enumerate(first) if value] == [1]
