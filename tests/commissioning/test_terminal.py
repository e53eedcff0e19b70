"""What the operator sees."""

from __future__ import annotations

import io
import math
import random

from rich.console import Console

from wonderland_edge_agent.commissioning.live.recorder import RunRecorder
from wonderland_edge_agent.commissioning.live.terminal import Terminal
from wonderland_edge_agent.self_survey import self_survey
from wonderland_edge_agent.status_command import _show

PLACES = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}


def terminal(**options):
    console = Console(file=io.StringIO(), width=140, force_terminal=False, highlight=False)
    return Terminal(console, **options), console.file


def between(places, seed=1):
    rng = random.Random(seed)
    return {(a, b): math.dist(places[a], places[b]) + rng.gauss(0, 0.005) for a in places for b in places if a < b}


def test_the_check_names_who_is_off_and_where_it_stands():
    shown, text = terminal()
    shown.show_check(self_survey(PLACES, between(PLACES)))
    assert "Survey and ranges agree." in text.getvalue()
    shown, text = terminal()
    shown.show_check(self_survey(PLACES, between({**PLACES, "A3": (-1.6, -1.2, 0.25)})))
    assert "check it" in text.getvalue()
    assert "Anchor A3 does not stand where the survey has it" in text.getvalue()
    shown, text = terminal()
    shown.show_check(self_survey(PLACES, between({**PLACES, "A1": PLACES["A2"], "A2": PLACES["A1"]})))
    assert "Anchors A1 and A2 seem to be exchanged" in text.getvalue()


def test_without_a_person_only_what_was_asked_for_is_confirmed():
    shown, _ = terminal(yes=True)
    assert shown.confirm("Publish this commissioning of pad-1? Verdicts will rest on it.")
    assert not shown.confirm("Go on with a survey that its own anchors contradict?")


def test_the_run_says_what_is_missing_until_nothing_is(tmp_path):
    console = Console(file=io.StringIO(), width=160, force_terminal=True, highlight=False, _environ={"TERM": "xterm"})
    shown = Terminal(console)
    with RunRecorder(
        tmp_path / "r.csv", tmp_path / "t.csv", tmp_path / "s.csv", tuple(PLACES), (0, 0, 0), 100
    ) as recorder:
        assert recorder.coverage.missing(6.0) == "go to about 3 m from the pad"
        shown.progress(recorder, 0.0, 6.0, "")
        for step in range(4_000):
            t_s = step / 10
            radius = 2.5 + 4.0 * (step % 400) / 400
            angle = 2 * math.pi * step / 4_000
            recorder.reference(t_s, (radius * math.cos(angle), radius * math.sin(angle), 0.0))
            for name in PLACES:
                recorder.range(name, step * 100, 3_000 if name != "A4" or step % 2 else None, nlos=False)
            if step == 200:
                assert recorder.coverage.missing(6.0).startswith("go to about 5 m")
        shown.progress(recorder, 400.0, 6.0, "")
        shown.progress(recorder, 400.0, 6.0, "a datagram that is no JSON")
        assert recorder.coverage.missing(6.0) == ""
    shown.close()
    text = console.file.getvalue()
    assert "no position of the reference yet" in text
    assert "weakest A4 50%" in text
    assert "a datagram that is no JSON" in text
    assert recorder.coverage.rounds == 4_000
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 4_001


def test_the_status_says_whether_the_pad_stands_as_commissioned(capsys):
    said = {
        "pad_id": "roof", "session": "", "sessions_run": 3, "requests_waiting": 0, "sessions_to_end": 0, "prekeys": 4,
        "spool": {"records": 0, "bytes": 0, "dropped": 0}, "accepts_sessions": True,
        "receiver": {"frames": 0, "bad": 0}, "anchors": [],
    }  # fmt: skip
    for drift, words in (
        ({"state": "ok"}, "yes, by the anchors' ranges"),
        ({"state": "moved", "anchor_id": "A3", "off_mm": 112}, "anchor A3 stands about 112 mm elsewhere"),
        ({"state": "drifting", "extra_sigma_mm": 40}, "40 mm of uncertainty"),
    ):
        _show({**said, "drift": drift}, "can prove")
        assert words in " ".join(capsys.readouterr().out.split())
