"""The attack lab on the core: every class comes out as documented, the screen says what the decision says."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from wonderland_research.attack_command import attack as command
from wonderland_research.attack_lab import ATTACKS, LabError, LabSettings, UnknownAttackError, kept, run, total_tries
from wonderland_research.attack_lab import judge as judging
from wonderland_research.attack_lab.attacks.insider import choosy
from wonderland_research.attack_lab.judge import run_batch, verdict_of
from wonderland_research.attack_lab.model import interval, percent, share
from wonderland_research.attack_lab.places import SMALL
from wonderland_research.attack_lab.report import markdown, result_from
from wonderland_research.attack_lab.screen import Look, screen_looks

TRIES = 10
running = sys.modules["wonderland_research.attack_lab.run"]  # the package has the function under that name
SCREENED = [
    (name, number)
    for name, attack in ATTACKS.items()
    for number, variant in enumerate(attack.variants)
    if variant.make is not None and max(variant.levels) < 3  # beyond, nothing is screened
]


@pytest.mark.parametrize("name", sorted(ATTACKS))
def test_each_attack_comes_out_as_documented(name):
    attack = ATTACKS[name]
    dear = {level: variant.dear for variant in attack.variants for level in variant.levels}
    result = run(LabSettings(attacks=(name,), tries=TRIES, seed=3, sample=2, processes=1))
    assert tuple(level.level for level in result.attacks[0].levels) == attack.levels
    for level in result.attacks[0].levels:
        assert level.tries == max(1, TRIES // dear[level.level])
        assert level.granted + level.refuted + level.open + level.refused == level.tries
        if attack.stopped_at(level.level) or level.tries == TRIES:  # few tries may miss what wins now and then
            assert level.as_documented, level


@pytest.mark.parametrize(("name", "number"), SCREENED)
def test_the_screen_agrees_with_the_decision(name, number):
    batch = ATTACKS[name].variants[number].make(np.random.default_rng(5), 2)
    screened, exact = (run_batch(batch, sample=0, screened=screened) for screened in (True, False))
    assert (screened.won, screened.granted, screened.refuted, screened.open) == (
        exact.won,
        exact.granted,
        exact.refuted,
        exact.open,
    )
    assert screened.detected_rounds == exact.detected_rounds


def test_a_screen_that_errs_is_found(monkeypatch):
    batch = ATTACKS["honest"].variants[0].make(np.random.default_rng(5), 3)
    monkeypatch.setattr(judging, "screen_looks", lambda batch, rows, rounds: np.full(len(rows), Look.REFUTED))
    with pytest.raises(LabError, match="screen says refuted and the decision verified"):
        run_batch(batch, sample=3)


def test_whatever_may_be_verified_is_asked():
    batch = ATTACKS["honest"].variants[0].make(np.random.default_rng(6), 12)
    assert {int(answer) for answer in screen_looks(batch, np.arange(12), 24)} == {Look.ASK}
    assert {verdict_of(batch, row, 24).outcome for row in range(12)} == {"verified"}


def test_the_same_seed_counts_the_same_whatever_else_runs():
    alone = run(LabSettings(attacks=("edge-retries",), tries=40, seed=9, sample=2, processes=1))
    beside = run(LabSettings(attacks=("gnss-offset", "edge-retries"), tries=40, seed=9, sample=2, processes=1))
    assert alone.attacks[0].levels == beside.attacks[1].levels


def test_a_run_that_was_ended_goes_on_where_it_was(tmp_path, monkeypatch):
    settings = LabSettings(attacks=("early-commit",), levels=(2,), tries=30, sample=2, processes=1, keep=tmp_path)
    monkeypatch.setattr(running, "CHUNK", 10)
    whole = run(replace(settings, keep=None))
    played = 0

    def end_after_two(name, tries):
        nonlocal played
        played += 1
        if played == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(settings, end_after_two)
    assert len(list(tmp_path.glob("*.json"))) == 2
    monkeypatch.setattr(running, "_play", _only(running._play, number=2))
    assert run(settings).attacks == whole.attacks
    # Another seed is another run, and what other code played does not count.
    monkeypatch.setattr(running, "_play", _only(running._play, number=None))
    with pytest.raises(AssertionError, match="played again"):
        run(replace(settings, seed=2))
    monkeypatch.setattr(kept, "code", lambda: "other")
    with pytest.raises(AssertionError, match="played again"):
        run(settings)


def _only(play, number):
    def playing(chunk):
        assert chunk.number == number, "played again"
        return play(chunk)

    return playing


@pytest.mark.parametrize("text", ["", "[]", '{"code": "x"', json.dumps({"code": kept.code()})])
def test_a_kept_file_that_is_no_tally_is_refused(tmp_path, text):
    (tmp_path / "early-commit-1-0-5-1.json").write_text(text)
    settings = LabSettings(attacks=("early-commit",), levels=(2,), tries=5, processes=1, keep=tmp_path)
    with pytest.raises(LabError, match="no tally"):
        run(settings)


def test_levels_and_totals():
    settings = LabSettings(attacks=("early-commit",), levels=(2,), tries=5)
    assert total_tries(settings) == {"early-commit": 5}
    result = run(LabSettings(attacks=("early-commit",), levels=(2,), tries=5, processes=1))
    assert [level.level for level in result.attacks[0].levels] == [2]
    with pytest.raises(UnknownAttackError, match="no attack is called moon-landing"):
        run(LabSettings(attacks=("moon-landing",)))


@pytest.mark.parametrize("attempts", [2, 5, 10, 40])
def test_a_drone_that_chooses_its_rounds_wins_nothing(attempts):
    batch = choosy(2, SMALL, (1_500.0, 4_000.0), attempts, np.random.default_rng(attempts), 40)
    assert run_batch(batch, sample=5).won == 0


def test_it_would_win_were_the_rounds_not_counted_that_it_breaks_off():
    batch = choosy(2, SMALL, (1_500.0, 3_000.0), 40, np.random.default_rng(1), 20)
    batch.attempts = None
    assert run_batch(batch, sample=5).won > 10


def test_shares_are_said_without_hiding_a_success():
    assert share(0, 1000) == "0"
    assert share(1, 100_000) == "0.001 %"
    assert share(1000, 1000) == "100 %"
    assert share(99_999, 100_000) != "100 %"
    assert percent(0.0317) == "3.2 %"
    low, high = interval(0, 100_000)
    assert (low, round(high, 7)) == (0.0, 0.0000369)


def test_the_command(tmp_path):
    arguments = ["--attack", "gnss-offset", "--tries", "5", "--processes", "1"]
    done = CliRunner().invoke(command, [*arguments, "--report", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "gnss-offset" in done.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "attacks.json",
        "attacks.md",
        "permissions.svg",
        "detection.svg",
    }
    said = json.loads((tmp_path / "out" / "attacks.json").read_text())
    assert said["attacks"][0]["levels"][0]["won"] == 0
    done = CliRunner().invoke(command, [*arguments, "--json"])
    assert json.loads(done.stdout)["attacks"][0]["name"] == "gnss-offset"
    done = CliRunner().invoke(command, ["--attack", "none"])
    assert done.exit_code == 1
    assert "--list" in done.output


def test_the_list_says_of_each_what_it_costs_and_what_stops_it():
    done = CliRunner().invoke(command, ["--list", "--json"])
    said = json.loads(done.stdout)
    assert [each["name"] for each in said] == list(ATTACKS)
    for each in said:
        assert all(each[field] for field in ("title", "controls", "cost", "wins", "stops"))
    done = CliRunner().invoke(command, ["--list"])
    assert "at no level" in done.output


def test_runs_are_put_together_and_into_the_page(tmp_path):
    small, large = (
        run(LabSettings(attacks=("early-commit",), tries=tries, processes=1, levels=levels))
        for tries, levels in ((4, (1, 2)), (6, (2,)))
    )
    both = result_from([json.dumps(one.to_json()) for one in (small, large)])
    assert [(level.level, level.tries) for level in both.attacks[0].levels] == [(1, 4), (2, 6)]
    text = markdown(both)
    assert "| 1 | 4 | **100 %**" in text
    assert "| 2 | 6 | **0** (≤" in text
    with pytest.raises(ValueError, match=r"no attacks\.json"):
        result_from(["{}"])
