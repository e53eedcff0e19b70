"""A pad that says of itself that it drifts: taken in, and raised as an alert."""

from __future__ import annotations

import json

import msgspec
import pytest

from wonderland import telemetry
from wonderland_backend.alerts.kinds import plain_text
from wonderland_backend.alerts.watch import pad_conditions
from wonderland_backend.pads.schemas import DriftHealth
from wonderland_edge_agent.drift import DriftState

NOW_MS = 1_800_000_000_000
STATES = [
    DriftState("moved", NOW_MS, 7, anchor_id="A3", off_mm=114, sigma_mm=12, common_mm=-3, since_ms=NOW_MS - 9),
    DriftState("drifting", NOW_MS, 7, common_mm=-180, since_ms=NOW_MS - 9),
    DriftState("ok", NOW_MS, 7),
]


@pytest.mark.parametrize("state", STATES, ids=lambda state: state.state)
def test_what_the_agent_says_is_taken_in_and_given_out(state):
    said = telemetry.plain(state.health())
    body = json.dumps({"anchors": [], "drift": said})
    assert msgspec.json.decode(body, type=telemetry.Health).drift == state.health()
    assert DriftHealth.model_validate(said).extra_sigma_mm == (state.extra_sigma_mm or None)


def conditions(state):
    pads = [
        ("roof", NOW_MS, json.dumps({"drift": telemetry.plain(state.health())})),
        ("other", NOW_MS, json.dumps({"prekeys": 1})),
    ]
    return list(pad_conditions(pads, lambda _: True, NOW_MS))


@pytest.mark.parametrize(
    ("state", "facts"),
    [
        (STATES[0], {"state": "moved", "anchor_id": "A3", "off_mm": 114, "extra_sigma_mm": 115}),
        (STATES[1], {"state": "widened", "anchor_id": "all", "off_mm": 0, "extra_sigma_mm": 180}),
        (STATES[2], None),
    ],
    ids=lambda value: getattr(value, "state", ""),
)
def test_the_alert_says_which_anchor_and_what_follows(state, facts):
    found = conditions(state)
    assert [(each.kind, each.pad_id, each.facts) for each in found] == (
        [("pad_drifting", "roof", facts)] if facts else []
    )


def test_what_the_alert_says_can_be_said_in_any_language():
    (moved,), (drifting,) = conditions(STATES[0]), conditions(STATES[1])

    def said(condition, language):
        return plain_text("pad_drifting", "roof", None, condition.facts, language).replace("\N{NO-BREAK SPACE}", " ")

    assert "anchor A3 stands about 0.11 m from its place, and nothing is proved there" in said(moved, "en")
    assert "ankkuri A3 on noin 0,11 m päässä paikaltaan" in said(moved, "fi")
    assert "its anchors together; 0.18 m of uncertainty are added" in said(drifting, "en")
    assert "0,18 m" in said(drifting, "fi")
