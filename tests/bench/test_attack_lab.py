"""The goals that the attack lab measures, with many tries (``wonderland attack`` prints the same tables)."""

from __future__ import annotations

import pytest
from bench_tools import show

from simulator.attack_lab import LabSettings, run
from simulator.attack_lab.report import found_after

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]
MANY = 100_000


@pytest.fixture
def measured(keep):
    """Plays attacks at one level; returns their results by name."""

    def play(level, tries, *names):
        result = run(LabSettings(attacks=names, levels=(level,), tries=tries))
        found = {attack.name: attack.levels[0] for attack in result.attacks}
        show(
            f"Attacks at assurance {level}, {result.took_s:.0f} s",
            ("attack", "tries", "won (95 %)", "refuted", "open", "found after", "farthest when refuted"),
            [
                (name, one.tries, one.interval, one.refuted, one.open, found_after(one), one.error_refuted_m_most)
                for name, one in found.items()
            ],
        )
        keep(level=level, **{name: [one.tries, one.won, one.refuted, one.open] for name, one in found.items()})
        return found

    return play


def test_the_insider_with_time_stamps_wins_nothing_at_level_three(measured):
    found = measured(3, MANY, "per-anchor-stamp-lie", "per-anchor-stamp-lie-far", "uniform-stamp-lie")
    assert [one.won for one in found.values()] == [0, 0, 0]
    assert {one.tries for one in found.values()} == {MANY}


def test_lies_of_three_buffers_and_more_are_refuted(measured):
    for one in measured(2, MANY, "gnss-offset", "vague-claim", "random-reduction", "dropped-rounds").values():
        assert one.won == 0
        assert one.refuted >= 0.999 * one.tries


def test_honest_drones_are_not_refuted(measured):
    one = measured(2, MANY, "honest")["honest"]
    assert one.refuted <= 0.001 * one.tries
    assert one.granted >= 0.999 * one.tries


def test_a_slow_drag_is_refused_before_the_error_reaches_two_buffers(measured):
    one = measured(2, MANY // 5, "gnss-drag")["gnss-drag"]
    assert one.won == 0
    assert one.error_refuted_m_most < 2.0


def test_one_compromised_anchor_never_verifies_a_lie(measured):
    found = measured(2, MANY // 5, "compromised-anchor", "compromised-anchor-of-5", "compromised-anchor-of-6")
    assert not any(one.won for one in found.values())
    for name in ("compromised-anchor-of-5", "compromised-anchor-of-6"):
        assert found[name].refuted >= 0.99 * found[name].tries
