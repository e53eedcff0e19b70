"""A pad that says of itself that it drifts: taken in, and raised as an alert."""

from __future__ import annotations

import json

import msgspec
import pytest

from backend.alerts.kinds import plain_text
from backend.alerts.watch import pad_conditions
from backend.pads.schemas import DriftHealth
from edge_agent.drift import DriftState
from wonderland import telemetry

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


@pytest.mark.parametrize(
    ("state", "why"),
    [
        (STATES[0], "anchor A3 stands about 11 cm from its place, nothing is proved there"),
        (STATES[1], "its anchors together, 180 mm of uncertainty are added"),
        (STATES[2], None),
    ],
)
def test_the_alert_says_which_anchor_and_what_follows(state, why):
    pads = [
        ("roof", NOW_MS, json.dumps({"drift": telemetry.plain(state.health())})),
        ("other", NOW_MS, json.dumps({"prekeys": 1})),
    ]
    found = list(pad_conditions(pads, lambda _: True, NOW_MS))
    assert [(each.kind, each.pad_id, each.facts["why"]) for each in found] == (
        [("pad_drifting", "roof", why)] if why else []
    )


def test_what_the_alert_says_can_be_said_in_any_language():
    (moved, drifting) = (
        next(
            iter(
                pad_conditions(
                    [("roof", NOW_MS, json.dumps({"drift": telemetry.plain(state.health())}))], lambda _: True, NOW_MS
                )
            )
        )
        for state in STATES[:2]
    )
    assert (moved.facts["state"], moved.facts["anchor_id"], moved.facts["off_mm"]) == ("moved", "A3", 114)
    said = plain_text("pad_drifting", "roof", None, moved.facts, "fi")
    assert "ankkuri A3 on noin 11 cm paikaltaan" in said
    assert "ankkurit yhdessä, epävarmuutta lisätään 180 mm" in plain_text(
        "pad_drifting", "roof", None, drifting.facts, "fi"
    )
