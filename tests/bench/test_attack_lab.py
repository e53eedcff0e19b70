"""The goals that the attack lab measures, with many tries (``wonderland attack`` prints the same tables)."""

from __future__ import annotations

import numpy as np
import pytest
from bench.bench_tools import show

from wonderland_research.attack_lab import ATTACKS, LabSettings, run
from wonderland_research.attack_lab.attacks.common import BUFFER_MM
from wonderland_research.attack_lab.attacks.position import GOAL_BUFFERS
from wonderland_research.attack_lab.judge import Tally, run_batch
from wonderland_research.attack_lab.model import interval
from wonderland_research.attack_lab.report import found_after
from wonderland_research.attack_lab.run import CHUNK

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


def test_a_slow_drag_is_refused_before_the_error_reaches_two_buffers(keep):
    """But for fewer than 1 in 10,000: where it began long before ranging did, no test leaves room (docs/method-evidence.md)."""
    attack = ATTACKS["gnss-drag"]
    make = attack.variants[0].make
    tally = Tally()
    for chunk in range(MANY // CHUNK):
        tally.add(run_batch(make(np.random.default_rng((2, chunk)), CHUNK), sample=1))
    late = [error_mm for error_mm in tally.error_refuted_mm if error_mm >= GOAL_BUFFERS * BUFFER_MM]
    early = tally.error_granted_mm
    show(
        f"Slow drags at assurance 2, {tally.tries:,} tries",
        ("refuted", "two buffers off when refuted", "farthest (m)", "permitted", "beyond one buffer", "farthest (m)"),
        [(tally.refuted, len(late), max(tally.error_refuted_mm) / 1000, tally.granted, len(early), _metres(early))],
    )
    keep(tries=tally.tries, refuted=tally.refuted, late=len(late), granted=tally.granted, early=len(early))
    assert tally.won == 0
    assert interval(len(late), tally.refuted)[0] < 1e-4
    assert max(tally.error_refuted_mm) < 1.5 * GOAL_BUFFERS * BUFFER_MM


def _metres(errors_mm):
    return max(errors_mm, default=0) / 1000


def test_one_compromised_anchor_never_verifies_a_lie(measured):
    found = measured(2, MANY // 5, "compromised-anchor", "compromised-anchor-of-5", "compromised-anchor-of-6")
    assert not any(one.won for one in found.values())
    for name in ("compromised-anchor-of-5", "compromised-anchor-of-6"):
        assert found[name].refuted >= 0.99 * found[name].tries
